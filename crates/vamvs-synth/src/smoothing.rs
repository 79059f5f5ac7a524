//! Vertex normals computed from triangles: smooth, except across creases.

use std::collections::HashMap;

use nalgebra::Vector3;

use crate::Mesh;

/// A mesh without normals.
#[derive(Clone, Debug, Default)]
pub struct Facets {
    /// Vertex positions in the object's frame.
    pub positions: Vec<[f32; 3]>,
    /// Texture coordinates, one per vertex.
    pub uvs: Vec<[f32; 2]>,
    /// Vertex indices of each triangle, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A corner of a triangle: the triangle's unit normal and its angle at the corner, radians.
struct Corner {
    face_normal: Vector3<f32>,
    angle: f32,
}

impl Facets {
    /// The mesh with vertex normals. A normal is the average, weighted by angle, over the triangles that meet
    /// at a position, whatever their texture coordinates, and whose normals differ by less than `crease`
    /// (radians). Triangles without area are left out.
    #[must_use]
    pub fn smooth(mut self, crease: f32) -> Mesh {
        let positions = &self.positions;
        self.triangles.retain(|triangle| cross(positions, triangle).norm_squared() > 0.0);
        let corners = self.corners();
        let mut fan = vec![Vec::new(); self.positions.len()];
        let places = places(&self.positions);
        for (corner, &vertex) in self.triangles.as_flattened().iter().enumerate() {
            fan[places[vertex as usize]].push(corner);
        }
        let normal = |corner: usize| {
            let vertex = self.triangles.as_flattened()[corner];
            average(&corners, corner, &fan[places[vertex as usize]], crease.cos())
        };
        let normals: Vec<[f32; 3]> = (0..corners.len()).map(normal).collect();
        self.split(&normals)
    }

    fn corners(&self) -> Vec<Corner> {
        let at = |vertex: u32| Vector3::from(self.positions[vertex as usize]);
        let corner = |[a, b, c]: [u32; 3], face_normal| {
            let angle = (at(b) - at(a)).angle(&(at(c) - at(a)));
            Corner { face_normal, angle }
        };
        let of_triangle = |&[a, b, c]: &[u32; 3]| {
            let normal = cross(&self.positions, &[a, b, c]).normalize();
            [corner([a, b, c], normal), corner([b, c, a], normal), corner([c, a, b], normal)]
        };
        self.triangles.iter().flat_map(of_triangle).collect()
    }

    /// The mesh with `normals`, one per corner: a vertex whose corners have different normals is duplicated.
    fn split(&self, normals: &[[f32; 3]]) -> Mesh {
        let mut mesh = Mesh::default();
        let mut known = HashMap::new();
        let mut indices = Vec::with_capacity(normals.len());
        for (&vertex, &normal) in self.triangles.as_flattened().iter().zip(normals) {
            let index = *known.entry((vertex, normal.map(f32::to_bits))).or_insert_with(|| {
                mesh.positions.push(self.positions[vertex as usize]);
                mesh.uvs.push(self.uvs[vertex as usize]);
                mesh.normals.push(normal);
                mesh.positions.len() as u32 - 1
            });
            indices.push(index);
        }
        mesh.triangles = indices.as_chunks::<3>().0.to_vec();
        mesh
    }
}

/// The triangle's normal, its length twice the area; 0 for a degenerate triangle. Computed in f64, so that
/// small triangles keep their direction.
fn cross(positions: &[[f32; 3]], &[a, b, c]: &[u32; 3]) -> Vector3<f32> {
    let at = |vertex: u32| Vector3::from(positions[vertex as usize]).cast::<f64>();
    let cross = (at(b) - at(a)).cross(&(at(c) - at(a)));
    let length = cross.norm();
    // Below this the direction is rounding error, and the triangle counts as having no area.
    if length > 1e-14 { cross.cast() } else { Vector3::zeros() }
}

/// For each vertex the index of the first vertex at the same position.
fn places(positions: &[[f32; 3]]) -> Vec<usize> {
    let mut first = HashMap::new();
    let place = |(index, position): (usize, &[f32; 3])| {
        // Adding 0 makes −0 and 0 the same bits.
        *first.entry(position.map(|c| (c + 0.0).to_bits())).or_insert(index)
    };
    positions.iter().enumerate().map(place).collect()
}

fn average(corners: &[Corner], corner: usize, fan: &[usize], cos_crease: f32) -> [f32; 3] {
    let own = corners[corner].face_normal;
    let sum: Vector3<f32> = fan
        .iter()
        .map(|&other| &corners[other])
        .filter(|other| other.face_normal.dot(&own) > cos_crease - 1e-6)
        .map(|other| other.face_normal * other.angle)
        .sum();
    sum.try_normalize(1e-12).unwrap_or(own).into()
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_PI_2, PI};

    use super::*;

    /// Two squares of side 1 that meet at the y axis, the second bent down by `angle`.
    fn bent(angle: f32) -> Facets {
        let far = [angle.cos(), 0.0, -angle.sin()];
        let positions =
            [[-1.0, 0.0, 0.0], [0.0; 3], far, [-1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [far[0], 1.0, far[2]]];
        Facets {
            positions: positions.to_vec(),
            uvs: vec![[0.0; 2]; 6],
            triangles: vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [0, 0, 1]],
        }
    }

    #[test]
    fn soft_edges_share_a_normal_and_creases_do_not() {
        let soft = bent(0.5).smooth(1.0);
        assert_eq!(
            (soft.positions.len(), soft.triangles.len()),
            (6, 4),
            "the degenerate triangle is left out"
        );
        let edge = soft.positions.iter().position(|p| *p == [0.0; 3]).unwrap();
        let normal = Vector3::from(soft.normals[edge]);
        assert!(normal.angle(&Vector3::new(0.25_f32.sin(), 0.0, 0.25_f32.cos())) < 0.1);
        let hard = bent(0.5).smooth(0.4);
        assert_eq!(hard.positions.len(), 8);
        for normal in &hard.normals {
            let tilt = Vector3::from(*normal).angle(&Vector3::z());
            assert!(tilt < 1e-3 || (tilt - 0.5).abs() < 1e-3);
        }
    }

    #[test]
    fn seams_of_texture_coordinates_stay_smooth() {
        let mut facets = bent(0.5);
        facets.positions.extend([[0.0; 3], [-0.0, 1.0, -0.0]]);
        facets.uvs.extend([[1.0; 2]; 2]);
        facets.triangles[2..4].copy_from_slice(&[[6, 2, 5], [6, 5, 7]]);
        let mesh = facets.smooth(PI);
        let at_edge: Vec<_> = (0..8)
            .filter(|&i| mesh.positions[i] == [0.0; 3])
            .map(|i| Vector3::from(mesh.normals[i]))
            .collect();
        assert_eq!(at_edge.len(), 2);
        assert!((at_edge[0] - at_edge[1]).norm() < 1e-6);
    }

    #[test]
    fn normals_have_unit_length() {
        for angle in [0.0, 1.0, FRAC_PI_2, 3.0] {
            let mesh = bent(angle).smooth(PI);
            assert!(mesh.normals.iter().all(|&n| (Vector3::from(n).norm() - 1.0).abs() < 1e-5));
        }
    }
}
