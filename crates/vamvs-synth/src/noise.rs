//! Smooth random functions: value noise in 2D and in 3D.

/// The random number in [0, 1) of the grid point `(x, y, z)`.
#[must_use]
pub fn grid_value([x, y, z]: [i32; 3], seed: u32) -> f32 {
    let mixed = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA77).rotate_left(11)
        ^ (z as u32).wrapping_mul(0xC2B2_AE3D).rotate_left(22);
    (scramble(mixed ^ scramble(seed)) >> 8) as f32 / (1 << 24) as f32
}

/// The finaliser of MurmurHash3: each input bit flips each output bit with a probability of about one half.
const fn scramble(mut hash: u32) -> u32 {
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x85EB_CA6B);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xC2B2_AE35);
    hash ^ (hash >> 16)
}

/// 2D value noise in [−1, 1] with wavelength 1. It repeats after `periods` in x and y.
#[must_use]
pub fn plane(x: [f32; 2], periods: [i32; 2], seed: u32) -> f32 {
    let base = x.map(|c| c.floor() as i32);
    let weight = [0, 1].map(|i| smooth(x[i] - base[i] as f32));
    let wrapped = |axis: usize| [0, 1].map(|step| (base[axis] + step).rem_euclid(periods[axis]));
    let (xs, ys) = (wrapped(0), wrapped(1));
    let row = |y| lerp(grid_value([xs[0], y, 0], seed), grid_value([xs[1], y, 0], seed), weight[0]);
    2.0 * lerp(row(ys[0]), row(ys[1]), weight[1]) - 1.0
}

/// 3D value noise in [−1, 1] with wavelength 1.
#[must_use]
pub fn space(x: [f32; 3], seed: u32) -> f32 {
    let base = x.map(|c| c.floor() as i32);
    let weight = [0, 1, 2].map(|i| smooth(x[i] - base[i] as f32));
    let corner = |dx, dy, dz| grid_value([base[0] + dx, base[1] + dy, base[2] + dz], seed);
    let row = |dy, dz| lerp(corner(0, dy, dz), corner(1, dy, dz), weight[0]);
    let slice = |dz| lerp(row(0, dz), row(1, dz), weight[1]);
    2.0 * lerp(slice(0), slice(1), weight[2]) - 1.0
}

/// Fractal noise, a sum of octaves: each has half the wavelength of the one before and `gain` times its
/// amplitude. The sum is normalised to stay in [−1, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Octaves {
    /// Number of octaves.
    pub count: u32,
    /// Factor from one octave's amplitude to the next.
    pub gain: f32,
}

impl Octaves {
    /// Fractal noise of [`plane`]; it repeats after `periods`.
    #[must_use]
    pub fn plane(self, x: [f32; 2], periods: [i32; 2], seed: u32) -> f32 {
        self.sum(|octave, scale| {
            plane(x.map(|c| c * scale as f32), periods.map(|p| p * scale), seed.wrapping_add(octave))
        })
    }

    /// Fractal noise of [`space`].
    #[must_use]
    pub fn space(self, x: [f32; 3], seed: u32) -> f32 {
        self.sum(|octave, scale| space(x.map(|c| c * scale as f32), seed.wrapping_add(octave)))
    }

    fn sum(self, noise: impl Fn(u32, i32) -> f32) -> f32 {
        let (mut sum, mut total, mut amplitude) = (0.0, 0.0, 1.0);
        for octave in 0..self.count {
            sum += amplitude * noise(octave, 1 << octave);
            total += amplitude;
            amplitude *= self.gain;
        }
        sum / total
    }
}

/// Linear interpolation from `a` (at `t` = 0) to `b` (at `t` = 1).
#[must_use]
pub fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Smoothstep: rises from 0 to 1 as `t` goes from 0 to 1, with slope 0 at both ends; constant outside.
#[must_use]
pub fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattice_numbers_are_spread_evenly() {
        let mean = |f: fn(f32) -> f32| {
            (0..4096).map(|i| f(grid_value([i % 16, i / 16, 3], 7))).sum::<f32>() / 4096.0
        };
        assert!((mean(|v| v) - 0.5).abs() < 0.02);
        assert!((mean(|v| (v - 0.5).powi(2)) - 1.0 / 12.0).abs() < 0.005);
    }

    #[test]
    fn noise_is_continuous_bounded_and_repeats() {
        let octaves = Octaves { count: 3, gain: 0.5 };
        for i in 0..2000 {
            let [x, y] = [0.0131 * i as f32, 0.0077 * i as f32];
            let here = octaves.plane([x, y], [4; 2], 1);
            assert!(here.abs() <= 1.0 && octaves.space([x, y, 0.3], 1).abs() <= 1.0);
            assert!((octaves.plane([x + 1e-4, y], [4; 2], 1) - here).abs() < 5e-3);
            assert!((octaves.plane([x + 4.0, y - 8.0], [4; 2], 1) - here).abs() < 1e-3);
            let step = octaves.space([x, y, 0.3 + 1e-4], 1) - octaves.space([x, y, 0.3], 1);
            assert!(step.abs() < 5e-3);
        }
    }
}
