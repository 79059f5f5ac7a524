//! Turns rendered radiance into photographs: one exposure for a scene, lens and sensor effects, a tone curve.

use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vamvs_core::{Grid, Rgb, Size};

use crate::Shot;
use crate::random::{normal, triangular};

/// Imperfections of real photographs that rendered ones lack. Each field is an upper limit: what a scene or a
/// photograph gets is drawn at random up to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Effects {
    /// Standard deviation of the Gaussian blur, pixels.
    pub blur: f32,
    /// Standard deviation of a mid-grey pixel's noise, as a share of its linear value.
    pub noise: f32,
    /// Share of light that is lost in the corners.
    pub vignetting: f32,
    /// How far a view's exposure differs from the scene's, up or down, in stops.
    pub exposure: f32,
    /// How far a view's red and blue differ from the scene's, up or down, as a share.
    pub white_balance: f32,
}

impl Effects {
    /// No imperfections.
    pub const NONE: Self = Self { blur: 0.0, noise: 0.0, vignetting: 0.0, exposure: 0.0, white_balance: 0.0 };
}

impl Default for Effects {
    /// A good camera with automatic exposure and white balance.
    fn default() -> Self {
        Self { blur: 0.6, noise: 0.04, vignetting: 0.25, exposure: 0.3, white_balance: 0.06 }
    }
}

/// Mid-grey as a linear value: exposure brings the geometric mean of a scene's surfaces to it.
const MID_GREY: f32 = 0.17;

/// Share of the surface pixels that may be overexposed.
const BURNT: f64 = 0.04;

/// Linear value above which the tone curve flattens, so that highlights fade instead of clipping.
const SHOULDER: f32 = 0.7;

/// Effects as drawn for one photograph: blur (pixels), noise and vignetting are the same for the whole scene,
/// the gain differs between photographs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Look {
    blur: f32,
    noise: f32,
    vignetting: f32,
    /// Factors on red, green and blue: the view's exposure and white balance.
    gain: [f32; 3],
}

/// Develops the photographs of a scene, sRGB-encoded. They share one exposure, measured over the surface
/// pixels of all `shots` together. The effects are drawn from `random`.
#[must_use]
pub fn develop(shots: &[Shot], effects: &Effects, random: &mut Pcg64) -> Vec<Grid<Rgb>> {
    let exposure = exposure(shots);
    let lens = lens(effects, random);
    let looks = shots.iter().map(|_| look(&lens, effects, random)).collect::<Vec<_>>();
    let grains = shots.iter().map(|_| random.random()).collect::<Vec<u128>>();
    (shots, looks, grains)
        .into_par_iter()
        .map(|(shot, look, grain)| photograph(shot, exposure, &look, &mut Pcg64::new(grain, 0)))
        .collect()
}

/// The factor that brings the geometric mean of the surfaces' luminance to mid-grey. It is smaller where that
/// would overexpose more than the share [`BURNT`] of their pixels.
fn exposure(shots: &[Shot]) -> f32 {
    let pixels = shots.iter().flat_map(|shot| shot.radiance.data().iter().zip(shot.ground_truth.id.data()));
    let surfaces = pixels.filter(|&(_, &id)| id > 0).map(|(light, _)| luminance(light));
    let mut lit: Vec<f32> = surfaces.filter(|&luminance| luminance > 0.0).collect();
    if lit.is_empty() {
        return 1.0;
    }
    let mean = lit.iter().map(|&value| f64::from(value).ln()).sum::<f64>() / lit.len() as f64;
    let brightest = ((1.0 - BURNT) * (lit.len() - 1) as f64) as usize;
    let bright = *lit.select_nth_unstable_by(brightest, f32::total_cmp).1;
    (MID_GREY / mean.exp() as f32).min(1.0 / bright)
}

/// Luminance of linear light, by the weights of sRGB's primaries.
fn luminance([red, green, blue]: &[f32; 3]) -> f32 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

/// Draws the effects that all photographs of a scene share.
fn lens(effects: &Effects, random: &mut Pcg64) -> Look {
    let mut up_to = |most: f32| most * random.random::<f32>();
    Look {
        blur: up_to(effects.blur),
        noise: up_to(effects.noise),
        vignetting: up_to(effects.vignetting),
        gain: [1.0; 3],
    }
}

/// Adds one photograph's exposure and white balance to the `lens`.
fn look(lens: &Look, effects: &Effects, random: &mut Pcg64) -> Look {
    let mut about = |most: f32| most * triangular(random) as f32;
    let exposure = about(effects.exposure).exp2();
    let (red, blue) = (1.0 + about(effects.white_balance), 1.0 + about(effects.white_balance));
    Look { gain: [exposure * red, exposure, exposure * blue], ..*lens }
}

fn photograph(shot: &Shot, exposure: f32, look: &Look, random: &mut Pcg64) -> Grid<Rgb> {
    let mut light = shot.radiance.map(|light| light.map(|value| exposure * value));
    vignette(&mut light, look);
    let mut light = blurred(light, look.blur);
    if look.noise > 0.0 {
        light.data_mut().iter_mut().flatten().for_each(|value| add_grain(value, look.noise, random));
    }
    light.map(|light| light.map(encode))
}

/// Applies the gain, and darkens in proportion to the squared distance from the centre.
fn vignette(light: &mut Grid<[f32; 3]>, look: &Look) {
    let Size { width, height } = light.size();
    let (half_width, half_height) = (0.5 * width as f32, 0.5 * height as f32);
    let to_corner = half_width * half_width + half_height * half_height;
    for y in 0..height {
        for (x, light) in light.row_mut(y).iter_mut().enumerate() {
            let (dx, dy) = (x as f32 + 0.5 - half_width, y as f32 + 0.5 - half_height);
            let kept = 1.0 - look.vignetting * (dx * dx + dy * dy) / to_corner;
            (0..3).for_each(|channel| light[channel] *= kept * look.gain[channel]);
        }
    }
}

/// Adds photon noise: its variance is proportional to `value`, its relative deviation `noise` at mid-grey.
fn add_grain(value: &mut f32, noise: f32, random: &mut Pcg64) {
    let deviation = noise * (MID_GREY * (*value).max(0.0)).sqrt();
    *value += deviation * normal(random) as f32;
}

/// The image convolved with a Gaussian of standard deviation `sigma` pixels; border pixels are repeated.
fn blurred(image: Grid<[f32; 3]>, sigma: f32) -> Grid<[f32; 3]> {
    let kernel = gaussian(sigma);
    if kernel.len() == 1 {
        return image;
    }
    let Size { width, height } = image.size();
    let reach = kernel.len() / 2;
    let near =
        |centre: usize, tap: usize, length: usize| (centre + tap).saturating_sub(reach).min(length - 1);
    let rows = Grid::from_fn(image.size(), |x, y| weighted(&kernel, |tap| image[(near(x, tap, width), y)]));
    Grid::from_fn(image.size(), |x, y| weighted(&kernel, |tap| rows[(x, near(y, tap, height))]))
}

fn weighted(kernel: &[f32], value: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (tap, weight) in kernel.iter().enumerate() {
        let value = value(tap);
        (0..3).for_each(|channel| sum[channel] += weight * value[channel]);
    }
    sum
}

/// Gaussian weights out to three deviations, with sum 1; a single weight if `sigma` is too small to be seen.
fn gaussian(sigma: f32) -> Vec<f32> {
    if sigma < 0.1 {
        return vec![1.0];
    }
    let reach = (3.0 * sigma).ceil() as i32;
    let weights: Vec<f32> = (-reach..=reach).map(|x| (-0.5 * (x as f32 / sigma).powi(2)).exp()).collect();
    let sum: f32 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}

/// The 8-bit sRGB value of linear light. Above [`SHOULDER`] the tone curve approaches white asymptotically.
fn encode(light: f32) -> u8 {
    let over = (light - SHOULDER).max(0.0);
    let room = 1.0 - SHOULDER;
    let light = light.clamp(0.0, SHOULDER) + room * (1.0 - (-over / room).exp());
    let srgb = if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (255.0 * srgb).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GroundTruth;
    use crate::random::stream;

    const SIZE: Size = Size::new(64, 48);

    fn shot(radiance: impl FnMut(usize, usize) -> [f32; 3]) -> Shot {
        let ground_truth = GroundTruth {
            depth: Grid::filled(SIZE, 1.0),
            id: Grid::filled(SIZE, 1),
            normal: Grid::filled(SIZE, [0.0, 0.0, 1.0]),
        };
        Shot { radiance: Grid::from_fn(SIZE, radiance), ground_truth }
    }

    fn developed(shots: &[Shot], effects: Effects) -> Vec<Grid<Rgb>> {
        develop(shots, &effects, &mut stream(3, 1, "develop"))
    }

    #[test]
    fn the_average_surface_is_mid_grey_whatever_the_light() {
        for light in [1e-3, 1.0, 500.0] {
            let photos = developed(&[shot(|_, _| [light; 3]), shot(|_, _| [light; 3])], Effects::NONE);
            // 0.17 encoded as sRGB.
            assert!(photos.iter().all(|photo| photo.data().iter().all(|&rgb| rgb == [115; 3])), "{light}");
        }
    }

    #[test]
    fn views_keep_their_brightness_relative_to_each_other() {
        let photos = developed(&[shot(|_, _| [1.0; 3]), shot(|_, _| [4.0; 3])], Effects::NONE);
        // 0.085 and 0.34, whose geometric mean is 0.17.
        assert_eq!([photos[0][(0, 0)], photos[1][(0, 0)]], [[82; 3], [158; 3]]);
    }

    #[test]
    fn few_bright_things_on_a_dark_ground_do_not_burn_out() {
        let bright = |share: usize| move |x: usize, _| if x < share { [1.0; 3] } else { [0.01; 3] };
        // 6 of 64 columns are more than the share BURNT, 2 of 64 are less.
        assert_eq!(developed(&[shot(bright(6))], Effects::NONE)[0][(0, 0)][1], encode(1.0));
        assert_eq!(developed(&[shot(bright(2))], Effects::NONE)[0][(0, 0)][1], 255);
    }

    #[test]
    fn the_sky_does_not_tell_the_exposure() {
        let mut shot = shot(|x, _| if x < 32 { [0.5; 3] } else { [1e4; 3] });
        shot.ground_truth.id = Grid::from_fn(SIZE, |x, _| u16::from(x < 32));
        let photo = developed(&[shot], Effects::NONE).remove(0);
        assert_eq!([photo[(0, 0)], photo[(63, 0)]], [[115; 3], [255; 3]]);
    }

    #[test]
    fn the_tone_curve_rises_and_follows_srgb_below_the_shoulder() {
        let values: Vec<u8> = (0..2000).map(|i| encode(i as f32 * 0.002)).collect();
        assert!(values.is_sorted() && values[0] == 0 && encode(-1.0) == 0 && encode(f32::INFINITY) == 255);
        assert_eq!([encode(0.5), encode(0.002)], [188, 7]);
    }

    #[test]
    fn noise_has_the_deviation_of_its_light() {
        let mut random = stream(0, 0, "test");
        for (light, expected) in [(MID_GREY, 0.1 * MID_GREY), (4.0 * MID_GREY, 0.2 * MID_GREY)] {
            let noisy = |_| {
                let mut value = light;
                add_grain(&mut value, 0.1, &mut random);
                value - light
            };
            let variance = (0..40_000).map(noisy).map(|n| n * n).sum::<f32>() / 40_000.0;
            assert!((variance.sqrt() / expected - 1.0).abs() < 0.02, "{variance}");
        }
    }

    #[test]
    fn blur_keeps_the_light_and_has_its_width() {
        let point = Grid::from_fn(SIZE, |x, y| if (x, y) == (32, 24) { [1.0; 3] } else { [0.0; 3] });
        let spread = blurred(point, 1.5);
        let sum = |weight: &dyn Fn(f32) -> f32| {
            let value = |(i, light): (usize, &[f32; 3])| weight((i % 64) as f32 - 32.0) * light[1];
            spread.data().iter().enumerate().map(value).sum::<f32>()
        };
        assert!((sum(&|_| 1.0) - 1.0).abs() < 1e-5 && sum(&|x| x).abs() < 1e-4);
        assert!((sum(&|x| x * x).sqrt() - 1.5).abs() < 0.05);
    }

    #[test]
    fn corners_darken_and_the_centre_does_not() {
        let mut light = Grid::filled(SIZE, [1.0; 3]);
        let look = Look { blur: 0.0, noise: 0.0, vignetting: 0.5, gain: [1.0, 2.0, 1.0] };
        vignette(&mut light, &look);
        assert!((light[(32, 24)][0] - 1.0).abs() < 1e-3 && (light[(32, 24)][1] - 2.0).abs() < 1e-3);
        assert!((light[(0, 0)][0] - 0.5).abs() < 0.03);
    }

    #[test]
    fn effects_stay_within_their_limits_and_differ_between_views() {
        let effects = Effects { exposure: 0.5, white_balance: 0.1, ..Effects::NONE };
        let mut random = stream(5, 0, "develop");
        let base = lens(&effects, &mut random);
        let gains: Vec<[f32; 3]> = (0..200).map(|_| look(&base, &effects, &mut random).gain).collect();
        let ratio = |gain: &[f32; 3]| gain[0] / gain[1];
        assert!(gains.iter().all(|gain| gain[1].log2().abs() <= 0.5 && (ratio(gain) - 1.0).abs() <= 0.1001));
        assert!(
            gains.iter().any(|gain| gain[1].log2() > 0.2) && gains.iter().any(|gain| gain[1].log2() < -0.2)
        );
    }
}
