//! Sparse points of which no file says which views see them.

use std::path::Path;

use nalgebra::Vector3;
use vamvs_core::{Scene, SparsePoint, occlusion};

/// Limit of the points that are kept; they may be those of a laser scan.
const MOST_POINTS: usize = 20_000;

/// Gives the scene the points without tracks that `file` has, and returns a warning. A point counts as seen by each view in whose image it
/// lies and in which no other point occludes it: one in the same or a neighbouring cell of 1/64 of the image's longer side, at less than
/// nine tenths of its depth. At most 20 000 points are kept, at regular steps; points that no view sees are not.
pub(crate) fn give_points(scene: &mut Scene, points: &[Vector3<f64>], file: &Path) -> String {
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    let points = points.iter().step_by(step).copied().collect();
    let points: Vec<SparsePoint> = occlusion::points_with_views(points, &scene.views);
    scene.points = points.into_iter().filter(|point| !point.views.is_empty()).collect();
    format!(
        "{}: it does not say which views see its points; each counts as seen where no other point occludes it",
        file.display()
    )
}
