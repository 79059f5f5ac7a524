//! Rendered views as a folder in MVSNet's layout.

use std::path::Path;

use vamvs_core::DepthRange;
use vamvs_io::{IoError, image, mvsnet};

use crate::Rendered;

/// Writes `images/NAME.png` and `cams/NAME_cam.txt` for each view; NAME is `name(i)` for view `i`. The camera
/// file holds the depth range of [`depth_range`], widened by the factor `wider`. No `pair.txt` is written, so
/// that its reader selects the source views.
///
/// # Errors
/// If a file cannot be written.
pub fn write_mvsnet(
    folder: &Path,
    views: &[Rendered],
    name: impl Fn(usize) -> String,
    wider: f64,
) -> Result<(), IoError> {
    for sub in ["images", "cams"].map(|sub| folder.join(sub)) {
        let make = |source| IoError::System { action: "make the folder", path: sub.clone(), source };
        std::fs::create_dir_all(&sub).map_err(make)?;
    }
    for (index, view) in views.iter().enumerate() {
        let (name, photo) = (name(index), &view.photo);
        image::save_png_rgb(&folder.join(format!("images/{name}.png")), &photo.image)?;
        let cam = folder.join(format!("cams/{name}_cam.txt"));
        mvsnet::write_cam(&cam, &photo.camera, &photo.cam_from_world, depth_range(view, wider))?;
    }
    Ok(())
}

/// The view's true depth range: the nearest depth divided by `wider`, the farthest multiplied by it. `None` if
/// no pixel shows a surface.
#[must_use]
pub fn depth_range(view: &Rendered, wider: f64) -> Option<DepthRange> {
    let seen = || view.depth.data().iter().copied().filter(|depth| *depth > 0.0).map(f64::from);
    let (near, far) = (seen().reduce(f64::min)?, seen().reduce(f64::max)?);
    DepthRange::try_new(near / wider, far * wider).ok()
}
