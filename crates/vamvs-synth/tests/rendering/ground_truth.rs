//! Ground truth: depth, ids and normals.

use nalgebra::{Vector2, Vector3};
use vamvs_core::{Pinhole, Pose, Size};
use vamvs_synth::{Tracer, primitive};

use crate::brute_force::first_hit;
use crate::worlds::{matt, object, pixels, still_life, uniform_sky, view, world};

/// The ray in the world through a pixel's centre, as (origin, direction); its parameter is the depth.
fn central_ray(camera: &Pinhole, pose: &Pose, (x, y): (usize, usize)) -> (Vector3<f64>, Vector3<f64>) {
    let in_cam = camera.intrinsics.ray(&Vector2::new(x as f64 + 0.5, y as f64 + 0.5));
    (pose.centre(), pose.inverse().rotation * in_cam)
}

#[test]
fn the_depth_of_a_tilted_plane_is_analytic() {
    let turn = [0.4, -0.3, 0.2];
    let plane = object(primitive::rectangle([40.0, 40.0]), matt([128; 3]), [0.1, 0.2, 0.3], turn, 2.0);
    let normal = plane.world_from_object.isometry.rotation * Vector3::z();
    let tracer = Tracer::new(&world(vec![plane], uniform_sky(1.0), vec![]));
    let (camera, pose) = view(Size::new(64, 48), [1.0, -3.0, 2.5], [0.0; 3]);
    let ground_truth = tracer.ground_truth(&camera, &pose);
    for at in pixels(camera.size) {
        let (origin, direction) = central_ray(&camera, &pose, at);
        let expected = (Vector3::new(0.1, 0.2, 0.3) - origin).dot(&normal) / direction.dot(&normal);
        let depth = f64::from(ground_truth.depth[at]);
        assert!((depth / expected - 1.0).abs() < 2e-7, "{at:?}: {depth}, expected {expected}");
        assert_eq!(ground_truth.id[at], 1);
        assert!((Vector3::from(ground_truth.normal[at]).cast() - normal).norm() < 1e-6);
    }
}

#[test]
fn a_fine_sphere_has_the_depth_of_a_sphere_and_no_cracks() {
    let centre = Vector3::new(0.4, -0.2, 0.7);
    let sphere = object(primitive::sphere(1.0, 128), matt([128; 3]), centre.into(), [0.3, 0.5, 0.1], 1.0);
    let tracer = Tracer::new(&world(vec![sphere], uniform_sky(1.0), vec![]));
    let (camera, pose) = view(Size::new(400, 400), [10.0, 8.0, 6.0], centre.into());
    let camera = Pinhole { intrinsics: camera.intrinsics.scaled(6.0, 6.0).cropped(1000.0, 1000.0), ..camera };
    let ground_truth = tracer.ground_truth(&camera, &pose);
    for at in pixels(camera.size) {
        let (origin, direction) = central_ray(&camera, &pose, at);
        let to_centre = centre - origin;
        let closest = to_centre.dot(&direction) / direction.norm_squared();
        let square = 1.0 - (to_centre - direction * closest).norm_squared();
        assert_eq!(ground_truth.id[at] == 1, square > 0.0 || ground_truth.depth[at] > 0.0, "{at:?}");
        // Inside the silhouette, rays meet the front of the sphere, never its back.
        if square > 2e-4 {
            assert!(
                f64::from(ground_truth.depth[at]) > 0.0 && f64::from(ground_truth.depth[at]) < closest,
                "a crack at {at:?}"
            );
        }
        if square > 0.25 {
            let expected = closest - square.sqrt() / direction.norm();
            let error = f64::from(ground_truth.depth[at]) / expected - 1.0;
            assert!(error.abs() < 1e-5, "{at:?}: {error:e}");
            let normal = Vector3::from(ground_truth.normal[at]).cast::<f64>();
            assert!((normal - (origin + direction * expected - centre)).norm() < 0.02);
        }
    }
}

#[test]
fn depth_and_ids_are_those_of_brute_force_at_every_scale() {
    for scale in [0.01, 1.0, 300.0] {
        let mut objects = still_life();
        for object in &mut objects {
            object.world_from_object.prepend_scaling_mut(scale);
            object.world_from_object.isometry.translation.vector *= scale;
        }
        let world = world(objects, uniform_sky(1.0), vec![]);
        let tracer = Tracer::new(&world);
        let (camera, pose) = view(Size::new(80, 60), [2.0, -2.5, 1.6].map(|v| scale * v), [0.0; 3]);
        let ground_truth = tracer.ground_truth(&camera, &pose);
        let mut off = 0;
        for at in pixels(camera.size) {
            let (origin, direction) = central_ray(&camera, &pose, at);
            let expected =
                first_hit(&world, &origin, &direction).map_or((0.0, 0), |(t, index)| (t, index + 1));
            let same = usize::from(ground_truth.id[at]) == expected.1
                && (f64::from(ground_truth.depth[at]) - expected.0).abs() <= 1e-6 * expected.0;
            off += usize::from(!same);
        }
        // A ray along an edge may meet either triangle.
        assert!(off <= 1, "{off} pixels at scale {scale}");
    }
}

#[test]
fn an_empty_world_has_no_depth() {
    let tracer = Tracer::new(&world(vec![], uniform_sky(1.0), vec![]));
    let (camera, pose) = view(Size::new(8, 6), [1.0, 1.0, 1.0], [0.0; 3]);
    let shot = tracer.shoot(&camera, &pose, &vamvs_synth::RenderOptions::default(), 1);
    assert!(shot.ground_truth.depth.data().iter().all(|&depth| depth == 0.0));
    assert!(shot.ground_truth.id.data().iter().all(|&id| id == 0));
    assert!(shot.radiance.data().iter().flatten().all(|&light| (light - 1.0).abs() < 1e-6));
}

#[test]
fn first_hits_tell_distance_object_and_the_side_they_are_seen_from() {
    let tracer = Tracer::new(&world(still_life(), uniform_sky(1.0), vec![]));
    let below = tracer.first_hit(&Vector3::new(3.0, 3.0, -2.0), &Vector3::new(0.0, 0.0, 5.0)).unwrap();
    assert!((below.distance - 2.0).abs() < 1e-12 && below.object == 0);
    assert!((below.normal + Vector3::z()).norm() < 1e-12);
    assert_eq!(tracer.first_hit(&Vector3::new(3.0, 3.0, -2.0), &Vector3::new(0.0, 0.0, -5.0)), None);
}
