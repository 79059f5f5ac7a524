//! Cuboids with sharp or rounded edges, spheres and blobs: all are six grids, the faces of a cuboid.

use std::f32::consts::{FRAC_PI_4, PI};

use nalgebra::Vector3;

use super::patch;
use crate::Mesh;
use crate::noise::{Octaves, space};
use crate::smoothing::Facets;

/// Noise that dents blobs.
const DENTS: Octaves = Octaves { count: 3, gain: 0.45 };

/// For each face: the outward axis, and the axes that go right and up on it, each with its sign.
const FACES: [[(usize, f32); 3]; 6] = [
    [(0, 1.0), (1, 1.0), (2, 1.0)],
    [(1, 1.0), (0, -1.0), (2, 1.0)],
    [(0, -1.0), (1, -1.0), (2, 1.0)],
    [(1, -1.0), (0, 1.0), (2, 1.0)],
    [(2, 1.0), (1, 1.0), (0, -1.0)],
    [(2, -1.0), (1, 1.0), (0, 1.0)],
];

/// A box with sides of `size` along x, y and z (metres), centred at the origin.
#[must_use]
pub fn cuboid(size: [f32; 3]) -> Mesh {
    rounded_cuboid(size, 0.0, 0)
}

/// A sphere around the origin. Each of its six faces has `cells` × `cells` quadrilaterals; an odd number is
/// rounded up.
#[must_use]
pub fn sphere(radius: f32, cells: usize) -> Mesh {
    rounded_cuboid([2.0 * radius; 3], radius, cells.div_ceil(2))
}

/// A [`cuboid`] whose edges are rounded with `radius` (at most half the shortest side) in 2 × `cells` steps.
/// The texture runs continuously around the four sides; top and bottom continue that of the first side.
///
/// # Panics
/// If `radius` is not 0 but `cells` is 0.
#[must_use]
pub fn rounded_cuboid(size: [f32; 3], radius: f32, cells: usize) -> Mesh {
    assert!(radius == 0.0 || cells > 0, "a rounded edge needs cells");
    let lines = size.map(|side| Line::new(side, radius, cells));
    let mut facets = Facets::default();
    for face in 0..6 {
        add_face(&mut facets, &lines, face);
    }
    if radius == 0.0 {
        return facets.smooth(FRAC_PI_4);
    }
    let inner = size.map(|side| (0.5 * side - radius).max(0.0));
    for position in &mut facets.positions {
        *position = round(*position, inner, radius);
    }
    let mut mesh = facets.smooth(PI);
    for (normal, position) in mesh.normals.iter_mut().zip(&mesh.positions) {
        *normal = outwards(*position, inner).into();
    }
    mesh
}

/// An irregular ball of about `radius`: a [`sphere`] of `cells`, squeezed along the axes and dented by noise of
/// relative `amplitude` (0 to 0.5), with about `bumps` bumps around it.
#[must_use]
pub fn blob(radius: f32, cells: usize, amplitude: f32, bumps: f32, seed: u32) -> Mesh {
    let ball = sphere(radius, cells);
    let squeeze = [0, 1, 2].map(|axis| 1.0 + amplitude * space([axis as f32 + 0.5; 3], seed ^ 1));
    let place = |normal: &[f32; 3]| {
        let dent = DENTS.space(normal.map(|c| 10.0 + c * bumps / PI), seed);
        [0, 1, 2].map(|i| normal[i] * radius * (1.0 + amplitude * dent) * squeeze[i])
    };
    let positions = ball.normals.iter().map(place).collect();
    Facets { positions, uvs: ball.uvs, triangles: ball.triangles }.smooth(PI)
}

/// The grid lines across a face in one direction, relative to the middle of the face: their offsets on the sharp
/// box, and their distances along the rounded surface (arcs).
struct Line {
    offsets: Vec<f32>,
    arcs: Vec<f32>,
}

impl Line {
    fn new(side: f32, radius: f32, cells: usize) -> Self {
        let half = 0.5 * side;
        let inner = (half - radius).max(0.0);
        let step = |i: usize| FRAC_PI_4 * i as f32 / cells as f32;
        // The last line is exactly at the box's edge, so that faces join.
        let offset = |i: usize| if i == cells { half } else { inner + radius * step(i).tan() };
        let first = usize::from(inner == 0.0 && cells > 0);
        let upper: Vec<(f32, f32)> = (first..=cells)
            .map(|i| (offset(i), inner + if cells > 0 { radius * step(i) } else { 0.0 }))
            .collect();
        let lower = upper.iter().rev().map(|&(offset, arc)| (-offset, -arc));
        let middle = (first == 1).then_some((0.0, 0.0));
        let (offsets, arcs) = lower.chain(middle).chain(upper.iter().copied()).unzip();
        Self { offsets, arcs }
    }

    fn cells(&self) -> usize {
        self.offsets.len() - 1
    }

    fn length(&self) -> f32 {
        2.0 * self.arcs[self.cells()]
    }
}

fn add_face(facets: &mut Facets, lines: &[Line; 3], face: usize) {
    let [(out, out_sign), (right, right_sign), (up, up_sign)] = FACES[face];
    // In the texture, the sides form a row from left to right; top and bottom are above and below the first.
    let start_u = (0..face.min(4)).map(|side| lines[FACES[side][1].0].length()).sum::<f32>();
    let start = match face {
        4 => [0.0, lines[2].length()],
        5 => [0.0, -lines[up].length()],
        _ => [start_u, 0.0],
    };
    let grid = [lines[right].cells(), lines[up].cells()];
    patch(facets, grid, |column, row| {
        let mut position = [0.0; 3];
        position[out] = out_sign * lines[out].offsets[lines[out].cells()];
        position[right] = lines[right].offsets[signed(column, grid[0], right_sign)];
        position[up] = lines[up].offsets[signed(row, grid[1], up_sign)];
        let along = |line: &Line, index: usize| line.arcs[index] + 0.5 * line.length();
        (position, [start[0] + along(&lines[right], column), start[1] + along(&lines[up], row)])
    });
}

/// Index of a grid line along the axis; lines are counted backwards where the sign is negative.
fn signed(index: usize, last: usize, sign: f32) -> usize {
    if sign > 0.0 { index } else { last - index }
}

/// Moves a point on the surface of the sharp box onto the rounded box.
fn round(position: [f32; 3], inner: [f32; 3], radius: f32) -> [f32; 3] {
    let normal = outwards(position, inner);
    [0, 1, 2].map(|i| position[i].clamp(-inner[i], inner[i]) + radius * normal[i])
}

/// The unit vector away from the inner box, which is the normal of the rounded box.
fn outwards(position: [f32; 3], inner: [f32; 3]) -> Vector3<f32> {
    Vector3::from([0, 1, 2].map(|i| position[i] - position[i].clamp(-inner[i], inner[i]))).normalize()
}
