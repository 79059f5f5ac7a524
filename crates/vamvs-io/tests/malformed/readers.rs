//! The table of all readers: for each, the function that writes its undamaged files, the memory that it may take
//! besides a multiple of the files' size, and the function that reads them. Shared with the coverage-guided fuzzing
//! in `fuzz/`.

use std::path::Path;

use vamvs_core::{Camera, Intrinsics, Lens};
use vamvs_io::image;

/// Bytes of memory that any reader may take, for buffers and lists of files.
pub const BASE: usize = 4 << 20;

/// Bytes of memory that an image may take. It may announce up to 1 GiB of pixels, and several copies exist while it
/// is converted.
pub const PICTURE: usize = 4 << 30;

/// Bytes of memory that a compressed file may take, for its uncompressed content.
pub const COMPRESSED: usize = 1 << 30;

/// Calls a macro with the list of readers, each as `NAME: FIXTURE, BYTES, READ;`.
macro_rules! with_readers {
    ($callback:ident) => {
        $callback! {
            colmap_text: fixture::colmap_text, BASE, |f| colmap::read_scene(f, Some(f)).is_ok();
            colmap_binary: fixture::colmap_binary, BASE, |f| colmap::read_scene(f, Some(f)).is_ok();
            colmap_depth_map: fixture::colmap_maps, BASE, |f| colmap::dense::read_depth_map(&f.join("d.bin")).is_ok();
            colmap_normal_map: fixture::colmap_maps, BASE, |f| colmap::dense::read_normal_map(&f.join("n.bin")).is_ok();
            mvsnet_folder: fixture::mvsnet, BASE, |f| {
                mvsnet::read_scene(f, f, Some(&f.join("pair.txt")), &mvsnet::Options::default()).is_ok()
            };
            nerfstudio_scene: fixture::nerfstudio, BASE, |f| nerfstudio::read_scene(f, None).is_ok();
            bundler_scene: fixture::bundler, BASE, |f| bundler::read_scene(&f.join("bundle.out"), None).is_ok();
            nvm_scene: fixture::nvm, BASE, |f| nvm::read_scene(&f.join("scene.nvm"), None).is_ok();
            openmvs_scene: fixture::openmvs, BASE, |f| openmvs::read_scene(&f.join("scene.mvs"), None).is_ok();
            pfm_map: fixture::pfm, BASE, |f| pfm::read_depth(&f.join("1.pfm")).is_ok();
            pfm_rgb: fixture::pfm, BASE, |f| pfm::read_rgb(&f.join("3.pfm")).is_ok();
            ply_binary: fixture::ply_binary, BASE, |f| ply::read(&f.join("cloud.ply")).is_ok();
            ply_with_lists: fixture::ply_with_lists, BASE, |f| ply::read(&f.join("cloud.ply")).is_ok();
            ply_ascii: fixture::ply_ascii, BASE, |f| ply::read(&f.join("cloud.ply")).is_ok();
            jpeg: fixture::jpeg, PICTURE, |f| readers::read_picture(&f.join("a.jpeg"));
            jpeg_reduced: fixture::jpeg, PICTURE, |f| readers::read_reduced(&f.join("a.jpeg"));
            png: fixture::png, PICTURE, |f| readers::read_picture(&f.join("a.png"));
            tiff: fixture::tiff, PICTURE, |f| readers::read_picture(&f.join("a.tiff"));
            bmp: fixture::bmp, PICTURE, |f| readers::read_picture(&f.join("a.bmp"));
            webp: fixture::webp, PICTURE, |f| readers::read_picture(&f.join("a.webp"));
            mask: fixture::png, PICTURE, |f| masks::load(&f.join("a.png"), fixture::SIZE).is_ok();
            depth_png: fixture::depth_png, PICTURE, |f| depth::read(&f.join("d.png"), 0.001).is_ok();
            dtu_mask: fixture::dtu, BASE, |f| dtu::read_mask(&f.join("mask.mat")).is_ok();
            dtu_mask_compressed: fixture::dtu_compressed, COMPRESSED, |f| dtu::read_mask(&f.join("mask.mat")).is_ok();
            dtu_plane: fixture::dtu, BASE, |f| dtu::read_plane(&f.join("plane.mat")).is_ok();
            tnt_volume: fixture::tnt, BASE, |f| tnt::read_volume(&f.join("volume.json")).is_ok();
            tnt_alignment: fixture::tnt, BASE, |f| tnt::read_alignment(&f.join("alignment.txt")).is_ok();
            visibility_predicted: fixture::visibility, PICTURE, |f| visibility::read_predicted(&f.join("v.png"), 2).is_ok();
            visibility_tiles: fixture::visibility, PICTURE, |f| {
                visibility::read(&f.join("v.png"), vamvs_core::Size::new(fixture::SIZE.width, fixture::SIZE.height / 2), 2).is_ok()
            };
        }
    };
}

/// Whether an image can be decoded at the smallest size there is, and its camera keeps the size in the header.
pub fn read_reduced(path: &Path) -> bool {
    let Ok(size) = image::stored_size(path) else { return false };
    let intrinsics = Intrinsics { fx: 9.0, fy: 9.0, cx: 4.0, cy: 3.0 };
    let camera = Camera { size, intrinsics, lens: Lens::None };
    image::load_for_camera(path, &camera, &|_| 1, None).is_ok_and(|(_, camera)| camera.size == size)
}

/// Whether an image can be decoded and has the size in its header.
pub fn read_picture(path: &Path) -> bool {
    let size = image::stored_size(path);
    image::load(path).is_ok_and(|image| size.is_ok_and(|size| size == image.rgb.size()))
}
