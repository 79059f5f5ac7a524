//! Cuts photographs of more directions than a pinhole camera takes into views.

use vamvs_core::{Camera, Lens, Pinhole, Scene, SparsePoint, View};

/// The scene with each photograph's faces ([`View::faces`]) in its place, numbered anew if there are any. A point that the photograph
/// saw is seen by the faces that it lies in.
///
/// # Panics
/// If the scene has pairs of views.
pub(crate) fn cut(scene: Scene) -> Scene {
    assert!(scene.pairs.is_none(), "no format that names pairs has photographs of all directions");
    let count = scene.views.len();
    let faces: Vec<Vec<View>> = scene.views.into_iter().map(View::faces).collect();
    let first: Vec<usize> =
        faces.iter().scan(0, |next, faces| Some(std::mem::replace(next, *next + faces.len()))).collect();
    let mut views: Vec<View> = faces.iter().flatten().cloned().collect();
    if views.len() == count {
        return Scene { views, points: scene.points, pairs: None };
    }
    (0..).zip(&mut views).for_each(|(id, view)| view.id = id);
    let seen_by = |point: &SparsePoint| {
        let places = point.views.iter().flat_map(|&view| first[view]..first[view] + faces[view].len());
        let is_alone = |view: usize| !matches!(views[view].camera.lens, Lens::Face(_));
        places.filter(|&view| is_alone(view) || is_inside(&views[view], point)).collect()
    };
    let points = scene.points.iter().map(|point| SparsePoint { views: seen_by(point), ..point.clone() });
    let points = points.filter(|point: &SparsePoint| !point.views.is_empty()).collect();
    Scene { views, points, pairs: None }
}

fn is_inside(view: &View, point: &SparsePoint) -> bool {
    let Camera { size, intrinsics, .. } = view.camera;
    Pinhole { size, intrinsics }.project_inside(&view.cam_from_world.transform(&point.x_in_world)).is_some()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use vamvs_core::face::{Rows, Side, Surroundings};
    use vamvs_core::{Intrinsics, Pose, Size};

    use super::*;

    #[test]
    fn points_are_seen_by_the_faces_that_they_lie_in() {
        let panorama = Surroundings::Panorama { size: Size::new(64, 32), rows: Rows::Latitude };
        let intrinsics = Intrinsics { fx: 9.0, fy: 9.0, cx: 8.0, cy: 8.0 };
        let pinhole = Camera { size: Size::new(16, 16), intrinsics, lens: Lens::None };
        let view = |name: &str, camera| View {
            id: 7,
            name: name.to_owned(),
            camera,
            cam_from_world: Pose::identity(),
            depth_range: None,
        };
        let views = vec![view("a.png", panorama.face(Side::Front)), view("b.png", pinhole)];
        // In the overlap of front and right; above; behind, where the pinhole cannot have seen it but says so.
        let at = [[1.0, 0.0, 1.1], [0.1, -2.0, 0.0], [0.0, 0.0, -1.0]];
        let point = |x: [f64; 3]| SparsePoint { x_in_world: Vector3::from(x), views: vec![0, 1] };
        let scene = cut(Scene { views, points: at.map(point).to_vec(), pairs: None });
        let names: Vec<&str> = scene.views.iter().map(|view| view.name.as_str()).collect();
        assert_eq!(names[4..], ["a@up.png", "a@down.png", "b.png"]);
        assert!((0..).zip(&scene.views).all(|(id, view)| view.id == id));
        let seen: Vec<&[usize]> = scene.points.iter().map(|point| point.views.as_slice()).collect();
        assert_eq!(seen, [&[0, 1, 6][..], &[4, 6], &[2, 6]]);
    }
}
