//! Geometric primitives as meshes. Texture coordinates are in metres along the surface. All are closed, except
//! [`rectangle`], [`heightfield`], [`pierced_wall`], and [`lathe`] with an open profile.

mod cuboid;
mod extrusion;
mod field;
mod lathe;
mod pierced;

pub use cuboid::{blob, cuboid, rounded_cuboid, sphere};
pub use extrusion::extrusion;
pub use field::{heightfield, rectangle};
pub use lathe::{cylinder, lathe, torus};
pub use pierced::{Opening, pierced_wall};

use crate::smoothing::Facets;

/// Adds a grid of `columns` × `rows` quadrilaterals; `vertex(column, row)` gives the position and texture
/// coordinates of a grid point. Seen from outside, columns go right and rows go up.
fn patch(
    facets: &mut Facets,
    [columns, rows]: [usize; 2],
    vertex: impl Fn(usize, usize) -> ([f32; 3], [f32; 2]),
) {
    let first = facets.positions.len();
    for row in 0..=rows {
        for column in 0..=columns {
            let (position, uv) = vertex(column, row);
            facets.positions.push(position);
            facets.uvs.push(uv);
        }
    }
    let index = |column: usize, row: usize| (first + row * (columns + 1) + column) as u32;
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let [a, b] = [index(column, row), index(column + 1, row)];
        let [d, c] = [index(column, row + 1), index(column + 1, row + 1)];
        facets.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

#[cfg(test)]
mod tests;
