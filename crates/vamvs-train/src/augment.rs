//! Augmentation of photographs: differences that real photographs of one scene have in exposure, white balance,
//! contrast, sharpness and noise.

use rand::{Rng, RngExt};
use vamvs_core::{Grid, Rgb};

/// Standard deviations of the logarithms of exposure, of a channel's gain, and of gamma.
const EXPOSURE: f64 = 0.12;
const BALANCE: f64 = 0.04;
const GAMMA: f64 = 0.1;
/// Fraction of views that are blurred.
const BLURRED: f64 = 0.2;
/// Largest standard deviation of the noise, grey values.
const NOISE: f64 = 4.0;

/// A copy of the photograph with randomly changed tones, sharpness and noise.
pub fn retake(image: &Grid<Rgb>, rng: &mut impl Rng) -> Grid<Rgb> {
    let tables = tones(rng);
    let toned = image.map(|rgb| [0, 1, 2].map(|c| tables[c][rgb[c] as usize]));
    let sharp = if rng.random_bool(BLURRED) { blurred(&toned) } else { toned };
    noisy(&sharp, NOISE * rng.random::<f64>(), rng)
}

/// A random tone curve for each channel: from grey value to grey value.
fn tones(rng: &mut impl Rng) -> [[u8; 256]; 3] {
    let exposure = (EXPOSURE * normal(rng)).exp();
    let gamma = (GAMMA * normal(rng)).exp();
    let gains = [0; 3].map(|_| exposure * (BALANCE * normal(rng)).exp());
    gains.map(|gain| {
        std::array::from_fn(|value| {
            let toned = (value as f64 / 255.0).powf(gamma) * gain * 255.0;
            toned.round().clamp(0.0, 255.0) as u8
        })
    })
}

/// Blurs with the binomial 3×3 filter (1, 2, 1) ⊗ (1, 2, 1) / 16.
fn blurred(image: &Grid<Rgb>) -> Grid<Rgb> {
    let size = image.size();
    Grid::from_fn(size, |x, y| {
        let (left, right) = (x.saturating_sub(1), (x + 1).min(size.width - 1));
        let (above, below) = (y.saturating_sub(1), (y + 1).min(size.height - 1));
        let row = |y: usize, c: usize| {
            let row = image.row(y);
            u16::from(row[left][c]) + 2 * u16::from(row[x][c]) + u16::from(row[right][c])
        };
        [0, 1, 2].map(|c| ((row(above, c) + 2 * row(y, c) + row(below, c) + 8) / 16) as u8)
    })
}

fn noisy(image: &Grid<Rgb>, deviation: f64, rng: &mut impl Rng) -> Grid<Rgb> {
    image.map(|rgb| {
        // The sum of four random bytes is nearly normal, with mean 510 and standard deviation 147.8.
        let noise = |value: u8| {
            let sum: i32 = rng.next_u32().to_le_bytes().into_iter().map(i32::from).sum();
            let noise = f64::from(sum - 510) / 147.8 * deviation;
            (f64::from(value) + noise).round().clamp(0.0, 255.0) as u8
        };
        rgb.map(noise)
    })
}

/// A standard normal variate, by the Box–Muller transform.
pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;
    use vamvs_core::Size;

    #[test]
    fn a_retaken_photograph_shows_the_same_in_another_light() {
        let image =
            Grid::from_fn(
                Size::new(64, 64),
                |x, y| if (x / 8 + y / 8) % 2 == 0 { [60; 3] } else { [180; 3] },
            );
        let mut rng = Pcg64::seed_from_u64(1);
        let retaken = retake(&image, &mut rng);
        let mean = |dark: bool| {
            let pairs = image.data().iter().zip(retaken.data()).filter(|(rgb, _)| (rgb[0] == 60) == dark);
            let greens: Vec<f64> = pairs.map(|(_, rgb)| f64::from(rgb[1])).collect();
            greens.iter().sum::<f64>() / greens.len() as f64
        };
        assert!(mean(false) - mean(true) > 80.0, "contrast stays");
        assert_ne!(retaken, image);
        assert_eq!(retake(&image, &mut Pcg64::seed_from_u64(1)), retaken, "one seed, one picture");
    }

    #[test]
    fn noise_has_the_deviation_asked_for_and_normal_variates_theirs() {
        let mut rng = Pcg64::seed_from_u64(2);
        let grey = Grid::filled(Size::new(100, 100), [128; 3]);
        let noise: Vec<f64> =
            noisy(&grey, 4.0, &mut rng).data().as_flattened().iter().map(|&v| f64::from(v) - 128.0).collect();
        let deviation = (noise.iter().map(|v| v * v).sum::<f64>() / noise.len() as f64).sqrt();
        assert!((deviation - 4.0).abs() < 0.1, "{deviation}");
        let normals: Vec<f64> = (0..20_000).map(|_| normal(&mut rng)).collect();
        let variance = normals.iter().map(|v| v * v).sum::<f64>() / 20_000.0;
        assert!((variance - 1.0).abs() < 0.05, "{variance}");
    }

    #[test]
    fn blurring_keeps_a_plain_image_and_halves_a_line() {
        let plain = Grid::filled(Size::new(5, 4), [77; 3]);
        assert_eq!(blurred(&plain), plain);
        let line = Grid::from_fn(Size::new(7, 3), |x, _| if x == 3 { [200; 3] } else { [0; 3] });
        assert_eq!(blurred(&line)[(3, 1)], [100; 3]);
        assert_eq!(blurred(&line)[(2, 1)], [50; 3]);
    }
}
