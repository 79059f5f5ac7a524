//! Solids of revolution about the z axis.

use std::f32::consts::{PI, TAU};

use super::patch;
use crate::Mesh;
use crate::smoothing::Facets;

/// Edges whose faces differ in direction by more than this (radians) stay sharp.
const CREASE: f32 = PI / 5.0;

/// A cylinder about the z axis, centred at the origin, approximated by a prism of `sides` sides.
#[must_use]
pub fn cylinder(radius: f32, height: f32, sides: usize) -> Mesh {
    let half = 0.5 * height;
    lathe(&[[0.0, -half], [radius, -half], [radius, half], [0.0, half]], sides)
}

/// A torus about the z axis: a circle of radius `thickness`, its centre at distance `radius` from the axis.
#[must_use]
pub fn torus(radius: f32, thickness: f32, sides: usize) -> Mesh {
    let steps = sides / 2;
    let point = |i: usize| {
        let angle = TAU * (i % steps) as f32 / steps as f32;
        [radius + thickness * angle.cos(), thickness * angle.sin()]
    };
    let profile: Vec<[f32; 2]> = (0..=steps).map(point).collect();
    lathe(&profile, sides)
}

/// The solid of revolution of `profile`, points (distance from the axis, z), about the z axis, in `sides` steps. The
/// solid is on the left of the profile; it is closed if the profile begins and ends on the axis, or at the same
/// point. The texture is projected from above onto nearly level parts, and wrapped around the others.
#[must_use]
pub fn lathe(profile: &[[f32; 2]], sides: usize) -> Mesh {
    let turns: Vec<[f32; 2]> = (0..=sides).map(|side| turn(side % sides, sides)).collect();
    let widest = profile.iter().map(|point| point[0]).fold(0.0, f32::max);
    let mut facets = Facets::default();
    let mut along = 0.0;
    for pair in profile.windows(2) {
        let ([r0, z0], [r1, z1]) = (pair[0], pair[1]);
        let level = (z1 - z0).abs() < 0.3 * (r1 - r0).abs();
        let step = f32::hypot(r1 - r0, z1 - z0);
        patch(&mut facets, [sides, 1], |side, row| {
            let (r, z, v) = if row == 0 { (r0, z0, along) } else { (r1, z1, along + step) };
            let [x, y] = turns[side].map(|c| c * r);
            let around = widest * TAU * side as f32 / sides as f32;
            ([x, y, z], if level { [x, y] } else { [around, v] })
        });
        along += step;
    }
    facets.smooth(CREASE)
}

/// Cosine and sine of `side` / `sides` of a full turn.
fn turn(side: usize, sides: usize) -> [f32; 2] {
    let angle = TAU * side as f32 / sides as f32;
    [angle.cos(), angle.sin()]
}
