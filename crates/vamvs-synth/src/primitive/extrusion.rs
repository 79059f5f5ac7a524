//! Extrusions: a profile swept along a line, for ledges, mouldings and roofs.

use std::f32::consts::PI;

use super::patch;
use crate::Mesh;
use crate::smoothing::Facets;

/// Edges whose faces differ in direction by more than this (radians) stay sharp.
const CREASE: f32 = PI / 5.0;

/// The solid whose cross-section is `profile`, from x = −`length` / 2 to x = `length` / 2.
///
/// `profile` is a polygon of points (y, z), counter-clockwise as seen from +x; its last point is joined to its
/// first. From the first point the whole polygon must be visible, as the caps are triangle fans around it.
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

/// Adds a cap at `x`: a fan of triangles around the profile's first point.
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
