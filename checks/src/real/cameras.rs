//! The views of an output folder: camera, pose and photograph.

use std::path::Path;

use anyhow::{Context, Result};
use nalgebra::Vector3;
use vamvs_core::{Grid, Pinhole, Pose, Rgb};
use vamvs_io::{image, mvsnet};

/// A photograph without distortion, as a run works with it.
pub struct Shot {
    pub name: String,
    pub camera: Pinhole,
    pub cam_from_world: Pose,
    pub photo: Grid<Rgb>,
}

impl Shot {
    /// The pixel that shows a point of the world, and the point's depth; `None` outside of the photograph.
    pub fn pixel_of(&self, x_in_world: &[f64; 3]) -> Option<((usize, usize), f64)> {
        let x_in_cam = self.cam_from_world.transform(&Vector3::from(*x_in_world));
        let pixel = self.camera.project_inside(&x_in_cam)?;
        Some(((pixel.x as usize, pixel.y as usize), x_in_cam.z))
    }
}

/// The views of the output folder `out` by name.
pub fn read(out: &Path) -> Result<Vec<Shot>> {
    names(out)?.into_iter().map(|name| read_one(out, name)).collect()
}

/// The view `name` of the output folder `out`.
pub fn read_one(out: &Path, name: String) -> Result<Shot> {
    let photo = image::load_rgb(&out.join("images").join(format!("{name}.png")))?;
    let cam = out.join("cams").join(format!("{name}_cam.txt"));
    let mvsnet::Cam { intrinsics, cam_from_world, .. } = mvsnet::read_cam(&cam, &mvsnet::Options::default())?;
    Ok(Shot { camera: Pinhole { size: photo.size(), intrinsics }, cam_from_world, photo, name })
}

/// The names of the views that have a depth map in the output folder `out`, sorted.
pub fn names(out: &Path) -> Result<Vec<String>> {
    let folder = out.join("depths");
    let entries =
        std::fs::read_dir(&folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let files = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = files.filter_map(|file| file.strip_suffix(".pfm").map(str::to_owned)).collect();
    names.sort();
    Ok(names)
}
