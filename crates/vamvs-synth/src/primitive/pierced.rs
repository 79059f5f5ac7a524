//! A wall with rectangular openings.

use std::f32::consts::FRAC_PI_4;

use super::patch;
use crate::Mesh;
use crate::smoothing::Facets;

/// A rectangle in the plane of a wall, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Opening {
    /// Left and right border.
    pub x: [f32; 2],
    /// Lower and upper border.
    pub z: [f32; 2],
}

/// The front of a wall in the plane y = 0, facing −y, over the rectangle `outline`, together with the inner sides
/// of its `openings`, which are `depth` metres deep. It has no back. Openings must not overlap.
#[must_use]
pub fn pierced_wall(outline: &Opening, openings: &[Opening], depth: f32) -> Mesh {
    let lines = |outer: [f32; 2], inner: fn(&Opening) -> [f32; 2]| {
        let mut lines: Vec<f32> = openings.iter().flat_map(inner).chain(outer).collect();
        lines.sort_by(f32::total_cmp);
        lines.dedup();
        lines
    };
    let xs = lines(outline.x, |opening| opening.x);
    let zs = lines(outline.z, |opening| opening.z);
    let mut facets = Facets::default();
    for x in xs.windows(2) {
        for z in zs.windows(2) {
            let middle = [0.5 * (x[0] + x[1]), 0.5 * (z[0] + z[1])];
            if !openings.iter().any(|opening| opening.contains(middle)) {
                add_front(&mut facets, [x[0], x[1]], [z[0], z[1]]);
            }
        }
    }
    for opening in openings {
        add_sides(&mut facets, opening, depth);
    }
    facets.smooth(FRAC_PI_4)
}

impl Opening {
    fn contains(&self, [x, z]: [f32; 2]) -> bool {
        x > self.x[0] && x < self.x[1] && z > self.z[0] && z < self.z[1]
    }
}

fn add_front(facets: &mut Facets, x: [f32; 2], z: [f32; 2]) {
    patch(facets, [1, 1], |column, row| ([x[column], 0.0, z[row]], [x[column], z[row]]));
}

/// Adds the four inner sides of an opening; they face into it.
fn add_sides(facets: &mut Facets, &Opening { x, z }: &Opening, depth: f32) {
    let corners = [[x[0], z[0]], [x[1], z[0]], [x[1], z[1]], [x[0], z[1]]];
    for side in 0..4 {
        let ends = [corners[side], corners[(side + 1) % 4]];
        patch(facets, [1, 1], |column, row| {
            let ([x, z], y) = (ends[column], depth * row as f32);
            let along = if side % 2 == 0 { x } else { z };
            ([x, y, z], [along, y])
        });
    }
}
