//! Exact depth maps of analytic surfaces, for the tests and the benchmark.
#![allow(dead_code, reason = "compiled into each of them, which uses a part")]

use nalgebra::{Vector2, Vector3};
use vamvs_core::{DepthMap, Grid, Intrinsics, Pinhole, Pose, Rgb, Size};
use vamvs_fusion::FusionView;

/// What is seen.
#[derive(Clone, Copy, Debug)]
pub enum Surface {
    /// The plane through the origin with this unit normal.
    Plane(Vector3<f64>),
    /// The unit sphere around the origin, before nothing.
    Sphere,
    /// The unit sphere before the plane z = −0.5.
    SphereOnPlane,
}

impl Surface {
    /// Signed distance of a point from the surface.
    #[must_use]
    pub fn distance(&self, x: &Vector3<f64>) -> f64 {
        match self {
            Self::Plane(normal) => normal.dot(x),
            Self::Sphere => x.norm() - 1.0,
            Self::SphereOnPlane => (x.norm() - 1.0).min(x.z + 0.5),
        }
    }

    /// Unit normal at a point of the surface, outwards.
    #[must_use]
    pub fn normal(&self, x: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Plane(normal) => *normal,
            Self::SphereOnPlane if x.z + 0.5 < x.norm() - 1.0 => Vector3::z(),
            Self::Sphere | Self::SphereOnPlane => x.normalize(),
        }
    }

    /// The least t > 0 with `origin + t · direction` on the surface.
    fn first_hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let plane = |normal: &Vector3<f64>, at: f64| (at - normal.dot(origin)) / normal.dot(direction);
        match self {
            Self::Plane(normal) => Some(plane(normal, 0.0)),
            Self::Sphere => sphere(origin, direction),
            Self::SphereOnPlane => sphere(origin, direction).or(Some(plane(&Vector3::z(), -0.5))),
        }
        .filter(|&t| t > 0.0)
    }
}

fn sphere(origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let (a, b, c) = (direction.norm_squared(), origin.dot(direction), origin.norm_squared() - 1.0);
    let discriminant = b * b - a * c;
    (discriminant >= 0.0).then(|| (-b - discriminant.sqrt()) / a)
}

/// `count` views of a surface from above, 9° apart on an arc of radius `distance`, each of its own
/// colour and wholly confident.
#[must_use]
pub fn views(surface: Surface, count: usize, size: Size, distance: f64) -> Vec<FusionView> {
    let view = |i: usize| {
        let (sin, cos) = (9.0 * (i as f64 - 0.5 * (count - 1) as f64)).to_radians().sin_cos();
        let eye = distance * Vector3::new(sin, -0.35, cos).normalize();
        let cam_from_world = Pose::look_at(&eye, &Vector3::zeros(), &Vector3::y());
        render(surface, size, cam_from_world, [10 * i as u8, 100, 200])
    };
    (0..count).map(view).collect()
}

fn render(surface: Surface, size: Size, cam_from_world: Pose, colour: Rgb) -> FusionView {
    let focal = 1.2 * size.width as f64;
    let (cx, cy) = (0.49 * size.width as f64, 0.52 * size.height as f64);
    let camera = Pinhole { size, intrinsics: Intrinsics { fx: focal, fy: 1.02 * focal, cx, cy } };
    let world_from_cam = cam_from_world.inverse();
    let depth = Grid::from_fn(size, |x, y| {
        let ray = camera.intrinsics.ray(&Vector2::new(x as f64 + 0.5, y as f64 + 0.5));
        let hit = surface.first_hit(&world_from_cam.translation, &(world_from_cam.rotation * ray));
        hit.unwrap_or(0.0) as f32
    });
    let confidence = Grid::filled(size, 1.0);
    let map = DepthMap { camera, cam_from_world, depth, confidence, coarse_confidence: None };
    FusionView { map, mask: None, colour: Grid::filled(size, colour), normals: None, sigma: None }
}

/// For each view, all other views.
#[must_use]
pub fn all_others(count: usize) -> Vec<Vec<usize>> {
    (0..count).map(|view| (0..count).filter(|&other| other != view).collect()).collect()
}
