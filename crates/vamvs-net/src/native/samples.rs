//! Features of source views at the projections of hypothesised points.

use rayon::prelude::*;
use vamvs_core::Size;

use super::Level;
use super::dot::{Corners, best_of};
use super::transfer::Transfer;
use crate::project::PixelGrid;

/// The features of a source view that are sampled, and the transfer of reference pixels into it.
pub(crate) struct Sampled<'a> {
    /// The levels, each with the distance of its features from the centres of their pixels, as fractions of the
    /// image's size (see [`crate::Manifest::feature_offsets`]).
    pub levels: Vec<(Level<'a>, [f32; 2])>,
    pub transfer: Transfer,
}

/// A distance of `pixels` in both directions, as fractions of the size of an image.
pub(crate) fn share_of(pixels: f64, image: Size) -> [f32; 2] {
    [image.width, image.height].map(|side| (pixels / side as f64) as f32)
}

/// Hypothesised points: J depths for each pixel of a grid, (J, h·w), in units of the nearest depth searched.
#[derive(Clone, Copy)]
pub(crate) struct Points<'a> {
    pub pixel_grid: &'a PixelGrid,
    pub depths: &'a [f32],
}

impl Points<'_> {
    /// The number of pixels of a row.
    pub fn columns(&self) -> usize {
        self.pixel_grid.x.len()
    }

    /// J, the number of hypotheses of a pixel.
    pub fn hypotheses(&self) -> usize {
        self.depths.len() / (self.columns() * self.pixel_grid.y.len())
    }
}

impl Sampled<'_> {
    /// The number of channels of all levels.
    pub fn channels(&self) -> usize {
        channels(&self.levels)
    }
}

/// A view's own features of all levels at the pixels of a grid, (h·w, C₁ + C₂ + …); at the image's border those of the
/// nearest pixel.
pub(crate) fn own_features(
    pixel_grid: &PixelGrid,
    levels: &[(Level<'_>, [f32; 2])],
    image: Size,
) -> Vec<f32> {
    let channels = channels(levels);
    let columns = pixel_grid.x.len();
    let mut out = vec![0.0; columns * pixel_grid.y.len() * channels];
    out.par_chunks_mut(columns * channels).zip(&pixel_grid.y).for_each(|(out, y)| {
        for (mut out, x) in out.chunks_exact_mut(channels).zip(&pixel_grid.x) {
            let place = [(x / image.width as f64) as f32, (y / image.height as f64) as f32];
            for (level, shift) in levels {
                let (own, rest) = out.split_at_mut(level.channels);
                let sides = [level.width, level.height];
                let inside = [0, 1].map(|axis| {
                    let half = 0.5 / sides[axis] as f32;
                    (place[axis] + shift[axis]).clamp(half, 1.0 - half)
                });
                Corners::around(level, inside).expect("the place is inside").sample(level, own);
                out = rest;
            }
        }
    });
    out
}

fn channels(levels: &[(Level<'_>, [f32; 2])]) -> usize {
    levels.iter().map(|(level, _)| level.channels).sum()
}

/// Writes the features of all levels at the points of pixels `first` and after, one for each ray, to `out`, in the order
/// (pixel, hypothesis). They are 0 outside of the image and behind the camera.
#[inline(always)]
fn sample<const ONE: usize>(
    points: &Points<'_>,
    source: &Sampled<'_>,
    rays: &[[f32; 3]],
    first: usize,
    out: &mut [f32],
) {
    let pixels = points.columns() * points.pixel_grid.y.len();
    let (hypotheses, channels) = (points.hypotheses(), source.channels());
    for (x, (ray, out)) in rays.iter().zip(out.chunks_exact_mut(hypotheses * channels)).enumerate() {
        for (j, mut out) in out.chunks_exact_mut(channels).enumerate() {
            let Some([u, v]) = source.transfer.place(*ray, points.depths[j * pixels + first + x]) else {
                out.fill(0.0);
                continue;
            };
            for (level, [right, down]) in &source.levels {
                let (own, rest) = out.split_at_mut(level.channels);
                match Corners::around(level, [u + right, v + down]) {
                    Some(corners) => corners.sample(level, own),
                    None => own.fill(0.0),
                }
                out = rest;
            }
        }
    }
}
best_of!(sample => sample_pixels<const ONE>(
    points: &Points<'_>,
    source: &Sampled<'_>,
    rays: &[[f32; 3]],
    first: usize,
    out: &mut [f32],
));
