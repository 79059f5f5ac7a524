//! Surfaces that no source view sees.
//!
//! Beside the outline of something near, and at the border of a photograph, a surface may be hidden from all source views or lie
//! outside of them. No photograph can tell anything of it there; what else is tried matches by chance. So a pixel that no source view's own
//! depth map confirms takes the depth of a confirmed pixel beside it, if that surface, continued, would be seen by no source view.

use rayon::prelude::*;
use vamvs_core::Grid;

use crate::field::{Field, State};
use crate::matcher::Matcher;
use crate::plane::Plane;

/// A pixel that correlates better keeps its depth where the continued surface would be hidden: a source view's own depth map may be wrong.
const MATCHED: f32 = 0.9;

/// No such row or column.
const NONE: u32 = u32::MAX;

/// Continues surfaces where no source view sees them. Without the sources' own depth maps nothing is confirmed.
pub(crate) fn continue_surfaces(field: &mut Field, matcher: &Matcher) {
    if matcher.groups.iter().all(|group| group.geometries.is_none()) {
        return;
    }
    let continued = continued(&confirmed(field, matcher), matcher);
    for colour in 0..2 {
        field.update(colour, |_, x, y, state| {
            let w = continued[(x, y)];
            let plane = Plane { w, gx: 0.0, gy: 0.0 };
            let may_be_wrong = state.correlation < MATCHED || !matcher.is_inside(x, y, &plane);
            if w > 0.0 && state.plane.w > 0.0 && may_be_wrong {
                *state = State { settled: true, ..State::unjudged(plane) };
            }
        });
    }
}

/// The inverse depths that a source view's own depth map confirms, else 0.
fn confirmed(field: &Field, matcher: &Matcher) -> Grid<f32> {
    let mut confirmed = Grid::filled(field.size(), 0.0);
    confirmed.data_mut().par_chunks_exact_mut(field.size().width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, w) in row.iter_mut().enumerate() {
            let plane = &field.at(x, y).plane;
            if plane.w > 0.0 && matcher.confirming(x, y, plane).is_some_and(|views| views > 0) {
                *w = plane.w;
            }
        }
    });
    confirmed
}

/// For each pixel that is not confirmed the inverse depth of the nearest confirmed one in its row or column which no source view would
/// see at the pixel; else 0.
fn continued(confirmed: &Grid<f32>, matcher: &Matcher) -> Grid<f32> {
    let size = confirmed.size();
    let rows = |order: &mut dyn Iterator<Item = usize>| {
        let mut nearest = Grid::filled(size, NONE);
        let mut last = vec![NONE; size.width];
        for y in order {
            for ((last, w), nearest) in last.iter_mut().zip(confirmed.row(y)).zip(nearest.row_mut(y)) {
                *last = if *w > 0.0 { y as u32 } else { *last };
                *nearest = *last;
            }
        }
        nearest
    };
    let (above, below) = (rows(&mut (0..size.height)), rows(&mut (0..size.height).rev()));
    let mut continued = Grid::filled(size, 0.0);
    continued.data_mut().par_chunks_exact_mut(size.width.max(1)).enumerate().for_each(|(y, row)| {
        let own = confirmed.row(y);
        let columns = |order: &mut dyn Iterator<Item = usize>| {
            let (mut nearest, mut last) = (vec![NONE; size.width], NONE);
            for x in order {
                last = if own[x] > 0.0 { x as u32 } else { last };
                nearest[x] = last;
            }
            nearest
        };
        let (left, right) = (columns(&mut (0..size.width)), columns(&mut (0..size.width).rev()));
        for (x, continued) in row.iter_mut().enumerate().filter(|(x, _)| own[*x] <= 0.0) {
            let mut beside = [
                (left[x], y as u32),
                (right[x], y as u32),
                (x as u32, above[(x, y)]),
                (x as u32, below[(x, y)]),
            ];
            let way = |(column, row): &(u32, u32)| column.abs_diff(x as u32) + row.abs_diff(y as u32);
            beside.sort_unstable_by_key(way);
            let there = beside.iter().filter(|(column, row)| *column != NONE && *row != NONE);
            let mut surfaces = there.map(|(column, row)| confirmed[(*column as usize, *row as usize)]);
            let is_unseen = |w: &f32| !matcher.sees(x, y, &Plane { w: *w, gx: 0.0, gy: 0.0 });
            *continued = surfaces.find(is_unseen).unwrap_or(0.0);
        }
    });
    continued
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Geometry;
    use crate::{Problem, RefineOptions, solve};
    use nalgebra::Vector3;
    use vamvs_core::{DepthMap, Intrinsics, Photo, Pinhole, Pose, Size};

    const SIZE: Size = Size::new(120, 96);
    const CAMERA: Pinhole =
        Pinhole { size: SIZE, intrinsics: Intrinsics { fx: 100.0, fy: 100.0, cx: 60.0, cy: 48.0 } };

    /// Depths whose disparities between the cameras are 5, 20 and 40 pixels.
    const FAR: f32 = 16.0;
    const WALL: f32 = 4.0;
    const BOX: f32 = 2.0;

    /// A camera at (x, 0, 0) that looks along z.
    fn photo(x: f64) -> Photo {
        let image = Grid::from_fn(SIZE, |x, y| [((x * 31 + y * 17) % 251) as u8; 3]);
        let cam_from_world = Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() };
        Photo { camera: CAMERA, cam_from_world, image, mask: None }
    }

    /// The depths of a field after surfaces were continued, with a source view to the right whose depth in a column is `in_source`,
    /// if it has a depth map.
    fn depths(
        field: impl Fn(usize, usize) -> f32 + Sync,
        in_source: Option<fn(usize) -> f32>,
    ) -> impl Fn(usize, usize) -> f32 {
        let (reference, source) = (photo(0.0), photo(0.8));
        let options = RefineOptions::default();
        let problem = Problem {
            reference: &reference,
            sources: &[&source],
            visibility: &[],
            options: &options,
            device: None,
        };
        let geometry = |depth: fn(usize) -> f32| {
            let map = DepthMap {
                camera: CAMERA,
                cam_from_world: source.cam_from_world,
                depth: Grid::from_fn(SIZE, |x, _| depth(x)),
                confidence: Grid::filled(SIZE, 1.0),
                coarse_confidence: None,
            };
            Geometry::new(&map, (&CAMERA, &source.cam_from_world), (&CAMERA, &reference.cam_from_world))
        };
        let matcher = solve::matcher(&problem, 0);
        let matcher = match in_source.map(geometry) {
            Some(geometry) => matcher.with_depths([Some(geometry)]),
            None => matcher,
        };
        let plane = |x, y| Plane { w: 1.0 / field(x, y), gx: 0.0, gy: 0.0 };
        let mut field = Field::new(SIZE, |x, y| State::unjudged(plane(x, y)));
        continue_surfaces(&mut field, &matcher);
        move |x, y| 1.0 / field.at(x, y).plane.w
    }

    #[test]
    fn a_wall_goes_on_where_it_leaves_the_source_view() {
        // The source sees the wall from column 20 on. Left of it, and in a patch inside, the field is far behind it.
        let is_patch = |x: usize, y: usize| (60..64).contains(&x) && (40..44).contains(&y);
        let field = |x: usize, y: usize| if x < 20 || is_patch(x, y) { FAR } else { WALL };
        let depth = depths(field, Some(|_| WALL));
        for (x, y) in [(0, 0), (5, 90), (18, 50), (70, 20)] {
            assert!((depth(x, y) - WALL).abs() < 1e-4, "({x}, {y}): {}", depth(x, y));
        }
        assert_eq!(depth(62, 42), FAR, "where the source sees the wall, it is not continued");
        assert_eq!(depths(field, None)(5, 50), FAR, "without the sources' maps nothing is confirmed");
    }

    #[test]
    fn a_wall_goes_on_behind_what_hides_it_from_the_source_view() {
        // A box fills columns 40 to 60 of the source view, 80 to 100 here, and hides columns 60 to 80 of the wall from the source.
        let in_source = |x: usize| if (40..60).contains(&x) { BOX } else { WALL };
        let field = |x: usize, _: usize| if (60..100).contains(&x) { BOX } else { WALL };
        let depth = depths(field, Some(in_source));
        for (x, expected) in [(50, WALL), (62, WALL), (77, WALL), (83, BOX), (97, BOX), (110, WALL)] {
            assert!((depth(x, 40) - expected).abs() < 1e-4, "{x}: {}", depth(x, 40));
        }
    }
}
