//! Rendered views as a folder in MVSNet's layout.

use std::path::Path;

use vamvs_core::DepthRange;
use vamvs_io::{IoError, image, mvsnet};

use crate::Rendered;

/// Writes `images/0000.png …` and `cams/0000_cam.txt …`, with each view's depth range a little wider
/// than the truth if `ranges`, and without depth line otherwise.
///
/// # Errors
/// If a file cannot be written.
pub fn write_mvsnet(folder: &Path, views: &[Rendered], ranges: bool) -> Result<(), IoError> {
    for sub in ["images", "cams"].map(|sub| folder.join(sub)) {
        let make = |source| IoError::System { action: "make the folder", path: sub.clone(), source };
        std::fs::create_dir_all(&sub).map_err(make)?;
    }
    for (index, view) in views.iter().enumerate() {
        image::save_png_rgb(&folder.join(format!("images/{index:04}.png")), &view.photo.image)?;
        let cam = folder.join(format!("cams/{index:04}_cam.txt"));
        let range = if ranges { depth_range(view) } else { None };
        mvsnet::write_cam(&cam, &view.photo.camera, &view.photo.cam_from_world, range)?;
    }
    Ok(())
}

/// The view's true depth range, 5 % wider at both ends; `None` if it sees nothing or one depth only.
#[must_use]
pub fn depth_range(view: &Rendered) -> Option<DepthRange> {
    let seen = || view.depth.data().iter().copied().filter(|depth| *depth > 0.0).map(f64::from);
    let (near, far) = (seen().reduce(f64::min)?, seen().reduce(f64::max)?);
    DepthRange::try_new(0.95 * near, 1.05 * far).ok()
}
