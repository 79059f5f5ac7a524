//! A triangle mesh with colours and normals.

use nalgebra::Vector3;

use crate::{CloudPoint, Rgb};

/// A triangle mesh. Vertices have numbers; triangles are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions are relative to this point of the world.
    pub origin: [f64; 3],
    /// The vertices' positions, relative to the origin, scene units.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals of the vertices in the world, to the outside.
    pub normals: Vec<[f32; 3]>,
    /// Colours of the vertices.
    pub colours: Vec<Rgb>,
    /// The vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A mesh of these vertices, with their normals and colours.
    #[must_use]
    pub fn of(vertices: &[CloudPoint], triangles: Vec<[u32; 3]>) -> Self {
        let origin = vertices.first().map(|vertex| vertex.x_in_world).unwrap_or_default();
        let relative = |x: &CloudPoint| [0, 1, 2].map(|axis| (x.x_in_world[axis] - origin[axis]) as f32);
        Self {
            origin,
            positions: vertices.iter().map(relative).collect(),
            normals: vertices.iter().map(|vertex| vertex.normal).collect(),
            colours: vertices.iter().map(|vertex| vertex.colour).collect(),
            triangles,
        }
    }

    /// A vertex' position in the world.
    #[must_use]
    pub fn x_in_world(&self, vertex: u32) -> Vector3<f64> {
        let relative: Vector3<f32> = self.positions[vertex as usize].into();
        Vector3::from(self.origin) + relative.cast()
    }

    /// The positions of a triangle's vertices, relative to the origin.
    #[must_use]
    pub fn corners(&self, triangle: [u32; 3]) -> [Vector3<f32>; 3] {
        triangle.map(|vertex| self.positions[vertex as usize].into())
    }

    /// Sets the normals of the vertices to the mean of their triangles', weighted by area; along z where all of these have no area.
    pub fn set_normals(&mut self) {
        let mut sums = vec![Vector3::<f32>::zeros(); self.positions.len()];
        for &triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle);
            let normal = (b - a).cross(&(c - a));
            triangle.iter().for_each(|&vertex| sums[vertex as usize] += normal);
        }
        let unit = |sum: Vector3<f32>| sum.try_normalize(f32::MIN_POSITIVE).unwrap_or_else(Vector3::z).into();
        self.normals = sums.into_iter().map(unit).collect();
    }

    /// Keeps the triangles for which `is_kept` holds of their number, and the vertices that they have.
    pub fn retain(&mut self, is_kept: impl Fn(usize) -> bool) {
        let mut number = 0;
        self.triangles.retain(|_| {
            number += 1;
            is_kept(number - 1)
        });
        let mut new = vec![u32::MAX; self.positions.len()];
        self.triangles.iter().flatten().for_each(|&vertex| new[vertex as usize] = 0);
        let mut count = 0;
        for (old, new) in new.iter_mut().enumerate().filter(|(_, new)| **new == 0) {
            *new = count as u32;
            self.positions[count] = self.positions[old];
            if let Some(normal) = self.normals.get(old).copied() {
                self.normals[count] = normal;
            }
            if let Some(colour) = self.colours.get(old).copied() {
                self.colours[count] = colour;
            }
            count += 1;
        }
        self.positions.truncate(count);
        self.normals.truncate(count);
        self.colours.truncate(count);
        self.triangles.iter_mut().flatten().for_each(|vertex| *vertex = new[*vertex as usize]);
    }
}
