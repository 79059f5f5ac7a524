//! Makes a mesh a manifold: no more than two triangles at an edge, and one fan of them at a vertex.
//!
//! Where two parts of a surface touch along an edge or at a vertex of the grid, they share vertices. Here each gets its
//! own (Guéziec et al., "Cutting and stitching").

use std::f32::consts::TAU;

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::Mesh;

use crate::sets::Sets;

/// A side of a triangle: its lower and upper vertex, and its number, 3 × triangle + place.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Side {
    pub vertices: [u32; 2],
    pub number: u32,
}

/// Gives parts of a surface that only touch vertices of their own.
pub(crate) fn separate(mesh: &mut Mesh) {
    part_fans(mesh);
    while divide_double_edges(mesh) {
        part_fans(mesh);
    }
}

/// The sides of all triangles, in the order of their edges' vertices.
pub(crate) fn sides(mesh: &Mesh) -> Vec<Side> {
    let corners = mesh.triangles.as_flattened();
    let side = |number: u32| {
        let [a, b] = [corners[number as usize], corners[next(number) as usize]];
        Side { vertices: [a.min(b), a.max(b)], number }
    };
    // First by the lower vertex alone: where those of each begin.
    let mut begins = vec![0_u32; mesh.positions.len() + 1];
    let numbers = 0..corners.len() as u32;
    numbers.clone().for_each(|number| begins[side(number).vertices[0] as usize + 1] += 1);
    begins.iter_mut().fold(0, |sum, begin| {
        *begin += sum;
        *begin
    });
    let mut sides = vec![Side { vertices: [0; 2], number: 0 }; corners.len()];
    for side in numbers.map(side) {
        let place = &mut begins[side.vertices[0] as usize];
        sides[*place as usize] = side;
        *place += 1;
    }
    sides.par_chunk_by_mut(|a, b| a.vertices[0] == b.vertices[0]).for_each(<[Side]>::sort_unstable);
    sides
}

/// Gives each fan of triangles around a vertex a vertex of its own.
fn part_fans(mesh: &mut Mesh) {
    let sides = sides(mesh);
    // Corners of triangles that are around a vertex.
    let mut fans = Sets::new(sides.len());
    for edge in sides.chunk_by(|a, b| a.vertices == b.vertices) {
        let pairs = match edge {
            [_] => Vec::new(),
            [a, b] if !is_double(mesh, edge) => vec![[a.number, b.number]],
            _ => pairs(mesh, edge),
        };
        for [a, b] in pairs {
            // The sides run in opposite directions.
            fans.join(a, next(b));
            fans.join(next(a), b);
        }
    }
    let mut owner = vec![u32::MAX; mesh.positions.len()];
    let mut copies: Vec<u32> = Vec::new();
    for corner in 0..sides.len() as u32 {
        let fan = fans.find(corner);
        if fan != corner {
            continue;
        }
        // The first corner of each fan but a vertex' first makes a copy of the vertex.
        let vertex = mesh.triangles[corner as usize / 3][corner as usize % 3] as usize;
        if owner[vertex] == u32::MAX {
            owner[vertex] = corner;
        } else {
            copies.push(corner);
        }
    }
    let first = mesh.positions.len() as u32;
    for &corner in &copies {
        let vertex = mesh.triangles[corner as usize / 3][corner as usize % 3];
        mesh.positions.push(mesh.positions[vertex as usize]);
        mesh.colours.extend(mesh.colours.get(vertex as usize).copied());
    }
    for corner in 0..sides.len() as u32 {
        if let Ok(copy) = copies.binary_search(&fans.find(corner)) {
            mesh.triangles[corner as usize / 3][corner as usize % 3] = first + copy as u32;
        }
    }
}

/// Whether more than two triangles are at an edge, or two of which one would have to be turned over.
fn is_double(mesh: &Mesh, edge: &[Side]) -> bool {
    match edge {
        [a, b] => runs_up(mesh, a) == runs_up(mesh, b),
        _ => edge.len() > 2,
    }
}

fn runs_up(mesh: &Mesh, side: &Side) -> bool {
    mesh.triangles[side.number as usize / 3][side.number as usize % 3] == side.vertices[0]
}

/// Divides double edges although both their vertices have one fan: all but one pair of triangles get a vertex in the middle.
/// Returns whether there were any.
fn divide_double_edges(mesh: &mut Mesh) -> bool {
    let sides = sides(mesh);
    let double = sides.chunk_by(|a, b| a.vertices == b.vertices).filter(|edge| is_double(mesh, edge));
    let divided: Vec<Vec<u32>> = double.flat_map(|edge| groups(mesh, edge).into_iter().skip(1)).collect();
    let mut is_touched = vec![false; mesh.triangles.len()];
    for group in &divided {
        if group.iter().any(|&side| std::mem::replace(&mut is_touched[side as usize / 3], true)) {
            continue;
        }
        let ends = [group[0], next(group[0])]
            .map(|corner| mesh.triangles[corner as usize / 3][corner as usize % 3] as usize);
        let middle = mesh.positions.len() as u32;
        let [a, b] = ends.map(|end| Vector3::from(mesh.positions[end]));
        mesh.positions.push(((a + b) / 2.0).into());
        mesh.colours.extend(mesh.colours.get(ends[0]).copied());
        for &corner in group {
            let triangle = corner as usize / 3;
            let mut second = mesh.triangles[triangle];
            second[corner as usize % 3] = middle;
            mesh.triangles[triangle][next(corner) as usize % 3] = middle;
            mesh.triangles.push(second);
        }
    }
    !divided.is_empty()
}

/// The corner behind this one in its triangle.
fn next(corner: u32) -> u32 {
    if corner % 3 == 2 { corner - 2 } else { corner + 1 }
}

/// The pairs of sides at an edge, and those that are left alone.
fn groups(mesh: &Mesh, edge: &[Side]) -> Vec<Vec<u32>> {
    let mut groups: Vec<Vec<u32>> = pairs(mesh, edge).iter().map(|pair| pair.to_vec()).collect();
    let is_alone = |side: &&Side| !groups.iter().flatten().any(|&number| number == side.number);
    let alone: Vec<Vec<u32>> = edge.iter().filter(is_alone).map(|side| vec![side.number]).collect();
    groups.extend(alone);
    groups
}

/// Pairs the sides at an edge of more than two triangles so that the inside between both is not crossed by another.
fn pairs(mesh: &Mesh, edge: &[Side]) -> Vec<[u32; 2]> {
    let position = |vertex: u32| Vector3::from(mesh.positions[vertex as usize]);
    let [low, high] = edge[0].vertices.map(position);
    let axis = (high - low).try_normalize(0.0).unwrap_or_else(Vector3::x);
    let across = axis.cross(&if axis.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() });
    let angle = |side: &Side| {
        let opposite = next(next(side.number));
        let vertex = mesh.triangles[opposite as usize / 3][opposite as usize % 3];
        let arm = position(vertex) - low;
        arm.dot(&axis.cross(&across)).atan2(arm.dot(&across))
    };
    let mut down: Vec<(f32, u32)> =
        edge.iter().filter(|side| !runs_up(mesh, side)).map(|side| (angle(side), side.number)).collect();
    let mut pairs = Vec::new();
    for side in edge.iter().filter(|side| runs_up(mesh, side)) {
        // The inside is to the right of a triangle that runs up, seen from above: at smaller angles.
        let angle = angle(side);
        let turn = |other: &(f32, u32)| (angle - other.0).rem_euclid(TAU);
        let nearest = (0..down.len()).min_by(|&a, &b| turn(&down[a]).total_cmp(&turn(&down[b])));
        if let Some(nearest) = nearest {
            pairs.push([side.number, down.swap_remove(nearest).1]);
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_that_run_the_same_way_along_an_edge_share_it_no_more() {
        let positions =
            [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]].map(|x: [i8; 3]| x.map(f32::from)).to_vec();
        // A band that is turned over once: 2 and 3 are joined by triangles on both sides of the edge from 0 to 1.
        let triangles = vec![[0, 1, 2], [0, 1, 3], [1, 3, 2]];
        let mut mesh = Mesh { positions, triangles, ..Mesh::default() };
        separate(&mut mesh);
        let sides = sides(&mesh);
        let mut edges = sides.chunk_by(|a, b| a.vertices == b.vertices);
        assert!(edges.all(|edge| edge.len() < 3 && !is_double(&mesh, edge)), "{:?}", mesh.triangles);
    }

    #[test]
    fn two_tetrahedra_that_touch_in_an_edge_become_two() {
        let positions = [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [-1, -1, 0]];
        let positions = positions.map(|x: [i8; 3]| x.map(f32::from)).to_vec();
        // Outwards, each with the edge from 0 to 1.
        let tetrahedron = |a: u32, b: u32| [[0, b, a], [0, a, 1], [0, 1, b], [a, b, 1]];
        let triangles = [tetrahedron(2, 3), tetrahedron(4, 5)].concat();
        let mut mesh = Mesh { positions, triangles, ..Mesh::default() };
        separate(&mut mesh);
        assert_eq!(mesh.positions.len(), 8);
        let used =
            |half: &[[u32; 3]]| half.iter().flatten().copied().collect::<std::collections::BTreeSet<_>>();
        let (one, other) = (used(&mesh.triangles[..4]), used(&mesh.triangles[4..]));
        assert_eq!((one.len(), other.len()), (4, 4));
        assert!(one.is_disjoint(&other));
    }
}
