//! Cameras around a scene.

use nalgebra::Vector3;
use vamvs_core::{Intrinsics, Pinhole, Pose, Size};

/// The world point that all cameras look at.
pub const TARGET: Vector3<f64> = Vector3::new(0.0, 0.0, 0.45);
/// Distance of the cameras from the target, metres.
pub const DISTANCE: f64 = 4.0;

/// A camera and its pose `cam_from_world`.
pub type Station = (Pinhole, Pose);

/// `views` cameras on an arc in front of the scene, from left to right, at most 8° apart. Their elevation
/// alternates between 26° and 30°.
#[must_use]
pub fn arc(views: usize, size: Size) -> Vec<Station> {
    let step = (64.0 / views.saturating_sub(1).max(1) as f64).min(8.0);
    let azimuth = |i: usize| step * (i as f64 - 0.5 * views.saturating_sub(1) as f64);
    (0..views).map(|i| station(azimuth(i), 26.0 + 4.0 * (i % 2) as f64, size)).collect()
}

/// The camera at `azimuth` and `elevation`, degrees. Azimuth 0 is in the direction of −y from the target and
/// grows towards +x.
fn station(azimuth: f64, elevation: f64, size: Size) -> Station {
    let (sin_a, cos_a) = azimuth.to_radians().sin_cos();
    let (sin_e, cos_e) = elevation.to_radians().sin_cos();
    let eye = TARGET + DISTANCE * Vector3::new(sin_a * cos_e, -cos_a * cos_e, sin_e);
    (pinhole(size), Pose::look_at(&eye, &TARGET, &Vector3::z()))
}

/// A camera with a field of view of 48° across its longer side.
fn pinhole(size: Size) -> Pinhole {
    let (width, height) = (size.width as f64, size.height as f64);
    let focal = 1.12 * width.max(height);
    Pinhole { size, intrinsics: Intrinsics { fx: focal, fy: focal, cx: 0.5 * width, cy: 0.5 * height } }
}
