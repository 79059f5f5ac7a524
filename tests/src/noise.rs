//! Value noise: smooth random functions of space, the same on every machine.

use nalgebra::Vector3;

/// Most octaves that [`fractal`] adds up.
const MAX_OCTAVES: u32 = 12;

/// Amplitude of the coarsest octave of [`fractal`], the factor from octave to octave, and the most.
/// They grow, so that the finest detail that a picture can show is strong enough to be matched.
const AMPLITUDE: f64 = 0.22;
const GROWTH: f64 = 1.2;
const MAX_AMPLITUDE: f64 = 0.55;

/// A random number in [0, 1) that belongs to the lattice point `cell`.
#[must_use]
pub fn lattice(cell: [i32; 3], seed: u32) -> f64 {
    let mut h = seed.wrapping_mul(0x9E37_79B9) ^ 0x85EB_CA6B;
    for c in cell {
        h = (h ^ c as u32).wrapping_mul(0xCC9E_2D51);
        h ^= h >> 15;
        h = h.wrapping_mul(0x1B87_3593);
        h ^= h >> 13;
    }
    f64::from(h) / (f64::from(u32::MAX) + 1.0)
}

/// Noise in [−1, 1] that varies over distances of about 1: random values at the integer lattice,
/// interpolated smoothly.
#[must_use]
pub fn value(x: &Vector3<f64>, seed: u32) -> f64 {
    let floor = x.map(f64::floor);
    let t = (x - floor).map(|f| f * f * (3.0 - 2.0 * f));
    let c = floor.map(|f| f as i32);
    let at = |dx: i32, dy: i32, dz: i32| {
        lattice([c.x.wrapping_add(dx), c.y.wrapping_add(dy), c.z.wrapping_add(dz)], seed)
    };
    let along_x = |dy, dz| lerp(at(0, dy, dz), at(1, dy, dz), t.x);
    let along_y = |dz| lerp(along_x(0, dz), along_x(1, dz), t.y);
    2.0 * lerp(along_y(0), along_y(1), t.z) - 1.0
}

/// Octaves of [`value`] noise from wavelength `coarsest` down to the finest that pixels of side
/// `footprint` can show. Mostly in [−1, 1].
#[must_use]
pub fn fractal(x: &Vector3<f64>, coarsest: f64, footprint: f64, seed: u32) -> f64 {
    let (mut sum, mut wavelength, mut amplitude) = (0.0, coarsest, AMPLITUDE);
    for octave in 0..MAX_OCTAVES {
        let visible = (0.5 * wavelength / footprint - 1.0).clamp(0.0, 1.0);
        if visible == 0.0 {
            break;
        }
        sum += visible * amplitude * value(&(x / wavelength), seed.wrapping_add(octave));
        wavelength *= 0.5;
        amplitude = (amplitude * GROWTH).min(MAX_AMPLITUDE);
    }
    sum
}

/// Between `a` and `b`.
#[must_use]
pub fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + t * (b - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_passes_through_its_lattice_values() {
        let at_lattice = value(&Vector3::new(3.0, -2.0, 7.0), 5);
        assert!((at_lattice - (2.0 * lattice([3, -2, 7], 5) - 1.0)).abs() < 1e-12);
    }

    #[test]
    fn lattice_values_fill_the_unit_interval_evenly() {
        let values: Vec<f64> = (0..4096).map(|i| lattice([i % 16, i / 16 % 16, i / 256], 1)).collect();
        let mean = values.iter().sum::<f64>() / 4096.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 4096.0;
        assert!((mean - 0.5).abs() < 0.02 && (variance - 1.0 / 12.0).abs() < 0.01);
    }
}
