//! Stages are deterministic, and the things on them are at rest.

use nalgebra::{Point3, Vector3};
use rand::SeedableRng;
use rapier3d::math::{Pose, Vector};
use rapier3d::parry::query::{self, PointQuery};
use rapier3d::parry::shape::{TriMesh, TriMeshFlags};

use super::*;

/// Largest allowed gap under a thing and largest allowed overlap of two things, metres.
const TOLERANCE: f32 = 2e-3;

fn staged(style: Style, seed: u64) -> Stage {
    stage(style, &Assets::procedural(), &mut Pcg64::seed_from_u64(seed)).unwrap()
}

fn assert_equal(a: &Stage, b: &Stage) {
    assert_eq!(a.focus, b.focus);
    assert_eq!(a.world.lamps, b.world.lamps);
    assert_eq!(a.world.environment.map, b.world.environment.map);
    assert_eq!(a.world.objects.len(), b.world.objects.len());
    for (a, b) in a.world.objects.iter().zip(&b.world.objects) {
        assert_eq!(a.mesh, b.mesh);
        assert_eq!(a.world_from_object, b.world_from_object);
        assert!(a.material.albedo == b.material.albedo && a.material.roughness == b.material.roughness);
    }
}

#[test]
fn equal_seeds_give_equal_stages() {
    for style in Style::ALL {
        assert_equal(&staged(style, 3), &staged(style, 3));
    }
    assert_ne!(staged(Style::Terrain, 3).focus, staged(Style::Terrain, 4).focus);
}

#[test]
fn stages_surround_their_focus() {
    for style in Style::ALL {
        let Stage { world, focus } = staged(style, 1);
        assert!(focus.admits(&focus.axis), "{style:?}: the best place is a possible one");
        assert!(focus.radius > 0.05 && focus.radius < 5.0, "{style:?}: {focus:?}");
        let near = |object: &&Object| {
            let vertices = object.mesh.positions.iter();
            vertices
                .map(|&p| object.world_from_object * Point3::from(p).cast::<f64>())
                .any(|p| (p.coords - focus.centre).norm() < focus.radius)
        };
        assert!(world.objects.iter().filter(near).count() >= 1, "{style:?}: nothing to see");
        let finite = |object: &Object| object.mesh.positions.as_flattened().iter().all(|c| c.is_finite());
        assert!(world.objects.iter().all(finite));
    }
}

#[test]
fn lamps_shine_on_the_focus() {
    let lamps: Vec<_> = (0..6)
        .flat_map(|seed| {
            let focus = staged(Style::Terrain, seed).focus;
            light::lamps(&focus, &mut Pcg64::seed_from_u64(seed)).into_iter().map(move |lamp| (lamp, focus))
        })
        .collect();
    assert!(!lamps.is_empty());
    for (lamp, focus) in lamps {
        let normal = lamp.half_u.cross(&lamp.half_v);
        assert!(normal.dot(&(focus.centre - lamp.centre)) > 0.0);
        assert!(lamp.half_u.dot(&lamp.half_v).abs() < 1e-9 && lamp.centre.z > focus.centre.z);
    }
}

/// The surface of an object in the world; if it is closed, points can be tested for lying inside.
fn surface(object: &Object) -> TriMesh {
    let place = |&p: &[f32; 3]| {
        let p = object.world_from_object * Point3::from(p).cast::<f64>();
        Vector::new(p.x as f32, p.y as f32, p.z as f32)
    };
    let points = object.mesh.positions.iter().map(place).collect();
    let flags = TriMeshFlags::ORIENTED | TriMeshFlags::MERGE_DUPLICATE_VERTICES;
    TriMesh::with_flags(points, object.mesh.triangles.clone(), flags).unwrap()
}

/// Depth of the deepest vertex of `a` inside `b`, metres.
fn overlap(a: &TriMesh, b: &TriMesh) -> f32 {
    let bounds = b.local_aabb();
    let depth = |&vertex: &Vector| {
        let inside = b.project_local_point(vertex, true).is_inside;
        if inside { (b.project_local_point(vertex, false).point - vertex).length() } else { 0.0 }
    };
    a.vertices().iter().filter(|&&v| bounds.contains_local_point(v)).map(depth).fold(0.0, f32::max)
}

/// The largest gap between a thing and the nearest other object, and the deepest overlap of a thing with another
/// or with the ground, metres. The first object must be level ground at height 0.
fn worst_contact(world: &World) -> [f32; 2] {
    let surfaces: Vec<TriMesh> = world.objects.iter().map(surface).collect();
    let still = Pose::IDENTITY;
    let mut worst = [0.0_f32; 2];
    for (index, thing) in surfaces.iter().enumerate().skip(1) {
        let others = || surfaces.iter().enumerate().filter(|(other, _)| *other != index);
        let distance = |other| query::distance(&still, thing, &still, other).unwrap().distance;
        let gap = others().map(|(_, other)| distance(other)).fold(f32::INFINITY, f32::min);
        let deepest = others().skip(1).map(|(_, other)| overlap(thing, other)).fold(0.0, f32::max);
        let sunk = thing.vertices().iter().map(|v| -v.z).fold(0.0, f32::max);
        worst = [worst[0].max(gap), worst[1].max(deepest).max(sunk)];
    }
    worst
}

#[test]
fn things_rest_on_one_another() {
    let Stage { world, .. } = staged(Style::Clutter, 0);
    assert!(world.objects.len() > 12, "{} objects", world.objects.len());
    let [gap, overlap] = worst_contact(&world);
    assert!(gap < TOLERANCE, "a thing floats by {gap} m");
    assert!(overlap < TOLERANCE, "a thing is {overlap} m deep in another");
}

#[test]
fn names_of_styles_are_those_of_their_serialisation() {
    for style in Style::ALL {
        assert_eq!(serde_json::to_string(&style).unwrap(), format!("{:?}", style.name()));
    }
}

#[test]
fn a_focus_admits_its_cone_above_its_horizon() {
    let focus = Focus {
        centre: Vector3::zeros(),
        radius: 1.0,
        axis: Vector3::new(0.0, -1.0, 0.0),
        spread: 0.5,
        lowest: -0.1,
    };
    let at =
        |turn: f64, rise: f64| Vector3::new(turn.sin() * rise.cos(), -turn.cos() * rise.cos(), rise.sin());
    assert!(focus.admits(&at(0.4, 0.0)) && focus.admits(&at(0.0, 0.4)));
    assert!(!focus.admits(&at(0.6, 0.0)) && !focus.admits(&at(0.0, -0.2)));
}
