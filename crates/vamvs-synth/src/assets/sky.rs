//! Procedural environment maps: a sky over ground, with a sun or with large soft lights.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;
use rand::RngExt;
use rand_pcg::Pcg64;
use vamvs_core::{Grid, Size};

use crate::noise::{Octaves, lerp, smooth};
use crate::pixel::fill;

/// Size of a map that only lights a scene, pixels.
pub(super) const LIGHT: Size = Size::new(512, 256);

/// Size of a map that cameras see, pixels.
pub(super) const SEEN: Size = Size::new(2048, 1024);

const CLOUDS: Octaves = Octaves { count: 5, gain: 0.55 };

/// A source of light in the sky: a soft-edged disc.
struct Glow {
    direction: Vector3<f32>,
    /// Angular radius, radians.
    radius: f32,
    radiance: [f32; 3],
}

/// A random map of linear radiance: a gradient from the horizon to the zenith with clouds, over dim ground. Most
/// have a sun (a disc of 1° to 4° radius) or one to three large soft lights (discs of 9° to 29° radius).
pub(super) fn random(size: Size, rng: &mut Pcg64) -> Grid<[f32; 3]> {
    let zenith = tinted(0.35..0.9, 0.35, rng);
    let horizon = tinted(0.6..1.3, 0.15, rng);
    let ground = tinted(0.05..0.4, 0.2, rng);
    let cover = rng.random_range(0.0..1.2_f32);
    let seed = rng.random();
    let glows = glows(rng);
    fill(size, |x, y| {
        let direction = direction(size, x, y);
        let height = direction.z;
        let puffs = CLOUDS.space((direction * 3.0 + Vector3::repeat(9.0)).into(), seed);
        let clouds = cover * smooth(1.5 * puffs);
        let sky = |i: usize| lerp(horizon[i], zenith[i], smooth(height.max(0.0).sqrt())) + clouds;
        let above = smooth(0.5 + 12.0 * height);
        let glow = |i: usize| glows.iter().map(|glow| glow.radiance(&direction)[i]).sum::<f32>();
        [0, 1, 2].map(|i| lerp(ground[i], sky(i), above) + above * glow(i))
    })
}

/// The unit direction of a pixel's centre; rows go from the zenith to the nadir.
fn direction(size: Size, x: usize, y: usize) -> Vector3<f32> {
    let azimuth = TAU * (x as f32 + 0.5) / size.width as f32;
    let polar = PI * (y as f32 + 0.5) / size.height as f32;
    Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos())
}

fn glows(rng: &mut Pcg64) -> Vec<Glow> {
    let (count, radius, irradiance) = match rng.random_range(0..10) {
        0..2 => (0, 0.0..0.1, 0.0..1.0),
        2..6 => (1, 0.017..0.07, 1.0..5.0),
        _ => (rng.random_range(1..=3), 0.15..0.5, 0.5..2.5),
    };
    let mut glow = |_| {
        let radius: f32 = rng.random_range(radius.clone());
        let irradiance = tinted(irradiance.clone(), 0.15, rng);
        let radiance = irradiance.map(|power| power / (PI * radius * radius));
        Glow { direction: upwards(rng), radius, radiance }
    };
    (0..count).map(&mut glow).collect()
}

impl Glow {
    fn radiance(&self, direction: &Vector3<f32>) -> [f32; 3] {
        // The chord length approximates the angle well enough, and is cheap.
        let angle = (direction - self.direction).norm();
        self.radiance.map(|radiance| radiance * smooth(4.0 * (1.0 - angle / self.radius) + 0.5))
    }
}

/// A direction 10° to 80° above the horizon.
fn upwards(rng: &mut Pcg64) -> Vector3<f32> {
    let azimuth = rng.random_range(0.0..TAU);
    let elevation = rng.random_range(0.11..0.89) * FRAC_PI_2;
    Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
}

/// A random brightness in the range, its red raised and its blue lowered by at most the share `tint`, or vice versa.
fn tinted(brightness: std::ops::Range<f32>, tint: f32, rng: &mut Pcg64) -> [f32; 3] {
    let value = rng.random_range(brightness);
    let warmth = tint * rng.random_range(-1.0..1.0_f32);
    [value * (1.0 + warmth), value, value * (1.0 - warmth)]
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn skies_are_bright_above_finite_and_differ() {
        let sky = |seed| random(LIGHT, &mut Pcg64::seed_from_u64(seed));
        for seed in 0..8 {
            let map = sky(seed);
            assert!(map.data().as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0));
            let mean = |rows: std::ops::Range<usize>| rows.map(|y| map.row(y)[100][1]).sum::<f32>();
            assert!(mean(0..100) > mean(156..256));
        }
        assert_eq!(sky(1), sky(1));
        assert_ne!(sky(1), sky(2));
    }
}
