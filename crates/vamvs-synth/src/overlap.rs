//! Which views help a view's depth, from the surface that both see.

use nalgebra::{Vector2, Vector3};
use vamvs_core::lift::lift;
use vamvs_core::view_selection::angle_score;
use vamvs_core::{Grid, Source, Visibility};

use crate::Station;

/// Every so many-th pixel of a row and of a column is asked.
const STEP: usize = 4;

/// The source views of a view, best first, with scores from 0 to 1: over the surfaces that the view
/// shows, the mean of MVSNet's score of the angle between the two views' rays where the other view sees
/// the surface, and of 0 where it does not. Views that see nothing of it are left out.
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

/// Pixels of a grid and the surface points in the world that they show.
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

    /// A camera `x` beside the origin that looks along z.
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
        // 5° is the best angle; at depth 100 that is 8.7 aside.
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
