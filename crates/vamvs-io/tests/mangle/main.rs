//! Every reader on damaged files: an answer or an error, no panic, and no more memory than the file's size
//! warrants.
//!
//! The default suite tries each reader a few hundred times. For a campaign of ten minutes a reader, or of
//! so many as the variable `VAMVS_MANGLE_MINUTES` says:
//! `cargo test --release -p vamvs-io --test mangle -- --ignored`, with the name of a reader at will.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod damage;
mod fixture;
#[path = "../mat_file/mod.rs"]
mod mat_file;
mod memory;

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use proptest::test_runner::{Config, TestCaseError, TestRunner};
use vamvs_core::Size;
use vamvs_io::{
    IoError, Loaded, atomic, bundler, colmap, depth, dtu, image, masks, mvsnet, nerfstudio, nvm, openmvs,
    pfm, ply, tnt, visibility,
};

use fixture::{Fixture, SIZE};

/// Damaged files a reader is tried with in the default suite.
const CASES: u32 = 200;

/// Bytes that a reader may take for each byte of its files. A list in JSON takes two bytes there, and a
/// hundred in memory.
const FACTOR: usize = 256;

/// Bytes that a reader may take in any case: buffers, lists of files.
const BASE: usize = 4 << 20;

/// Bytes that a picture may take: what it announces, up to `image`'s limit, twice while it is converted.
const PICTURE: usize = 4 << 30;

/// Bytes that a compressed file may take: what it says that it unpacks to.
const COMPRESSED: usize = 1 << 30;

/// A reader: what it reads of a folder, whether that succeeded, and the most memory that it may take
/// however small the files are.
struct Reader {
    name: &'static str,
    fixture: fn(&Path) -> Fixture,
    read: fn(&Path) -> bool,
    base: usize,
}

impl Reader {
    /// Tries `cases` damaged files.
    fn mangle(&self, cases: u32) {
        let folder = tempfile::tempdir().unwrap();
        let files = (self.fixture)(folder.path());
        assert!((self.read)(folder.path()), "{}: the undamaged files are read", self.name);
        let config = Config { cases, failure_persistence: None, ..Config::default() };
        let outcome = TestRunner::new(config).run(&damage::some_damage(), |(which, damages)| {
            let name = which.get(&files.damaged);
            let path = folder.path().join(name);
            let good = fs::read(&path).unwrap();
            let bad = damages.iter().fold(good.clone(), |bytes, damage| damage.apply(bytes));
            write(&path, &bad);
            let taken = memory::peak_of(|| (self.read)(folder.path()));
            write(&path, &good);
            let limit = self.base + FACTOR * (files.bytes + bad.len());
            if taken > limit {
                let problem = format!("{name} of {} bytes took {taken} bytes of memory", bad.len());
                return Err(TestCaseError::fail(problem));
            }
            Ok(())
        });
        outcome.unwrap_or_else(|error| panic!("{}: {error}", self.name));
    }

    /// Goes on for the minutes of a campaign.
    fn campaign(&self) {
        let minutes = std::env::var("VAMVS_MANGLE_MINUTES").map_or(10.0, |text| text.parse().unwrap());
        let end = Instant::now() + Duration::from_secs_f64(60.0 * minutes);
        let mut rounds = 0_u32;
        while Instant::now() < end {
            self.mangle(2000);
            rounds += 1;
        }
        println!("{}: {} damaged files", self.name, 2000 * rounds);
    }
}

fn write(path: &Path, bytes: &[u8]) {
    atomic::write(path, |out| out.write_all(bytes)).unwrap();
}

/// A test of each reader, and a campaign of the same name.
macro_rules! readers {
    ($($name:ident: $fixture:expr, $base:expr, $read:expr;)*) => {
        $(
            #[test]
            fn $name() {
                let read: fn(&Path) -> bool = $read;
                Reader { name: stringify!($name), fixture: $fixture, read, base: $base }.mangle(CASES);
            }
        )*

        mod campaign {
            use super::*;
            $(
                #[test]
                #[ignore = "takes ten minutes"]
                fn $name() {
                    let read: fn(&Path) -> bool = $read;
                    Reader { name: stringify!($name), fixture: $fixture, read, base: $base }.campaign();
                }
            )*
        }
    };
}

readers! {
    colmap_text: fixture::colmap_text, BASE, |f| colmap::read_scene(f, f).is_ok();
    colmap_binary: fixture::colmap_binary, BASE, |f| colmap::read_scene(f, f).is_ok();
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
    jpeg: fixture::jpeg, PICTURE, |f| read_picture(&f.join("a.jpeg"));
    png: fixture::png, PICTURE, |f| read_picture(&f.join("a.png"));
    tiff: fixture::tiff, PICTURE, |f| read_picture(&f.join("a.tiff"));
    bmp: fixture::bmp, PICTURE, |f| read_picture(&f.join("a.bmp"));
    webp: fixture::webp, PICTURE, |f| read_picture(&f.join("a.webp"));
    mask: fixture::png, PICTURE, |f| masks::load(&f.join("a.png"), SIZE).is_ok();
    depth_png: fixture::depth_png, PICTURE, |f| depth::read(&f.join("d.png"), 0.001).is_ok();
    dtu_mask: fixture::dtu, BASE, |f| dtu::read_mask(&f.join("mask.mat")).is_ok();
    dtu_mask_compressed: fixture::dtu_compressed, COMPRESSED, |f| dtu::read_mask(&f.join("mask.mat")).is_ok();
    dtu_plane: fixture::dtu, BASE, |f| dtu::read_plane(&f.join("plane.mat")).is_ok();
    tnt_volume: fixture::tnt, BASE, |f| tnt::read_volume(&f.join("volume.json")).is_ok();
    tnt_alignment: fixture::tnt, BASE, |f| tnt::read_alignment(&f.join("alignment.txt")).is_ok();
    visibility_tiles: fixture::visibility, PICTURE, |f| {
        visibility::read(&f.join("v.png"), Size::new(SIZE.width, SIZE.height / 2), 2).is_ok()
    };
}

/// In every layout a photograph without a header is one bad view, which is told when it is decoded.
#[test]
fn a_photograph_without_header_does_not_end_a_scene() {
    type Read = fn(&Path) -> Result<Loaded, IoError>;
    let layouts: [(fn(&Path) -> Fixture, Read); 6] = [
        (fixture::colmap_text, |f| colmap::read_scene(f, f)),
        (fixture::mvsnet, |f| mvsnet::read_scene(f, f, None, &mvsnet::Options::default())),
        (fixture::nerfstudio, |f| nerfstudio::read_scene(f, None)),
        (fixture::bundler, |f| bundler::read_scene(&f.join("bundle.out"), None)),
        (fixture::nvm, |f| nvm::read_scene(&f.join("scene.nvm"), None)),
        (fixture::openmvs, |f| openmvs::read_scene(&f.join("scene.mvs"), None)),
    ];
    for (fixture, read) in layouts {
        let folder = tempfile::tempdir().unwrap();
        fixture(folder.path());
        let whole = read(folder.path()).unwrap();
        for damaged in [&b""[..], b"no image"] {
            write(&folder.path().join("b.png"), damaged);
            let loaded = read(folder.path()).unwrap();
            assert_eq!(loaded.scene, whole.scene);
            let [a, b] = &loaded.scene.views[..] else { panic!("two views") };
            assert!(image::load_for_camera(&loaded.images.join(&a.name), &a.camera).is_ok());
            let error = image::load_for_camera(&loaded.images.join(&b.name), &b.camera).unwrap_err();
            assert!(error.to_string().contains("b.png"), "{error}");
        }
    }
}

fn read_picture(path: &Path) -> bool {
    let size = image::stored_size(path);
    image::load(path).is_ok_and(|image| size.is_ok_and(|size| size == image.rgb.size()))
}
