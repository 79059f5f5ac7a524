//! Joins the surfaces of blocks to one mesh.

use serde::{Deserialize, Serialize};
use vamvs_core::{Mesh, Rgb};

use crate::surface::Vertex;

/// The surface in a block of the volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockSurface {
    /// The number of vertices of each brick.
    pub(crate) counts: Vec<u16>,
    /// Relative to the volume's origin, scene units.
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colours: Vec<Rgb>,
    pub(crate) triangles: Vec<[Vertex; 3]>,
}

/// A mesh to which blocks are added in their order.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    mesh: Mesh,
    /// The number of each brick's first vertex.
    firsts: Vec<u32>,
    /// Corners of triangles that are vertices of bricks of later blocks.
    later: Vec<(usize, Vertex)>,
}

impl Assembly {
    /// Adds the next block.
    pub fn push(&mut self, surface: BlockSurface) {
        let mut first = self.mesh.positions.len() as u32;
        for count in surface.counts {
            self.firsts.push(first);
            first += u32::from(count);
        }
        self.mesh.positions.extend(surface.positions);
        self.mesh.colours.extend(surface.colours);
        for triangle in surface.triangles {
            let mut numbers = [u32::MAX; 3];
            for (corner, (number, vertex)) in numbers.iter_mut().zip(triangle).enumerate() {
                match self.number(vertex) {
                    Some(known) => *number = known,
                    None => self.later.push((3 * self.mesh.triangles.len() + corner, vertex)),
                }
            }
            self.mesh.triangles.push(numbers);
        }
    }

    /// The mesh of all blocks, relative to an origin.
    pub(crate) fn finish(mut self, origin: [f64; 3]) -> Mesh {
        for (corner, vertex) in std::mem::take(&mut self.later) {
            let number = self.number(vertex).expect("all bricks are in a block");
            self.mesh.triangles[corner / 3][corner % 3] = number;
        }
        Mesh { origin, ..self.mesh }
    }

    fn number(&self, vertex: Vertex) -> Option<u32> {
        Some(self.firsts.get(vertex.brick as usize)? + u32::from(vertex.number))
    }
}
