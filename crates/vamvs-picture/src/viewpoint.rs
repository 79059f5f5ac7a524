//! Where to look at a cloud from.

use std::path::Path;

use nalgebra::{Rotation3, Unit, Vector3};
use vamvs_core::{CloudPoint, Intrinsics, Pinhole, Pose, Size};
use vamvs_io::{IoError, mvsnet};

/// Half the field of view across the longer side of a picture, as a tangent: 20°.
const HALF_VIEW: f64 = 0.364;

/// Number of points that are sampled to find a viewpoint.
const SAMPLES: usize = 20_000;

/// Number of directions that are tried.
const DIRECTIONS: usize = 600;

/// The share of points that may be outside on each side of a picture: outliers.
const OUTSIDE: f64 = 0.006;

/// A camera before a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The camera.
    pub camera: Pinhole,
    /// Its pose.
    pub cam_from_world: Pose,
}

impl Viewpoint {
    /// The view from the direction `to_eye` (world, any length) that shows the whole cloud except
    /// outliers. `up` points up in the picture, unless it is nearly parallel to `to_eye`.
    #[must_use]
    pub fn from_direction(
        cloud: &[CloudPoint],
        to_eye: &Vector3<f64>,
        up: &Vector3<f64>,
        size: Size,
    ) -> Self {
        let to_eye = to_eye.normalize();
        let up = if to_eye.cross(&up.normalize()).norm() > 0.05 { *up } else { perpendicular(&to_eye) };
        let turned = Pose::look_at(&to_eye, &Vector3::zeros(), &up).rotation;
        let points: Vec<_> = sample(cloud).map(|point| turned * Vector3::from(point.x_in_world)).collect();
        let middle = |axis: usize| {
            let mut values: Vec<_> = points.iter().map(|point| point[axis]).collect();
            0.5 * (quantile(&mut values, OUTSIDE) + quantile(&mut values, 1.0 - OUTSIDE))
        };
        let centre = Vector3::new(middle(0), middle(1), middle(2));
        let camera = pinhole(size);
        let distance = distance(&points, &centre, &camera);
        let eye = turned.transpose() * (centre - Vector3::new(0.0, 0.0, distance));
        Self { camera, cam_from_world: Pose { rotation: turned, translation: -(turned * eye) } }
    }
}

/// The direction from which most of the cloud's surface is seen, not from below and not from right
/// above. Normals point to the cameras, so this is about where those were.
#[must_use]
pub fn best_direction(cloud: &[CloudPoint], up: &Vector3<f64>) -> Vector3<f64> {
    let up = up.normalize();
    let normals: Vec<_> = sample(cloud).map(|point| Vector3::from(point.normal).cast::<f64>()).collect();
    let seen = |direction: &Vector3<f64>| normals.iter().map(|n| n.dot(direction).max(0.0)).sum::<f64>();
    let candidates = sphere(DIRECTIONS).filter(|direction| (-0.1..0.8).contains(&direction.dot(&up)));
    let best = candidates.map(|direction| (seen(&direction), direction)).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(perpendicular(&up), |(_, direction)| direction)
}

/// `direction` after a walk around the cloud, `angle` degrees to the right.
#[must_use]
pub fn around(direction: &Vector3<f64>, up: &Vector3<f64>, angle: f64) -> Vector3<f64> {
    Rotation3::from_axis_angle(&Unit::new_normalize(*up), angle.to_radians()) * direction
}

/// Up in the world: the mean up direction of the cameras in a folder of `NAME_cam.txt` files;
/// `None` if there are none.
///
/// # Errors
/// If a camera file cannot be read.
pub fn up_of_cameras(cams: &Path) -> Result<Option<Vector3<f64>>, IoError> {
    let Ok(entries) = std::fs::read_dir(cams) else { return Ok(None) };
    let mut up = Vector3::zeros();
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.to_string_lossy().ends_with("_cam.txt") {
            let cam = mvsnet::read_cam(&path, &mvsnet::Options::default())?;
            up -= cam.cam_from_world.rotation.row(1).transpose();
        }
    }
    Ok(up.try_normalize(1e-6))
}

/// How far from `centre` the camera must be to have the points in its picture.
fn distance(points: &[Vector3<f64>], centre: &Vector3<f64>, camera: &Pinhole) -> f64 {
    let (focal, size) = (camera.intrinsics.fx, camera.size);
    let half = |side: usize| 0.95 * 0.5 * side as f64 / focal;
    let (half_x, half_y) = (half(size.width), half(size.height));
    let needed = |point: &Vector3<f64>| {
        let from = point - centre;
        (from.x.abs() / half_x).max(from.y.abs() / half_y) - from.z
    };
    quantile(&mut points.iter().map(needed).collect::<Vec<_>>(), 1.0 - OUTSIDE).max(1e-9)
}

fn pinhole(size: Size) -> Pinhole {
    let (width, height) = (size.width as f64, size.height as f64);
    let focal = 0.5 * width.max(height) / HALF_VIEW;
    Pinhole { size, intrinsics: Intrinsics { fx: focal, fy: focal, cx: 0.5 * width, cy: 0.5 * height } }
}

/// Some of the points, evenly from the whole.
fn sample(cloud: &[CloudPoint]) -> impl Iterator<Item = &CloudPoint> {
    cloud.iter().step_by(cloud.len().div_ceil(SAMPLES).max(1))
}

/// Directions evenly over the sphere (a Fibonacci spiral).
fn sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (sin, cos) = (golden_angle * i as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * cos, radius * sin, z)
    })
}

/// A direction at right angles to `direction`.
fn perpendicular(direction: &Vector3<f64>) -> Vector3<f64> {
    let axis = Vector3::ith(direction.iamin(), 1.0);
    direction.cross(&axis).normalize()
}

/// The value below which a share of the values lies; 0 without values.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get((share * values.len().saturating_sub(1) as f64).round() as usize).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of side 2 about `centre`, at right angles to z and facing along it.
    fn square(centre: [f64; 3]) -> Vec<CloudPoint> {
        let place = |i: usize| f64::from(i as u32) / 20.0 - 1.0;
        let at = |i: usize| [centre[0] + place(i % 41), centre[1] + place(i / 41), centre[2]];
        let point = |x_in_world| CloudPoint {
            x_in_world,
            normal: [0.0, 0.0, 1.0],
            colour: [0; 3],
            confidence: 1.0,
            sigma: 0.0,
            views: 3,
        };
        (0..41 * 41).map(|i| point(at(i))).collect()
    }

    #[test]
    fn a_surface_is_seen_from_where_it_faces() {
        let direction = best_direction(&square([5.0, 6.0, 7.0]), &Vector3::y());
        assert!(direction.z > 0.99, "{direction}");
    }

    #[test]
    fn the_whole_cloud_fills_the_picture_and_outliers_do_not_count() {
        let mut cloud = square([100.0, -50.0, 3.0]);
        cloud.extend(square([1e4, 0.0, 0.0]).into_iter().take(10));
        let size = Size::new(400, 300);
        let view = Viewpoint::from_direction(&cloud, &Vector3::new(0.0, 0.3, 1.0), &Vector3::y(), size);
        let pixels: Vec<_> = cloud[..1681]
            .iter()
            .filter_map(|point| {
                let in_cam = view.cam_from_world.transform(&point.x_in_world.into());
                view.camera.project_inside(&in_cam)
            })
            .collect();
        assert!(pixels.len() > 1650, "{} of 1681 inside", pixels.len());
        let top = pixels.iter().map(|pixel| pixel.y).fold(f64::INFINITY, f64::min);
        assert!(top < 30.0, "fills the picture up to {top}");
        let above = view.cam_from_world.transform(&Vector3::new(100.0, -49.0, 3.0));
        let below = view.cam_from_world.transform(&Vector3::new(100.0, -51.0, 3.0));
        assert!(above.y < below.y);
    }

    #[test]
    fn walking_to_the_right_turns_against_the_clock_seen_from_above() {
        let walked = around(&Vector3::x(), &Vector3::z(), 90.0);
        assert!((walked - Vector3::y()).norm() < 1e-12);
    }
}
