//! Surfaces that run out of all source views.
//!
//! At the border of a photograph a near surface may lie outside of all source views, and no photograph can tell anything of it; what
//! is seen of farther depths there matches by chance. Where no source view's own depth map confirms a pixel, and the surface of the
//! nearest confirmed pixel, continued, would be seen by no source view, that is the better guess.

use rayon::prelude::*;
use vamvs_core::Grid;

use crate::field::{Field, State};
use crate::matcher::Matcher;
use crate::plane::Plane;
use crate::seed::fill;

/// Continues surfaces where no source view sees them. Without the sources' own depth maps nothing is confirmed.
pub(crate) fn continue_surfaces(field: &mut Field, matcher: &Matcher) {
    let size = field.size();
    if matcher.groups.iter().all(|group| group.geometries.is_none()) {
        return;
    }
    let mut surfaces = Grid::filled(size, 0.0);
    surfaces.data_mut().par_chunks_exact_mut(size.width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, w) in row.iter_mut().enumerate() {
            let plane = &field.at(x, y).plane;
            if plane.w > 0.0 && matcher.confirming(x, y, plane).is_some_and(|views| views > 0) {
                *w = plane.w;
            }
        }
    });
    let confirmed = surfaces.clone();
    fill(&mut surfaces);
    for colour in 0..2 {
        field.update(colour, |_, x, y, state| {
            let plane = Plane { w: surfaces[(x, y)], gx: 0.0, gy: 0.0 };
            if state.plane.w > 0.0
                && plane.w > 0.0
                && confirmed[(x, y)] <= 0.0
                && !matcher.is_seen(x, y, &plane)
            {
                *state = State { settled: true, ..State::unjudged(plane) };
            }
        });
    }
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
    /// The depth of a wall, and its disparity between the cameras, pixels.
    const WALL: f32 = 4.0;
    const DISPARITY: usize = 20;
    const FAR: f32 = 16.0;

    /// A camera at (x, 0, 0) that looks along z.
    fn photo(x: f64) -> Photo {
        let image = Grid::from_fn(SIZE, |x, y| [((x * 31 + y * 17) % 251) as u8; 3]);
        let cam_from_world = Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() };
        Photo { camera: CAMERA, cam_from_world, image, mask: None }
    }

    #[test]
    fn a_wall_goes_on_where_no_view_sees_it_and_no_view_confirms_anything_else() {
        let (reference, source) = (photo(0.0), photo(0.8));
        let options = RefineOptions::default();
        let problem =
            Problem { reference: &reference, sources: &[&source], visibility: &[], options: &options };
        let map = DepthMap {
            camera: CAMERA,
            cam_from_world: source.cam_from_world,
            depth: Grid::filled(SIZE, WALL),
            confidence: Grid::filled(SIZE, 1.0),
            coarse_confidence: None,
        };
        let (here, there) = ((&CAMERA, &reference.cam_from_world), (&CAMERA, &source.cam_from_world));
        let geometry = Geometry::new(&map, there, here);
        let plane = |depth: f32| Plane { w: 1.0 / depth, gx: 0.0, gy: 0.0 };
        // The source sees the wall from column `DISPARITY` on. Left of it, and in a patch inside, the field is far behind it.
        let is_patch = |x: usize, y: usize| (60..64).contains(&x) && (40..44).contains(&y);
        let state = |x, y| State::unjudged(plane(if x < DISPARITY || is_patch(x, y) { FAR } else { WALL }));
        let depth_after = |matcher: &Matcher| {
            let mut field = Field::new(SIZE, state);
            continue_surfaces(&mut field, matcher);
            move |x: usize, y: usize| 1.0 / field.at(x, y).plane.w
        };
        let depth = depth_after(&solve::matcher(&problem, 0).with_depths([Some(geometry)]));
        for (x, y) in [(0, 0), (5, 90), (DISPARITY - 2, 50), (70, 20)] {
            assert!((depth(x, y) - WALL).abs() < 1e-4, "({x}, {y}): {}", depth(x, y));
        }
        assert_eq!(depth(62, 42), FAR, "where the source sees the wall, it is not continued");
        let depth = depth_after(&solve::matcher(&problem, 0));
        assert_eq!(depth(5, 50), FAR, "without the sources' maps nothing is confirmed");
    }
}
