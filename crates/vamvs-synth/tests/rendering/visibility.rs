//! Visibility of one view's surface points in another view.

use nalgebra::{Vector2, Vector3};
use vamvs_core::{Grid, Pinhole, Pose, Size, Visibility};
use vamvs_synth::{GroundTruth, Tracer, World};

use crate::brute_force::first_hit;
use crate::worlds::{pixels, still_life, uniform_sky, view, world};

struct Seen {
    camera: Pinhole,
    pose: Pose,
    ground_truth: GroundTruth,
}

fn seen(tracer: &Tracer, size: Size, eye: [f64; 3]) -> Seen {
    let (camera, pose) = view(size, eye, [0.0, 0.0, 0.3]);
    Seen { ground_truth: tracer.ground_truth(&camera, &pose), camera, pose }
}

fn scene(size: Size) -> (World, Tracer, Vec<Seen>) {
    let world = world(still_life(), uniform_sky(1.0), vec![]);
    let tracer = Tracer::new(&world);
    let eyes = [[2.2, -2.0, 1.4], [0.4, -2.8, 1.1], [-2.4, -1.5, 1.9]];
    let views = eyes.map(|eye| seen(&tracer, size, eye)).into();
    (world, tracer, views)
}

fn visibility(tracer: &Tracer, reference: &Seen, source: &Seen) -> Grid<Visibility> {
    let depth = &reference.ground_truth.depth;
    tracer.visibility((&reference.camera, &reference.pose, depth), (&source.camera, &source.pose))
}

fn lifted(view: &Seen, (x, y): (usize, usize)) -> Vector3<f64> {
    let ray = view.camera.intrinsics.ray(&Vector2::new(x as f64 + 0.5, y as f64 + 0.5));
    view.pose.inverse().transform(&(ray * f64::from(view.ground_truth.depth[(x, y)])))
}

fn by_brute_force(world: &World, reference: &Seen, source: &Seen, at: (usize, usize)) -> Visibility {
    if reference.ground_truth.depth[at] == 0.0 {
        return Visibility::None;
    }
    let point = lifted(reference, at);
    if source.camera.project_inside(&source.pose.transform(&point)).is_none() {
        return Visibility::OutOfView;
    }
    let centre = source.pose.centre();
    let (t, _) = first_hit(world, &centre, &(point - centre)).unwrap_or((1.0, 0));
    if t < 1.0 - 1e-5 { Visibility::Occluded } else { Visibility::Visible }
}

#[test]
fn masks_are_those_of_brute_force() {
    let (world, tracer, views) = scene(Size::new(64, 48));
    let mut counts = std::collections::HashMap::new();
    for (r, s) in [(0, 1), (1, 0), (0, 2), (2, 1)] {
        let mask = visibility(&tracer, &views[r], &views[s]);
        let expected = |at| by_brute_force(&world, &views[r], &views[s], at);
        let wrong = pixels(mask.size()).filter(|&at| mask[at] != expected(at)).count();
        assert!(wrong <= 1, "{wrong} pixels of view {r} in view {s}");
        mask.data().iter().for_each(|&value| *counts.entry(value).or_insert(0) += 1);
    }
    assert!(
        [Visibility::OutOfView, Visibility::Occluded, Visibility::Visible].iter().all(|v| counts[v] > 200)
    );
}

/// Depth of a view at image coordinates, interpolated; `None` unless the pixels around show one plane of one object.
fn depth_between(view: &Seen, pixel: &Vector2<f64>) -> Option<f64> {
    let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    if left < 0.0 || top < 0.0 {
        return None;
    }
    let (left, top) = (left as usize, top as usize);
    let surface = |x, y| Some((view.ground_truth.id.get(x, y)?, view.ground_truth.normal.get(x, y)?));
    let own = surface(left, top)?;
    let even = |(i, j)| surface(left + i - 1, top + j - 1) == Some(own);
    if left == 0 || top == 0 || !pixels(Size::new(4, 4)).all(even) {
        return None;
    }
    let inverse = |i, j| 1.0 / f64::from(view.ground_truth.depth[(left + i, top + j)]);
    let (s, t) = (x - x.floor(), y - y.floor());
    let along = |j| (1.0 - s) * inverse(0, j) + s * inverse(1, j);
    Some(1.0 / ((1.0 - t) * along(0) + t * along(1)))
}

/// A pixel's surface point, transformed into another view, has the depth of that view where the mask says visible,
/// and is farther away where the mask says occluded.
#[test]
fn carried_depth_agrees_where_visible_and_never_where_occluded() {
    let (_, tracer, views) = scene(Size::new(320, 240));
    for (r, s) in [(0, 1), (1, 2), (2, 0)] {
        let mask = visibility(&tracer, &views[r], &views[s]);
        let mut compared = [0; 2];
        for at in pixels(mask.size()) {
            let occluded = match mask[at] {
                Visibility::Visible => false,
                Visibility::Occluded => true,
                _ => continue,
            };
            let in_source = views[s].pose.transform(&lifted(&views[r], at));
            let pixel = views[s].camera.intrinsics.project(&in_source);
            let Some(depth) = depth_between(&views[s], &pixel) else { continue };
            let beyond = in_source.z / depth - 1.0;
            assert!(
                if occluded { beyond > 1e-5 } else { beyond.abs() < 1e-5 },
                "{at:?}, {occluded}: {beyond:e}"
            );
            compared[usize::from(occluded)] += 1;
        }
        assert!(compared[0] > 10_000 && compared[1] > 1000, "{compared:?}");
    }
}
