//! Small, undamaged files for every reader.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageFormat, RgbaImage};
use nalgebra::{Vector2, Vector3};
use serde_json::json;
use vamvs_core::{
    Camera, CloudPoint, DepthRange, Grid, Intrinsics, Lens, Pinhole, Pose, Size, Source, Visibility,
};
use vamvs_io::colmap::{Image, Model, Observation, Point, dense};
use vamvs_io::ply::{Coordinates, PlyWriter};
use vamvs_io::{
    depth, image as pictures, mvsnet as mvsnet_files, openmvs as openmvs_files, pfm as pfm_files,
    visibility as tiles,
};

use crate::mat_file;

/// The size of all images and maps.
pub const SIZE: Size = Size::new(8, 6);

/// The files that were written into a folder.
pub struct Fixture {
    /// The names of the files to damage, one at a time.
    pub damaged: Vec<&'static str>,
    /// Size of all files in bytes.
    pub bytes: usize,
}

impl Fixture {
    fn new(folder: &Path, damaged: &[&'static str]) -> Self {
        let length = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().metadata().unwrap().len();
        let bytes: u64 = std::fs::read_dir(folder).unwrap().map(length).sum();
        Self { damaged: damaged.to_vec(), bytes: bytes as usize }
    }
}

fn text(folder: &Path, name: &str, text: &str) {
    super::write(&folder.join(name), text.as_bytes());
}

fn photographs(folder: &Path) {
    for name in ["a.png", "b.png"] {
        pictures::save_png_rgb(&folder.join(name), &Grid::filled(SIZE, [1, 2, 3])).unwrap();
    }
}

fn pose(x: f64) -> Pose {
    Pose::look_at(&Vector3::new(x, 0.5, -3.0), &Vector3::zeros(), &Vector3::y())
}

fn pinhole() -> Pinhole {
    Pinhole { size: SIZE, intrinsics: Intrinsics { fx: 9.0, fy: 9.0, cx: 4.0, cy: 3.0 } }
}

fn model() -> Model {
    let lens = Lens::Rational { k: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
    let observation = Observation { pixel: Vector2::new(4.0, 3.0), point_id: Some(7) };
    let image = |id: u32, name: &str| Image {
        id,
        name: name.to_owned(),
        camera_id: id,
        cam_from_world: pose(f64::from(id)),
        observations: vec![observation, Observation { point_id: None, ..observation }],
    };
    let point = Point {
        id: 7,
        x_in_world: Vector3::zeros(),
        rgb: [1, 2, 3],
        error: 0.5,
        track: vec![(1, 0), (2, 0)],
    };
    let cameras = [(1, pinhole().into()), (2, Camera { lens, ..pinhole().into() })];
    Model {
        cameras: cameras.into(),
        images: vec![image(1, "a.png"), image(2, "b.png")],
        broken: Vec::new(),
        points: vec![point],
    }
}

pub fn colmap_text(folder: &Path) -> Fixture {
    photographs(folder);
    model().write_text(folder).unwrap();
    Fixture::new(folder, &["cameras.txt", "images.txt", "points3D.txt"])
}

pub fn colmap_binary(folder: &Path) -> Fixture {
    photographs(folder);
    model().write_binary(folder).unwrap();
    Fixture::new(folder, &["cameras.bin", "images.bin", "points3D.bin"])
}

pub fn colmap_maps(folder: &Path) -> Fixture {
    dense::write_depth_map(&folder.join("d.bin"), &Grid::filled(SIZE, 2.5)).unwrap();
    dense::write_normal_map(&folder.join("n.bin"), &Grid::filled(SIZE, [0.0, 0.0, -1.0])).unwrap();
    Fixture::new(folder, &["d.bin", "n.bin"])
}

pub fn mvsnet(folder: &Path) -> Fixture {
    photographs(folder);
    let range = DepthRange::try_new(1.0, 9.0).ok();
    for (x, name) in [(0.0, "a_cam.txt"), (1.0, "b_cam.txt")] {
        mvsnet_files::write_cam(&folder.join(name), &pinhole(), &pose(x), range).unwrap();
    }
    mvsnet_files::write_pairs(
        &folder.join("pair.txt"),
        &[0, 1],
        &[1, 0].map(|view| vec![Source { view, score: 1.0 }]),
    )
    .unwrap();
    Fixture::new(folder, &["a_cam.txt", "pair.txt"])
}

pub fn nerfstudio(folder: &Path) -> Fixture {
    photographs(folder);
    cloud(&folder.join("sparse.ply"));
    let matrix = json!([[1, 0, 0, 0.5], [0, 1, 0, 2], [0, 0, 1, -3], [0, 0, 0, 1]]);
    let frame =
        |name: &str| json!({"file_path": name, "transform_matrix": matrix, "mask_path": "a.png", "k1": 0.1});
    let transforms = json!({
        "camera_model": "OPENCV", "fl_x": 10.0, "cx": 4.0, "w": 8, "h": 6, "camera_angle_y": 0.8,
        "ply_file_path": "sparse.ply", "frames": [frame("a.png"), frame("./b")],
    });
    text(folder, "transforms.json", &transforms.to_string());
    Fixture::new(folder, &["transforms.json"])
}

pub fn bundler(folder: &Path) -> Fixture {
    photographs(folder);
    text(folder, "list.txt", "a.png 0 12\nb.png\n");
    let camera = "12 0.03 -0.01\n1 0 0\n0 1 0\n0 0 1\n0.5 0 -3\n";
    let point = "0 0 0\n255 0 0\n2 0 1 0.5 0.5 1 2 0 0\n";
    text(folder, "bundle.out", &format!("# Bundle file v0.3\n2 2\n{camera}{camera}{point}{point}"));
    Fixture::new(folder, &["bundle.out", "list.txt"])
}

pub fn nvm(folder: &Path) -> Fixture {
    photographs(folder);
    let camera = "12 1 0 0 0 0.5 0 -3 0.04 0";
    let point = "0 0 0 255 0 0 2 0 1 0.5 0.5 1 2 0 0";
    let cameras = format!("2\na.png\t{camera}\nb.png\t{camera}\n");
    text(folder, "scene.nvm", &format!("NVM_V3 FixedK 12 4 12 3\n\n{cameras}\n2\n{point}\n{point}\n0\n"));
    Fixture::new(folder, &["scene.nvm"])
}

pub fn openmvs(folder: &Path) -> Fixture {
    photographs(folder);
    let views = [(0.0, "a.png"), (1.0, "b.png")].map(|(x, name)| (name.to_owned(), pinhole(), pose(x)));
    openmvs_files::write_scene(&folder.join("scene.mvs"), &views, &[(point(), vec![0, 1])]).unwrap();
    Fixture::new(folder, &["scene.mvs"])
}

pub fn pfm(folder: &Path) -> Fixture {
    pfm_files::write(&folder.join("1.pfm"), &Grid::filled(SIZE, 2.5)).unwrap();
    pfm_files::write_rgb(&folder.join("3.pfm"), &Grid::filled(SIZE, [0.5; 3])).unwrap();
    Fixture::new(folder, &["1.pfm", "3.pfm"])
}

fn point() -> CloudPoint {
    CloudPoint {
        x_in_world: [1.0; 3],
        normal: [0.0, 0.0, 1.0],
        colour: [1, 2, 3],
        confidence: 0.5,
        sigma: 0.0,
        views: 3,
    }
}

fn cloud(path: &Path) {
    vamvs_io::ply::write(path, &[point(), point(), point()]).unwrap();
}

pub fn ply_binary(folder: &Path) -> Fixture {
    cloud(&folder.join("cloud.ply"));
    Fixture::new(folder, &["cloud.ply"])
}

pub fn ply_with_lists(folder: &Path) -> Fixture {
    let mut writer = PlyWriter::create_with_views(&folder.join("cloud.ply"), Coordinates::Double).unwrap();
    (0..3).for_each(|_| writer.push_seen(&point(), &[0, 5]).unwrap());
    writer.finish().unwrap();
    Fixture::new(folder, &["cloud.ply"])
}

pub fn ply_ascii(folder: &Path) -> Fixture {
    let header = "ply\nformat ascii 1.0\nelement face 1\nproperty list uint int corners\nelement vertex 2\nproperty float x\nproperty double y\nproperty int z\nproperty uchar red\nend_header\n";
    text(folder, "cloud.ply", &format!("{header}3 0 1 2\n1 2.5 3 255\n4 5 6 0\n"));
    Fixture::new(folder, &["cloud.ply"])
}

/// A colour image in which some pixels are transparent, if the format has alpha.
fn picture(folder: &Path, name: &'static str, format: ImageFormat) -> Fixture {
    let pixel = |x: u32, y: u32| image::Rgba([20 * x as u8, 30 * y as u8, 7, if x < 3 { 0 } else { 255 }]);
    let rgba = DynamicImage::ImageRgba8(RgbaImage::from_fn(8, 6, pixel));
    let picture = if format == ImageFormat::Jpeg { rgba.to_rgb8().into() } else { rgba };
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).unwrap();
    super::write(&folder.join(name), bytes.get_ref());
    Fixture::new(folder, &[name])
}

pub fn jpeg(folder: &Path) -> Fixture {
    picture(folder, "a.jpeg", ImageFormat::Jpeg)
}

pub fn png(folder: &Path) -> Fixture {
    picture(folder, "a.png", ImageFormat::Png)
}

pub fn tiff(folder: &Path) -> Fixture {
    picture(folder, "a.tiff", ImageFormat::Tiff)
}

pub fn bmp(folder: &Path) -> Fixture {
    picture(folder, "a.bmp", ImageFormat::Bmp)
}

pub fn webp(folder: &Path) -> Fixture {
    picture(folder, "a.webp", ImageFormat::WebP)
}

pub fn depth_png(folder: &Path) -> Fixture {
    depth::write(&folder.join("d.png"), &Grid::filled(SIZE, 2.5), 0.001).unwrap();
    Fixture::new(folder, &["d.png"])
}

pub fn visibility(folder: &Path) -> Fixture {
    let tile = Grid::filled(Size::new(SIZE.width, SIZE.height / 2), Visibility::Visible);
    tiles::write(&folder.join("v.png"), &[tile.clone(), tile]).unwrap();
    Fixture::new(folder, &["v.png"])
}

fn mask(folder: &Path, content: &[Vec<u8>]) -> Fixture {
    super::write(&folder.join("mask.mat"), &mat_file::mat_file(content));
    let plane = mat_file::variable("P", 6, &[4, 1], &mat_file::doubles(&[0.1, 0.2, 1.0, -650.0]));
    super::write(&folder.join("plane.mat"), &mat_file::mat_file(&[plane]));
    Fixture::new(folder, &["mask.mat", "plane.mat"])
}

pub fn dtu(folder: &Path) -> Fixture {
    mask(folder, &mat_file::mask_variables())
}

pub fn dtu_compressed(folder: &Path) -> Fixture {
    let compressed: Vec<Vec<u8>> =
        mat_file::mask_variables().iter().map(|variable| mat_file::compressed(variable)).collect();
    mask(folder, &compressed)
}

pub fn tnt(folder: &Path) -> Fixture {
    let polygon = json!([[0, 0, 9], [4, 0, 9], [4, 0, 2], [0, 0, 2]]);
    let volume = json!({
        "axis_max": 3.5, "axis_min": -1.25, "bounding_polygon": polygon, "class_name": "SelectionPolygonVolume",
        "orthogonal_axis": "Y", "version_major": 1, "version_minor": 0,
    });
    text(folder, "volume.json", &volume.to_string());
    text(folder, "alignment.txt", "2 0 0 1\n0 2 0 2\n0 0 2 3\n0 0 0 1\n");
    Fixture::new(folder, &["volume.json", "alignment.txt"])
}
