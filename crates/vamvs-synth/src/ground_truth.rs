//! Ground truth of a view: depth, object and normal at the pixels' centres, by ray casting.

use nalgebra::{Vector2, Vector3};
use vamvs_core::{Pinhole, Pose};

use crate::geometry::Ray;
use crate::pixel::fill;
use crate::tracer::{GroundTruth, Tracer};

/// A camera with its pose in the world.
pub(crate) struct Eye<'a> {
    pub camera: &'a Pinhole,
    pub world_from_cam: Pose,
}

impl<'a> Eye<'a> {
    pub fn new(camera: &'a Pinhole, cam_from_world: &Pose) -> Self {
        Self { camera, world_from_cam: cam_from_world.inverse() }
    }

    /// The camera centre in the world.
    pub fn centre(&self) -> &Vector3<f64> {
        &self.world_from_cam.translation
    }

    /// The viewing direction of image coordinates `(x, y)`, in the world. Its length is that of a step to depth 1.
    pub fn direction(&self, x: f64, y: f64) -> Vector3<f64> {
        self.world_from_cam.rotation * self.camera.intrinsics.ray(&Vector2::new(x, y))
    }

    /// The ray through image coordinates `(x, y)`, and the depth per unit of distance along it.
    pub fn ray(&self, x: f64, y: f64) -> (Ray, f64) {
        let direction = self.direction(x, y);
        let scale = 1.0 / direction.norm();
        (Ray { origin: self.centre().cast(), direction: (direction * scale).cast() }, scale)
    }
}

impl Tracer {
    /// What `camera` at `cam_from_world` sees at its pixels' centres. Depth is where the ray crosses the
    /// triangle's plane, computed in double precision and rounded once to f32.
    #[must_use]
    pub fn ground_truth(&self, camera: &Pinhole, cam_from_world: &Pose) -> GroundTruth {
        let eye = Eye::new(camera, cam_from_world);
        let pixels = fill(camera.size, |x, y| {
            let direction = eye.direction(x as f64 + 0.5, y as f64 + 0.5);
            let Some(hit) = self.first_hit(eye.centre(), &direction) else { return (0.0, 0, [0.0; 3]) };
            let depth = hit.distance / direction.norm();
            (depth as f32, hit.object as u16 + 1, hit.normal.cast::<f32>().into())
        });
        GroundTruth { depth: pixels.map(|p| p.0), id: pixels.map(|p| p.1), normal: pixels.map(|p| p.2) }
    }
}
