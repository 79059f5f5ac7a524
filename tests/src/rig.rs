//! Cameras around a scene.

use nalgebra::Vector3;
use vamvs_core::{Intrinsics, Pinhole, Pose, Size};

/// What the cameras look at.
pub const TARGET: Vector3<f64> = Vector3::new(0.0, 0.0, 0.45);
/// Distance of the cameras from the target.
pub const DISTANCE: f64 = 4.0;

/// A camera and its pose `cam_from_world`.
pub type Station = (Pinhole, Pose);

/// `views` cameras from left to right before the scene, 8° or less apart, in turn a little higher
/// and lower.
#[must_use]
pub fn arc(views: usize, size: Size) -> Vec<Station> {
    let step = (64.0 / views.saturating_sub(1).max(1) as f64).min(8.0);
    let azimuth = |i: usize| step * (i as f64 - 0.5 * views.saturating_sub(1) as f64);
    (0..views).map(|i| station(azimuth(i), 26.0 + 4.0 * (i % 2) as f64, size)).collect()
}

/// The camera at `azimuth` (0 is at −y, to the right positive) and `elevation`, degrees.
fn station(azimuth: f64, elevation: f64, size: Size) -> Station {
    let (sin_a, cos_a) = azimuth.to_radians().sin_cos();
    let (sin_e, cos_e) = elevation.to_radians().sin_cos();
    let eye = TARGET + DISTANCE * Vector3::new(sin_a * cos_e, -cos_a * cos_e, sin_e);
    (pinhole(size), Pose::look_at(&eye, &TARGET, &Vector3::z()))
}

/// A camera that sees ±24° across its longer side.
fn pinhole(size: Size) -> Pinhole {
    let (width, height) = (size.width as f64, size.height as f64);
    let focal = 1.12 * width.max(height);
    Pinhole { size, intrinsics: Intrinsics { fx: focal, fy: focal, cx: 0.5 * width, cy: 0.5 * height } }
}
