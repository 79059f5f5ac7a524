//! A profile pushed along a line: ledges, mouldings, frames.

use std::f32::consts::PI;

use super::patch;
use crate::Mesh;
use crate::smoothing::Facets;

/// Creases sharper than this stay sharp.
const CREASE: f32 = PI / 5.0;

/// The solid under a profile, from x = −`length` / 2 to x = `length` / 2.
///
/// `profile` holds points (y, z), counter-clockwise seen from +x, and is closed from its last point to
/// its first, which all of it must be visible from.
///
/// # Panics
/// If the profile has fewer than three points.
#[must_use]
pub fn extrusion(profile: &[[f32; 2]], length: f32) -> Mesh {
    assert!(profile.len() >= 3, "a profile needs three points");
    let half = 0.5 * length;
    let mut facets = Facets::default();
    let mut along = 0.0;
    for (index, &from) in profile.iter().enumerate() {
        let to = profile[(index + 1) % profile.len()];
        let step = f32::hypot(to[0] - from[0], to[1] - from[1]);
        patch(&mut facets, [1, 1], |column, row| {
            let ([y, z], v) = if column == 0 { (from, along) } else { (to, along + step) };
            let x = if row == 0 { -half } else { half };
            ([x, y, z], [x, v])
        });
        along += step;
    }
    add_cap(&mut facets, profile, -half);
    add_cap(&mut facets, profile, half);
    facets.smooth(CREASE)
}

/// A fan of triangles around the profile's first point.
fn add_cap(facets: &mut Facets, profile: &[[f32; 2]], x: f32) {
    let first = facets.positions.len() as u32;
    for &[y, z] in profile {
        facets.positions.push([x, y, z]);
        facets.uvs.push([y, z]);
    }
    for i in 1..profile.len() as u32 - 1 {
        let [a, b] = [first + i, first + i + 1];
        facets.triangles.push(if x > 0.0 { [first, a, b] } else { [first, b, a] });
    }
}
