//! The true cloud that rendered views show together.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use crate::render::Rendered;

/// Relative slack of the visibility test.
const SLACK: f64 = 1e-3;

/// World positions of every `step`-th pixel, in both directions, of all views, where another view
/// sees the same surface point too.
#[must_use]
pub fn truth_cloud(views: &[Rendered], step: usize) -> Vec<[f64; 3]> {
    let per_view = |reference: usize| points_seen_twice(views, reference, step);
    (0..views.len()).into_par_iter().flat_map_iter(per_view).collect()
}

fn points_seen_twice(views: &[Rendered], reference: usize, step: usize) -> Vec<[f64; 3]> {
    let size = views[reference].depth.size();
    let pixels =
        (0..size.height).step_by(step).flat_map(|y| (0..size.width).step_by(step).map(move |x| (x, y)));
    let points = pixels.filter_map(|(x, y)| lift(&views[reference], x, y));
    let seen_elsewhere =
        |point: &Vector3<f64>| (0..views.len()).any(|v| v != reference && sees(&views[v], point));
    points.filter(seen_elsewhere).map(Into::into).collect()
}

fn lift(view: &Rendered, x: usize, y: usize) -> Option<Vector3<f64>> {
    let depth = f64::from(view.depth[(x, y)]);
    let ray = view.photo.camera.intrinsics.ray(&Vector2::new(x as f64 + 0.5, y as f64 + 0.5));
    (depth > 0.0).then(|| view.photo.cam_from_world.inverse().transform(&(ray * depth)))
}

/// Whether the point's depth is between those of the four pixels around its projection.
fn sees(view: &Rendered, x_in_world: &Vector3<f64>) -> bool {
    let in_cam = view.photo.cam_from_world.transform(x_in_world);
    let Some(pixel) = view.photo.camera.project_inside(&in_cam) else { return false };
    let (x, y) = ((pixel.x - 0.5).max(0.0) as usize, (pixel.y - 0.5).max(0.0) as usize);
    let depths = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| view.depth.get(x + i, y + j).copied());
    let (mut near, mut far) = (f64::INFINITY, 0.0_f64);
    for depth in depths.into_iter().flatten().map(f64::from) {
        (near, far) = (near.min(depth), far.max(depth));
    }
    in_cam.z > near * (1.0 - SLACK) && in_cam.z < far * (1.0 + SLACK)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use vamvs_core::Size;

    #[test]
    fn points_of_a_plane_lie_on_it_and_single_views_have_none() {
        let views = fixtures::tilted_plane(Size::new(32, 24), 3);
        assert!(truth_cloud(&views[..1], 1).is_empty());
        let cloud = truth_cloud(&views, 2);
        assert!(cloud.len() > 300, "{} points", cloud.len());
        let normal = Vector3::from(views[0].normal[(0, 0)]).cast::<f64>();
        for point in cloud {
            assert!((Vector3::from(point) - crate::rig::TARGET).dot(&normal).abs() < 1e-5);
        }
    }
}
