//! OpenMVS: the scene (`.mvs`) and depth maps (`.dmap`), as its releases 2.x read and write them.
//!
//! OpenMVS counts pixel centres from (0, 0), so half a pixel is taken off principal points on writing and
//! added on reading.

mod dmap;
mod scene;

pub use dmap::{DepthMapFile, write_depth_map};
pub use scene::{ObservedPoint, read_scene, write_scene};

use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Intrinsics, Pose};

/// K with pixel centres at whole numbers, row by row.
fn calibration(intrinsics: &Intrinsics) -> [f64; 9] {
    rows(&intrinsics.cropped(0.5, 0.5).matrix())
}

/// R and the camera's centre.
fn rotation_and_centre(cam_from_world: &Pose) -> ([f64; 9], [f64; 3]) {
    let centre: Vector3<f64> = cam_from_world.centre();
    (rows(&cam_from_world.rotation), centre.into())
}

fn rows(matrix: &Matrix3<f64>) -> [f64; 9] {
    std::array::from_fn(|i| matrix[(i / 3, i % 3)])
}

/// The bytes of numbers, little-endian.
fn f64_bytes(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// The bytes of numbers, little-endian.
fn f32_bytes<'a>(values: impl IntoIterator<Item = &'a f32>) -> Vec<u8> {
    values.into_iter().flat_map(|value| value.to_le_bytes()).collect()
}
