//! Which surface points of one view another view sees, by exact ray casting.

use vamvs_core::{Grid, Pinhole, Pose, Visibility, depth_map::is_valid};

use crate::ground_truth::Eye;
use crate::pixel::fill;
use crate::tracer::Tracer;

/// A surface occludes a point only if it lies in front of it by more than this share of the point's distance:
/// a tolerance for the rounding of depth to f32.
const SLACK: f64 = 1e-5;

impl Tracer {
    /// For each pixel of a reference view (camera, `cam_from_world`, ground-truth depth), whether a source
    /// view (camera, `cam_from_world`) sees its surface point. Pixels without depth get [`Visibility::None`].
    #[must_use]
    pub fn visibility(
        &self,
        reference: (&Pinhole, &Pose, &Grid<f32>),
        source: (&Pinhole, &Pose),
    ) -> Grid<Visibility> {
        let (camera, cam_from_world, depth) = reference;
        let eye = Eye::new(camera, cam_from_world);
        let centre = source.1.centre();
        fill(depth.size(), |x, y| {
            if !is_valid(depth[(x, y)]) {
                return Visibility::None;
            }
            let along = eye.direction(x as f64 + 0.5, y as f64 + 0.5) * f64::from(depth[(x, y)]);
            let x_in_world = eye.centre() + along;
            if source.0.project_inside(&source.1.transform(&x_in_world)).is_none() {
                return Visibility::OutOfView;
            }
            let to_point = x_in_world - centre;
            match self.first_hit(&centre, &to_point) {
                Some(hit) if hit.distance < to_point.norm() * (1.0 - SLACK) => Visibility::Occluded,
                _ => Visibility::Visible,
            }
        })
    }
}
