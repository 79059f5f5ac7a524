//! Chooses source views for each view by the surfaces that both see.

use nalgebra::{Vector2, Vector3};
use vamvs_core::lift::lift;
use vamvs_core::view_selection::angle_score;
use vamvs_core::{Grid, Source, Visibility};

use crate::Station;

/// Every `STEP`-th pixel of every `STEP`-th row is used.
const STEP: usize = 4;

/// The source views of a view, best first, with scores from 0 to 1. The score is a mean over the view's surface
/// points: MVSNet's score of the triangulation angle where the other view sees the point, 0 where it does not.
/// Views that see none of the points are left out.
pub(crate) fn sources(
    view: usize,
    stations: &[Station],
    depth: &Grid<f32>,
    visibility: &[Grid<Visibility>],
) -> Vec<Source> {
    let surfaces = surfaces(&stations[view], depth);
    let own = stations[view].cam_from_world.centre();
    let source = |(view, tile): (usize, &Grid<Visibility>)| {
        let centre = stations[view].cam_from_world.centre();
        let seen = surfaces.iter().filter(|(at, _)| tile[*at] == Visibility::Visible);
        let sum: f64 = seen.map(|(_, point)| angle_score(&(own - point), &(centre - point))).sum();
        Source { view, score: sum / surfaces.len().max(1) as f64 }
    };
    let others = visibility.iter().enumerate().filter(|(other, _)| *other != view);
    let mut sources: Vec<_> = others.map(source).filter(|source| source.score > 0.0).collect();
    sources.sort_by(|a, b| b.score.total_cmp(&a.score));
    sources
}

/// The sampled pixels (x, y) that show a surface, each with its surface point in the world.
fn surfaces(station: &Station, depth: &Grid<f32>) -> Vec<((usize, usize), Vector3<f64>)> {
    let world_from_cam = station.cam_from_world.inverse();
    let pixels = (0..depth.height()).step_by(STEP);
    let pixels = pixels.flat_map(|y| (0..depth.width()).step_by(STEP).map(move |x| (x, y)));
    let with_depth = pixels.filter(|&at| depth[at] > 0.0);
    let point = |(x, y)| {
        let centre = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
        world_from_cam.transform(&lift(&station.camera, &centre, f64::from(depth[(x, y)])))
    };
    with_depth.map(|at| (at, point(at))).collect()
}

#[cfg(test)]
mod tests {
    use vamvs_core::{Intrinsics, Pinhole, Pose, Size};

    use super::*;

    const SIZE: Size = Size::new(16, 16);

    /// A camera at `(x, 0, 0)` that looks along z.
    fn station(x: f64) -> Station {
        let intrinsics = Intrinsics { fx: 160.0, fy: 160.0, cx: 8.0, cy: 8.0 };
        let cam_from_world = Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() };
        Station { camera: Pinhole { size: SIZE, intrinsics }, cam_from_world }
    }

    #[test]
    fn sources_are_ordered_by_what_they_share_and_by_their_angle() {
        let all = Grid::filled(SIZE, Visibility::Visible);
        let half = Grid::from_fn(SIZE, |x, _| if x < 8 { Visibility::Visible } else { Visibility::Occluded });
        let none = Grid::filled(SIZE, Visibility::OutOfView);
        // The best triangulation angle is 5°, which at depth 100 is a baseline of 8.7.
        let stations = [0.0, 60.0, 8.7, -8.7, 8.7].map(station);
        let depth = Grid::filled(SIZE, 100.0);
        let sources = sources(0, &stations, &depth, &[all.clone(), all.clone(), half, all, none]);
        let order: Vec<usize> = sources.iter().map(|source| source.view).collect();
        assert_eq!(order, [3, 2, 1]);
        assert!(
            (sources[0].score - 1.0).abs() < 0.2 && (sources[1].score / sources[0].score - 0.5).abs() < 0.05
        );
    }

    #[test]
    fn pixels_without_surface_do_not_count() {
        let stations = [0.0, 8.7].map(station);
        let score = |depth: &Grid<f32>| {
            let seen = depth.map(|&d| if d > 0.0 { Visibility::Visible } else { Visibility::None });
            sources(0, &stations, depth, &[seen.clone(), seen])
        };
        let half = Grid::from_fn(SIZE, |_, y| if y < 8 { 100.0 } else { 0.0 });
        let [whole, half] = [score(&Grid::filled(SIZE, 100.0)), score(&half)].map(|sources| sources[0].score);
        assert!((whole - half).abs() < 0.05, "{whole} {half}");
        assert_eq!(score(&Grid::filled(SIZE, 0.0)), []);
    }
}
