//! Denoising: an edge-avoiding à-trous filter (Dammertz et al. 2010), guided by the variance of each pixel
//! (Schied et al. 2017). Diffuse light is filtered with the albedo divided out, so that textures are not
//! blurred; light straight from the sky is not filtered.

use nalgebra::Vector3;
use vamvs_core::Grid;

use crate::colour::luminance;
use crate::pixel::{Estimate, Pixel, PixelSurface, fill};

/// How one kind of light (diffuse or specular) is filtered.
struct Strength {
    /// Number of passes of the filter, each twice as wide as the one before.
    passes: u32,
    /// A pixel more than this many times brighter than its second brightest neighbour is a firefly, from a
    /// rare bright path, and is darkened.
    spark: f32,
}

const DIFFUSE: Strength = Strength { passes: 5, spark: 3.0 };
const SPECULAR: Strength = Strength { passes: 3, spark: 1.0 };
/// Weights of the 5-tap kernel, from the middle outwards.
const KERNEL: [f32; 3] = [0.375, 0.25, 0.0625];
/// Part of the luminance tolerance that is due to noise, in standard deviations of the noise.
const NOISE: f32 = 4.0;
/// Part of the luminance tolerance that does not depend on noise, as a share of the luminance.
const CONTRAST: f32 = 0.02;
/// How far another pixel's point may lie off a pixel's tangent plane: as a share of the distance between both,
/// plus a number of pixel spacings.
const OFF_PLANE: (f32, f32) = (0.08, 1.5);

/// The radiance of `pixels`, denoised.
pub(crate) fn denoised(pixels: &Grid<Pixel>) -> Grid<[f32; 3]> {
    let guide = pixels.map(|pixel| pixel.surface);
    let diffuse = smoothed(&guide, &pixels.map(|pixel| pixel.diffuse), &DIFFUSE);
    // On borders of surfaces the filter finds no similar neighbours, and leaves fireflies: remove those.
    let diffuse = without_sparks(&diffuse, 1.0);
    let specular = smoothed(&guide, &pixels.map(|pixel| pixel.specular), &SPECULAR);
    fill(pixels.size(), |x, y| {
        let at = (x, y);
        Pixel { diffuse: diffuse[at], specular: specular[at], ..pixels[at] }.radiance().into()
    })
}

fn smoothed(
    guide: &Grid<Option<PixelSurface>>,
    light: &Grid<Estimate>,
    strength: &Strength,
) -> Grid<Estimate> {
    let light = calmed(&without_sparks(light, strength.spark));
    (0..strength.passes).fold(light, |light, pass| {
        let filter = Filter { guide, light: &light, step: 1 << pass };
        fill(light.size(), |x, y| filter.at(x, y))
    })
}

/// Removes fireflies: darkens each pixel to at most `most` times its second brightest neighbour.
fn without_sparks(light: &Grid<Estimate>, most: f32) -> Grid<Estimate> {
    fill(light.size(), |x, y| {
        let mut brightest = [0.0_f32; 2];
        for (i, j) in around(light, x, y).filter(|&at| at != (x, y)) {
            let other = luminance(light[(i, j)].mean.into());
            brightest = [brightest[0].max(other), brightest[1].max(other.min(brightest[0]))];
        }
        let own = light[(x, y)];
        let scale = (most * brightest[1] / luminance(own.mean.into())).min(1.0);
        if scale.is_nan() {
            own
        } else {
            Estimate { mean: own.mean * scale, variance: own.variance * scale * scale }
        }
    })
}

/// Averages the variances over 3 × 3 pixels: a few paths estimate their variance poorly.
fn calmed(light: &Grid<Estimate>) -> Grid<Estimate> {
    fill(light.size(), |x, y| {
        let (mut sum, mut count) = (0.0, 0.0);
        for at in around(light, x, y) {
            sum += light[at].variance;
            count += 1.0;
        }
        Estimate { variance: sum / count, ..light[(x, y)] }
    })
}

/// The pixel and its up to eight neighbours, as (x, y).
fn around<T>(grid: &Grid<T>, x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> {
    let columns = x.saturating_sub(1)..(x + 2).min(grid.width());
    let rows = y.saturating_sub(1)..(y + 2).min(grid.height());
    rows.flat_map(move |j| columns.clone().map(move |i| (i, j)))
}

/// One pass of the filter.
struct Filter<'a> {
    guide: &'a Grid<Option<PixelSurface>>,
    light: &'a Grid<Estimate>,
    /// Spacing of the kernel's taps, pixels.
    step: isize,
}

impl Filter<'_> {
    fn at(&self, x: usize, y: usize) -> Estimate {
        let own = self.light[(x, y)];
        let Some(surface) = &self.guide[(x, y)] else { return own };
        let likeness = Likeness::new(surface, &own);
        let (mut sum, mut variance, mut weights) = (Vector3::zeros(), 0.0, 0.0);
        for j in -2..=2_isize {
            for i in -2..=2_isize {
                let Some((other, estimate)) = self.tap(x, y, i, j) else { continue };
                let kernel = KERNEL[i.unsigned_abs()] * KERNEL[j.unsigned_abs()];
                let weight = kernel * if (i, j) == (0, 0) { 1.0 } else { likeness.weight(other, estimate) };
                sum += estimate.mean * weight;
                variance += estimate.variance * weight * weight;
                weights += weight;
            }
        }
        Estimate { mean: sum / weights, variance: variance / (weights * weights) }
    }

    fn tap(&self, x: usize, y: usize, i: isize, j: isize) -> Option<(&PixelSurface, &Estimate)> {
        let x = x.checked_add_signed(i * self.step)?;
        let y = y.checked_add_signed(j * self.step)?;
        Some((self.guide.get(x, y)?.as_ref()?, &self.light[(x, y)]))
    }
}

/// Measures how similar other pixels are to one pixel.
struct Likeness<'a> {
    surface: &'a PixelSurface,
    luminance: f32,
    /// 1 / the tolerated difference of luminance.
    scale: f32,
}

impl<'a> Likeness<'a> {
    fn new(surface: &'a PixelSurface, light: &Estimate) -> Self {
        let luminance = luminance(light.mean.into());
        let tolerance = NOISE * light.variance.sqrt() + CONTRAST * luminance;
        Self { surface, luminance, scale: 1.0 / tolerance.max(f32::MIN_POSITIVE) }
    }

    /// The similarity, from 0 to 1 (the same).
    fn weight(&self, other: &PixelSurface, light: &Estimate) -> f32 {
        let cos = self.surface.normal.dot(&other.normal).max(0.0);
        let offset = other.position - self.surface.position;
        let (by_distance, by_spacing) = OFF_PLANE;
        let off_plane = self.surface.normal.dot(&offset).abs()
            / (by_distance * offset.norm() + by_spacing * self.surface.spacing);
        let contrast = (luminance(light.mean.into()) - self.luminance).abs() * self.scale;
        cos.powi(32) * bump(off_plane) * bump(contrast)
    }
}

/// A smooth weight: 1 at 0, 0 from ±1 on.
fn bump(x: f32) -> f32 {
    let rest = (1.0 - x * x).max(0.0);
    rest * rest
}
