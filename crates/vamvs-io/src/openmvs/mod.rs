//! OpenMVS: the scene (`.mvs`, read and written) and depth maps (`.dmap`, written), as in its releases 2.x.
//!
//! In OpenMVS the first pixel's centre is at (0, 0), so half a pixel is subtracted from principal points on
//! writing and added on reading.

mod dmap;
mod scene;

pub use dmap::{DepthMapFile, write_depth_map};
pub use scene::{ObservedPoint, read_scene, write_scene};

use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Intrinsics, Pose};

/// K for pixel centres at whole numbers, row by row.
fn calibration(intrinsics: &Intrinsics) -> [f64; 9] {
    rows(&intrinsics.cropped(0.5, 0.5).matrix())
}

/// R, row by row, and the camera's centre in the world.
fn rotation_and_centre(cam_from_world: &Pose) -> ([f64; 9], [f64; 3]) {
    let centre: Vector3<f64> = cam_from_world.centre();
    (rows(&cam_from_world.rotation), centre.into())
}

fn rows(matrix: &Matrix3<f64>) -> [f64; 9] {
    std::array::from_fn(|i| matrix[(i / 3, i % 3)])
}

/// The little-endian bytes of `values`.
fn f64_bytes(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// The little-endian bytes of `values`.
fn f32_bytes<'a>(values: impl IntoIterator<Item = &'a f32>) -> Vec<u8> {
    values.into_iter().flat_map(|value| value.to_le_bytes()).collect()
}
