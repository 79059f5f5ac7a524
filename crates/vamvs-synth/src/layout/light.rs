//! Random light: the environment and up to three lamps.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::RngExt;
use rand_pcg::Pcg64;

use super::{Focus, Style};
use crate::assets::{AssetError, Assets};
use crate::{Environment, Lamp};

/// A random environment of random strength: level ground gets an irradiance of 0.4 to 1.3 times π from it.
/// Streets are mostly under a sky.
pub(super) fn environment(style: Style, assets: &Assets, rng: &mut Pcg64) -> Result<Environment, AssetError> {
    let environment = match style {
        Style::Street => assets.outdoors(rng)?,
        _ => assets.environment(rng)?,
    };
    Ok(Environment { strength: environment.strength * rng.random_range(0.4..1.3), ..environment })
}

/// Up to three lamps of random size, place and strength, on the side of the cameras.
pub(super) fn lamps(focus: &Focus, rng: &mut Pcg64) -> Vec<Lamp> {
    let count = rng.random_range(0..=3);
    (0..count).map(|_| lamp(focus, rng)).collect()
}

fn lamp(focus: &Focus, rng: &mut Pcg64) -> Lamp {
    let towards = direction(focus, rng);
    let distance = focus.radius * rng.random_range(2.0..4.0);
    let half = focus.radius * rng.random_range(0.1..0.6);
    let u = towards.cross(&Vector3::new(0.3, -0.5, 0.8)).normalize();
    let v = u.cross(&towards);
    // The lamp emits along half_u × half_v, which points to −`towards`: at the focus.
    let (half_u, half_v) = (half * u, half * rng.random_range(0.4..1.0) * v);
    let area = 4.0 * half_u.norm() * half_v.norm();
    let irradiance = rng.random_range(0.3..3.0);
    let radiance = irradiance * distance * distance / area;
    let warmth = rng.random_range(-0.25..0.25);
    let radiance = [1.0 + warmth, 1.0, 1.0 - warmth].map(|tint| (radiance * tint) as f32);
    Lamp { centre: focus.centre + distance * towards, half_u, half_v, radiance }
}

/// A random unit vector at least 15° above the horizon and at most 73° from the focus' axis.
fn direction(focus: &Focus, rng: &mut Pcg64) -> Vector3<f64> {
    loop {
        let [height, turn]: [f64; 2] = rng.random();
        let (z, angle) = (0.26 + 0.74 * height, TAU * turn);
        let flat = (1.0 - z * z).sqrt();
        let direction = Vector3::new(flat * angle.cos(), flat * angle.sin(), z);
        if direction.dot(&focus.axis) > 0.3 {
            return direction;
        }
    }
}
