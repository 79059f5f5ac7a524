//! Meshes from formulas. Texture coordinates are metres along the surface; all but the open
//! [`rectangle`], [`heightfield`] and [`pierced_wall`] are closed.

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

/// Adds a grid of `columns` × `rows` quadrilaterals; `vertex(column, row)` gives position and texture
/// coordinates of its corners. Its outside is where rows go up as columns go right.
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
