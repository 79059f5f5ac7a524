//! Writes depth maps `.dmap`. Such a file has `DR`, flags of its content, the sizes of image and depth map, and the
//! depth range; the image's name and the views; K, R and the camera's centre as float64; then depth, normals
//! and confidence as float32, row by row.

use std::io::{self, Write};
use std::path::Path;

use vamvs_core::{DepthMap, Grid, depth_map};

use super::{calibration, f32_bytes, f64_bytes, rotation_and_centre};
use crate::{IoError, atomic};

/// Flags of the content: depth (1), normals (2) and confidence (4), but not the views of each pixel (8).
const CONTENT: u8 = 1 | 2 | 4;

/// The content of a depth map's file. The image must have the depth map's size.
#[derive(Clone, Copy, Debug)]
pub struct DepthMapFile<'a> {
    /// Depth and confidence, with their camera.
    pub map: &'a DepthMap,
    /// Normals in the camera's frame; 0 where there is no depth.
    pub normals: &'a Grid<[f32; 3]>,
    /// The image file's path relative to the depth map's folder.
    pub image: &'a str,
    /// The number of the reference view in the scene, then those of its source views.
    pub views: &'a [u32],
}

/// Writes a depth map.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write_depth_map(path: &Path, file: &DepthMapFile) -> Result<(), IoError> {
    let DepthMap { camera, cam_from_world, depth, confidence, .. } = file.map;
    let (rotation, centre) = rotation_and_centre(cam_from_world);
    atomic::write(path, |out| {
        write_header(out, file)?;
        out.write_all(&f64_bytes(&calibration(&camera.intrinsics)))?;
        out.write_all(&f64_bytes(&rotation))?;
        out.write_all(&f64_bytes(&centre))?;
        out.write_all(&f32_bytes(depth.data()))?;
        out.write_all(&f32_bytes(file.normals.data().as_flattened()))?;
        out.write_all(&f32_bytes(confidence.data()))
    })
}

fn write_header(out: &mut dyn Write, file: &DepthMapFile) -> io::Result<()> {
    let depth = &file.map.depth;
    let [width, height] = [depth.width(), depth.height()].map(|side| (side as u32).to_le_bytes());
    out.write_all(&[b'D', b'R', CONTENT, 0])?;
    out.write_all(&[width, height, width, height].concat())?;
    let valid = || depth.data().iter().copied().filter(|&depth| depth_map::is_valid(depth));
    let (near, far) = (valid().reduce(f32::min), valid().reduce(f32::max));
    out.write_all(&f32_bytes(&[near.unwrap_or(0.0), far.unwrap_or(0.0)]))?;
    out.write_all(&(file.image.len() as u16).to_le_bytes())?;
    out.write_all(file.image.as_bytes())?;
    out.write_all(&(file.views.len() as u32).to_le_bytes())?;
    file.views.iter().try_for_each(|view| out.write_all(&view.to_le_bytes()))
}
