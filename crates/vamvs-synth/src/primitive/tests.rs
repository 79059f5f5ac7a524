//! Volumes, areas and topology of the primitives, compared with formulas.

use std::collections::{HashMap, HashSet};
use std::f64::consts::PI;

use nalgebra::Vector3;

use super::*;
use crate::Mesh;

fn corners(mesh: &Mesh, triangle: [u32; 3]) -> [Vector3<f64>; 3] {
    triangle.map(|vertex| Vector3::from(mesh.positions[vertex as usize]).cast())
}

/// The signed volume of a closed mesh: positive if its triangles face outwards.
fn volume(mesh: &Mesh) -> f64 {
    let of_triangle = |&triangle| {
        let [a, b, c] = corners(mesh, triangle);
        a.dot(&b.cross(&c)) / 6.0
    };
    mesh.triangles.iter().map(of_triangle).sum()
}

fn area(mesh: &Mesh) -> f64 {
    let of_triangle = |&triangle| {
        let [a, b, c] = corners(mesh, triangle);
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    mesh.triangles.iter().map(of_triangle).sum()
}

/// The Euler characteristic, vertices − edges + faces, after merging vertices at the same position. Asserts that
/// the mesh is closed and consistently oriented: every edge is used once in each direction.
fn euler(mesh: &Mesh) -> i64 {
    let mut places = HashMap::new();
    let place: Vec<usize> = mesh
        .positions
        .iter()
        .enumerate()
        .map(|(i, p)| *places.entry(p.map(|c| (c + 0.0).to_bits())).or_insert(i))
        .collect();
    let mut edges = HashSet::new();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| place[v as usize]);
        for edge in [(a, b), (b, c), (c, a)] {
            assert!(edges.insert(edge), "edge {edge:?} is used twice in one direction");
        }
    }
    assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))), "the mesh has a border");
    places.len() as i64 - edges.len() as i64 / 2 + mesh.triangles.len() as i64
}

/// Asserts that normals have unit length and point to the same side as their triangles.
fn assert_normals(mesh: &Mesh) {
    for &triangle in &mesh.triangles {
        let [a, b, c] = corners(mesh, triangle);
        let face = (b - a).cross(&(c - a)).normalize();
        for vertex in triangle {
            let normal = Vector3::from(mesh.normals[vertex as usize]).cast::<f64>();
            assert!((normal.norm() - 1.0).abs() < 1e-5);
            assert!(normal.dot(&face) > 0.5, "{normal:?} against {face:?}");
        }
    }
}

fn assert_close(found: f64, expected: f64, relative: f64) {
    assert!((found / expected - 1.0).abs() < relative, "found {found}, expected {expected}");
}

/// The smallest and the largest ratio, over all triangles, of area in space to area in texture coordinates.
fn stretch(mesh: &Mesh) -> (f64, f64) {
    let ratios = mesh.triangles.iter().map(|&triangle| {
        let [a, b, c] = corners(mesh, triangle);
        let [p, q, r] = triangle.map(|v| mesh.uvs[v as usize].map(f64::from));
        let image = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        (b - a).cross(&(c - a)).norm() / image.abs()
    });
    ratios.fold((f64::INFINITY, 0.0), |(low, high), ratio| (low.min(ratio), high.max(ratio)))
}

#[test]
fn cuboids_are_exact() {
    let mesh = cuboid([1.0, 2.0, 0.5]);
    assert_eq!((mesh.triangles.len(), mesh.positions.len(), euler(&mesh)), (12, 24, 2));
    assert_close(volume(&mesh), 1.0, 1e-6);
    assert_close(area(&mesh), 2.0 * (2.0 + 0.5 + 1.0), 1e-6);
    assert_normals(&mesh);
    let (low, high) = stretch(&mesh);
    assert!(low > 0.999 && high < 1.001, "texture coordinates are metres");
}

#[test]
fn spheres_are_round() {
    let mesh = sphere(0.3, 48);
    assert_eq!(euler(&mesh), 2);
    assert_close(volume(&mesh), 4.0 / 3.0 * PI * 0.027, 2e-3);
    assert_close(area(&mesh), 4.0 * PI * 0.09, 2e-3);
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let position = Vector3::from(*position);
        assert!((position.norm() - 0.3).abs() < 1e-6);
        assert!((position / 0.3 - Vector3::from(*normal)).norm() < 1e-5);
    }
    let (low, high) = stretch(&mesh);
    assert!(low > 0.6 && high < 1.3, "texture stretched from {low} to {high}");
}

#[test]
fn rounded_cuboids_are_boxes_blown_up_by_a_ball() {
    let (inner, r) = ([0.8, 0.4, 0.1], 0.1);
    let mesh = rounded_cuboid([1.0, 0.6, 0.3], r as f32, 12);
    assert_eq!(euler(&mesh), 2);
    assert_normals(&mesh);
    // Steiner's formula: volume, plus area × r, plus edge lengths × πr²/4, plus a ball for the corners.
    let [a, b, c] = inner;
    let exact =
        a * b * c + 2.0 * (a * b + b * c + c * a) * r + PI * r * r * (a + b + c) + 4.0 / 3.0 * PI * r * r * r;
    assert_close(volume(&mesh), exact, 2e-3);
}

#[test]
fn cylinders_are_prisms_of_many_sides() {
    let (radius, height, sides) = (0.2, 0.7, 48);
    let mesh = cylinder(radius, height, sides);
    assert_eq!(euler(&mesh), 2);
    assert_normals(&mesh);
    let polygon = 0.5 * 48.0 * 0.04 * (2.0 * PI / 48.0).sin();
    assert_close(volume(&mesh), polygon * 0.7, 1e-5);
    let rim = mesh.uvs.iter().map(|uv| uv[0]).fold(0.0, f32::max);
    assert_close(rim.into(), 2.0 * PI * 0.2, 1e-5);
}

#[test]
fn rings_have_a_hole() {
    let mesh = torus(0.3, 0.1, 96);
    assert_eq!(euler(&mesh), 0);
    assert_normals(&mesh);
    assert_close(volume(&mesh), 2.0 * PI * PI * 0.3 * 0.01, 5e-3);
}

#[test]
fn bowls_are_hollow() {
    let profile = [[0.0, 0.0], [0.1, 0.0], [0.2, 0.2], [0.18, 0.2], [0.09, 0.02], [0.0, 0.02]];
    let mesh = lathe(&profile, 64);
    assert_eq!(euler(&mesh), 2);
    let frustum = |r0: f64, r1: f64, h: f64| PI * h / 3.0 * (r0 * r0 + r0 * r1 + r1 * r1);
    assert_close(volume(&mesh), frustum(0.1, 0.2, 0.2) - frustum(0.09, 0.18, 0.18), 1e-2);
}

#[test]
fn blobs_are_closed_and_vary() {
    for seed in 0..4 {
        let mesh = blob(0.1, 24, 0.4, 3.0, seed);
        assert_eq!(euler(&mesh), 2);
        assert!(volume(&mesh) > 0.3 * 4.2e-3);
        let distance: Vec<f32> = mesh.positions.iter().map(|p| Vector3::from(*p).norm()).collect();
        let (low, high) = distance.iter().fold((1.0_f32, 0.0_f32), |(l, h), &d| (l.min(d), h.max(d)));
        assert!(low > 0.03 && high < 0.2 && high > 1.2 * low, "{low} to {high}");
    }
    assert_ne!(blob(0.1, 24, 0.4, 3.0, 0), blob(0.1, 24, 0.4, 3.0, 1));
}

#[test]
fn extrusions_are_closed_prisms() {
    let profile = [[0.0, 0.0], [-0.1, 0.0], [-0.3, 0.2], [-0.3, 0.3], [0.0, 0.3]];
    let mut turned = profile;
    turned.reverse();
    let mesh = extrusion(&turned, 2.0);
    assert_eq!(euler(&mesh), 2);
    assert_normals(&mesh);
    assert_close(volume(&mesh), 2.0 * (0.3 * 0.3 - 0.5 * 0.2 * 0.2), 1e-5);
}

#[test]
fn heightfields_follow_their_function() {
    let mesh = heightfield([2.0, 1.0], [20, 10], |x, y| 0.3 * x - 0.1 * y);
    assert_normals(&mesh);
    assert_close(area(&mesh), 2.0 * (1.0_f64 + 0.09 + 0.01).sqrt(), 1e-5);
    assert!(mesh.positions.iter().all(|&[x, y, z]| (z - 0.3 * x + 0.1 * y).abs() < 1e-6));
    let flat = rectangle([2.0, 1.0]);
    assert!(flat.normals.iter().all(|&normal| normal == [0.0, 0.0, 1.0]));
    assert_eq!(flat.uvs[0], [-1.0, -0.5]);
}

#[test]
fn pierced_walls_are_walls_less_their_openings() {
    let outline = Opening { x: [-2.0, 2.0], z: [0.0, 3.0] };
    let openings = [Opening { x: [-1.0, 0.0], z: [0.5, 1.5] }, Opening { x: [0.5, 1.0], z: [1.0, 2.5] }];
    let mesh = pierced_wall(&outline, &openings, 0.2);
    assert_normals(&mesh);
    assert_close(area(&mesh), 12.0 - 1.0 - 0.75 + 0.2 * (4.0 + 4.0), 1e-5);
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let inside = position[1] > 0.0;
        assert!(normal[1] == -1.0 || inside || normal[1] == 0.0);
    }
    // The sides of an opening face its middle.
    for &triangle in &mesh.triangles {
        let [a, b, c] = corners(&mesh, triangle);
        let (normal, middle) = ((b - a).cross(&(c - a)), (a + b + c) / 3.0);
        if normal.y.abs() < 1e-9 {
            let of = if middle.x < 0.25 { [-0.5, 1.0] } else { [0.75, 1.75] };
            assert!(normal.dot(&(Vector3::new(of[0], middle.y, of[1]) - middle)) > 0.0);
        }
    }
}
