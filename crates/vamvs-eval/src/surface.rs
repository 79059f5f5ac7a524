//! A ground-truth cloud, made from the ground-truth depth maps of several views.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use vamvs_core::{Grid, Pinhole, Pose, depth_map::is_valid, lift::lift};

/// Relative tolerance of the visibility test.
const SLACK: f64 = 1e-3;

/// A ground-truth depth map.
#[derive(Clone, Copy, Debug)]
pub struct TrueMap<'a> {
    /// The camera, of the map's size.
    pub camera: &'a Pinhole,
    /// The pose.
    pub cam_from_world: &'a Pose,
    /// Depth z, scene units.
    pub depth: &'a Grid<f32>,
}

/// The points, in the world, of every `step`-th row and column of all maps, except those that no other map
/// shows: a surface that only one view sees cannot be reconstructed.
#[must_use]
pub fn seen_twice(maps: &[TrueMap], step: usize) -> Vec<[f64; 3]> {
    (0..maps.len()).into_par_iter().flat_map_iter(|reference| points(maps, reference, step)).collect()
}

fn points(maps: &[TrueMap], reference: usize, step: usize) -> Vec<[f64; 3]> {
    let map = &maps[reference];
    let world_from_cam = map.cam_from_world.inverse();
    let size = map.depth.size();
    let pixels =
        (0..size.height).step_by(step).flat_map(|y| (0..size.width).step_by(step).map(move |x| (x, y)));
    let point = |(x, y): (usize, usize)| {
        let depth = map.depth[(x, y)];
        let centre = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
        is_valid(depth).then(|| world_from_cam.transform(&lift(map.camera, &centre, f64::from(depth))))
    };
    let elsewhere =
        |point: &Vector3<f64>| (0..maps.len()).any(|other| other != reference && maps[other].shows(point));
    pixels.filter_map(point).filter(elsewhere).map(Into::into).collect()
}

impl TrueMap<'_> {
    /// Whether the map shows a point: whether the point's depth lies between the depths of the four pixels
    /// around its projection, to [`SLACK`].
    fn shows(&self, x_in_world: &Vector3<f64>) -> bool {
        let in_cam = self.cam_from_world.transform(x_in_world);
        let Some(pixel) = self.camera.project_inside(&in_cam) else { return false };
        let (x, y) = ((pixel.x - 0.5).max(0.0) as usize, (pixel.y - 0.5).max(0.0) as usize);
        let around = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| self.depth.get(x + i, y + j).copied());
        let depths = around.into_iter().flatten().filter(|depth| is_valid(*depth)).map(f64::from);
        let (near, far) = depths.fold((f64::INFINITY, 0.0_f64), |(near, far), d| (near.min(d), far.max(d)));
        in_cam.z > near * (1.0 - SLACK) && in_cam.z < far * (1.0 + SLACK)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Intrinsics, Size};

    const CAMERA: Pinhole = Pinhole {
        size: Size::new(40, 30),
        intrinsics: Intrinsics { fx: 50.0, fy: 50.0, cx: 20.0, cy: 15.0 },
    };

    /// A camera at (x, 0, 0) that looks along z at the plane z = 2, of which it sees x from −`half` to `half`.
    fn view(x: f64, half: f64) -> (Pose, Grid<f32>) {
        let pose = Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() };
        let depth = Grid::from_fn(CAMERA.size, |column, _| {
            let at = x + (column as f64 + 0.5 - 20.0) / 50.0 * 2.0;
            if at.abs() < half { 2.0 } else { 0.0 }
        });
        (pose, depth)
    }

    #[test]
    fn points_are_on_the_surface_where_two_maps_show_it() {
        let views = [view(-0.2, 0.5), view(0.2, 0.5)];
        let maps =
            views.each_ref().map(|(pose, depth)| TrueMap { camera: &CAMERA, cam_from_world: pose, depth });
        assert!(seen_twice(&maps[..1], 1).is_empty());
        let points = seen_twice(&maps, 1);
        // Both views see the plane from x = −0.5 to 0.5, in 25 of 40 columns and all 30 rows.
        assert!(points.iter().all(|x| (x[2] - 2.0).abs() < 1e-9 && x[0].abs() < 0.5));
        assert!((1300..1600).contains(&points.len()), "{} points", points.len());
        assert!((300..400).contains(&seen_twice(&maps, 2).len()));
    }

    #[test]
    fn what_hides_something_is_not_what_it_hides() {
        let (pose, depth) = view(0.0, 9.0);
        let (aside, nearer) = view(0.2, 9.0);
        let nearer = nearer.map(|_| 1.0);
        let maps = [(&pose, &depth), (&aside, &nearer)].map(|(pose, depth)| TrueMap {
            camera: &CAMERA,
            cam_from_world: pose,
            depth,
        });
        assert!(seen_twice(&maps, 1).is_empty());
    }
}
