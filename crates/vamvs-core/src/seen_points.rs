//! Which triangulated points each view saw, found in one pass over the points.

use crate::Scene;

/// For each view of a scene, the points that it saw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeenPoints {
    /// Indices of points, view after view.
    points: Vec<usize>,
    /// View `v` owns `points[begins[v]..begins[v + 1]]`.
    begins: Vec<usize>,
}

impl SeenPoints {
    /// The points that each view of `scene` saw, according to the points' tracks.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let tracks =
            || scene.points.iter().enumerate().flat_map(|(i, p)| p.views.iter().map(move |&v| (i, v)));
        let mut begins = vec![0; scene.views.len() + 1];
        tracks().for_each(|(_, view)| begins[view + 1] += 1);
        (1..begins.len()).for_each(|view| begins[view] += begins[view - 1]);
        let mut points = vec![0; begins[scene.views.len()]];
        let mut next = begins.clone();
        for (point, view) in tracks() {
            points[next[view]] = point;
            next[view] += 1;
        }
        Self { points, begins }
    }

    /// Indices into [`Scene::points`] of the points that `view` saw, ascending.
    #[must_use]
    pub fn by(&self, view: usize) -> &[usize] {
        &self.points[self.begins[view]..self.begins[view + 1]]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::{Intrinsics, Pinhole, Pose, Size, SparsePoint, View};

    #[test]
    fn each_view_gets_the_points_whose_tracks_name_it() {
        let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 1.0, cy: 1.0 };
        let camera = Pinhole { size: Size::new(2, 2), intrinsics }.into();
        let cam_from_world = Pose::identity();
        let view = View { id: 0, name: String::new(), camera, cam_from_world, depth_range: None };
        let point = |views: &[usize]| SparsePoint { x_in_world: Vector3::zeros(), views: views.to_vec() };
        let points = [&[2, 0][..], &[], &[2], &[0, 2, 3]].map(point).to_vec();
        let scene = Scene { views: vec![view; 4], points, pairs: None };
        let seen = SeenPoints::of(&scene);
        assert_eq!(
            [0, 1, 2, 3].map(|view| seen.by(view).to_vec()),
            [vec![0, 3], vec![], vec![0, 2, 3], vec![3]]
        );
    }
}
