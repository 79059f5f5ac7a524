//! Shapes of procedural things, in metres: a few centimetres to 20 cm large.

use std::f32::consts::{FRAC_PI_2, PI};

use rand::RngExt;
use rand_pcg::Pcg64;

use crate::Mesh;
use crate::primitive::{blob, lathe, rounded_cuboid, sphere, torus};

/// Number of faces around a solid of revolution.
const SIDES: usize = 64;

/// A random shape.
pub(super) fn random(rng: &mut Pcg64) -> Mesh {
    match rng.random_range(0..20) {
        0..7 => carton(rng),
        7..10 => can(rng),
        10..12 => sphere(rng.random_range(0.02..0.06), 32),
        12..15 => stone(rng),
        15..17 => bottle(rng),
        17 => cup(rng),
        18 => torus(rng.random_range(0.03..0.05), rng.random_range(0.008..0.02), SIDES),
        _ => cone(rng),
    }
}

fn stone(rng: &mut Pcg64) -> Mesh {
    let (radius, amplitude) = (rng.random_range(0.03..0.07), rng.random_range(0.1..0.4));
    blob(radius, 32, amplitude, rng.random_range(2.0..5.0), rng.random())
}

fn carton(rng: &mut Pcg64) -> Mesh {
    let size: [f32; 3] = std::array::from_fn(|_| rng.random_range(0.025..0.2));
    let shortest = size.into_iter().fold(f32::INFINITY, f32::min);
    rounded_cuboid(size, shortest * rng.random_range(0.01..0.15), 4)
}

/// A cylinder with rounded edges.
fn can(rng: &mut Pcg64) -> Mesh {
    let (radius, height) = (rng.random_range(0.02..0.055), rng.random_range(0.03..0.18));
    let edge = rng.random_range(0.001..0.006);
    let mut profile = vec![[0.0, 0.0]];
    profile.extend(arc([radius - edge, edge], edge, -FRAC_PI_2..0.0));
    profile.extend(arc([radius - edge, height - edge], edge, 0.0..FRAC_PI_2));
    profile.push([0.0, height]);
    lathe(&profile, SIDES)
}

fn bottle(rng: &mut Pcg64) -> Mesh {
    let (radius, neck) = (rng.random_range(0.025..0.045), rng.random_range(0.01..0.018));
    let height = rng.random_range(0.1..0.2);
    let shoulder = height * rng.random_range(0.5..0.75);
    let mut profile = vec![[0.0, 0.0], [radius, 0.0], [radius, shoulder]];
    let blend = |t: f32| {
        [neck + (radius - neck) * 0.5 * (1.0 + (PI * t).cos()), shoulder + 0.6 * t * (height - shoulder)]
    };
    profile.extend((1..=8).map(|i| blend(i as f32 / 8.0)));
    profile.extend([[neck, height], [0.0, height]]);
    lathe(&profile, SIDES)
}

/// Hollow, usually wider at the top.
fn cup(rng: &mut Pcg64) -> Mesh {
    let (foot, rim) = (rng.random_range(0.025..0.04), rng.random_range(0.035..0.08));
    let (height, wall) = (rng.random_range(0.04..0.1), rng.random_range(0.003..0.006));
    let outer = |t: f32| [foot + (rim - foot) * (FRAC_PI_2 * t).sin(), height * t];
    let mut profile = vec![[0.0, 0.0]];
    profile.extend((0..=8).map(|i| outer(i as f32 / 8.0)));
    profile.extend((0..=8).rev().map(|i| outer(i as f32 / 8.0)).map(|[r, z]| [r - wall, z.max(wall)]));
    profile.push([0.0, wall]);
    lathe(&profile, SIDES)
}

fn cone(rng: &mut Pcg64) -> Mesh {
    let (foot, top) = (rng.random_range(0.03..0.06), rng.random_range(0.004..0.025));
    let height = rng.random_range(0.05..0.15);
    lathe(&[[0.0, 0.0], [foot, 0.0], [foot, 0.005], [top, height], [0.0, height]], SIDES)
}

/// Five points on an arc around `centre`, as (distance from the axis, z); angles in radians.
fn arc(centre: [f32; 2], radius: f32, angles: std::ops::Range<f32>) -> impl Iterator<Item = [f32; 2]> {
    (0..=4).map(move |i| {
        let angle = angles.start + (angles.end - angles.start) * i as f32 / 4.0;
        [centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin()]
    })
}
