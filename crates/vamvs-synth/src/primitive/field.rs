//! Open surfaces over a rectangle of the plane z = 0; their outside is above.

use std::f32::consts::FRAC_PI_4;

use super::patch;
use crate::Mesh;
use crate::smoothing::Facets;

/// A rectangle of `size` (metres along x and y) in the plane z = 0, centred at the origin; its outside is above.
#[must_use]
pub fn rectangle(size: [f32; 2]) -> Mesh {
    heightfield(size, [1, 1], |_, _| 0.0)
}

/// The surface z = `height(x, y)` over a rectangle of `size` (metres) centred at the origin, as a grid of `cells`
/// along x and y.
#[must_use]
pub fn heightfield(size: [f32; 2], cells: [usize; 2], height: impl Fn(f32, f32) -> f32) -> Mesh {
    let mut facets = Facets::default();
    patch(&mut facets, cells, |column, row| {
        let x = size[0] * (column as f32 / cells[0] as f32 - 0.5);
        let y = size[1] * (row as f32 / cells[1] as f32 - 0.5);
        ([x, y, height(x, y)], [x, y])
    });
    facets.smooth(FRAC_PI_4)
}
