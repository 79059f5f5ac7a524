//! Normalised cross-correlation of a few channels over windows of 3×3 pixels, of the reference view and all source
//! views at one plane.

use rayon::prelude::*;

use super::dot::best_of;
use super::layers::Ncc;

/// The mean over the channels of the products of both views' values, of the source view's values, and of their squares.
pub(crate) type Moments = [f32; 3];

/// The reference view's channels at the pixels, (h·w, R).
#[derive(Clone, Copy)]
pub(crate) struct Own<'a> {
    pub values: &'a [f32],
    pub channels: usize,
}

/// Writes the moments of one of `sources` source views for a row of pixels from `first` on, which are the last channels
/// of the rows of `sampled`, `width` apart, to `out`, (pixels, sources).
#[inline(always)]
fn reduce_channels<const ONE: usize>(
    own: Own<'_>,
    first: usize,
    (sampled, width): (&[f32], usize),
    (source, sources): (usize, usize),
    out: &mut [Moments],
) {
    let Own { values, channels } = own;
    let share = 1.0 / channels as f32;
    let pixels = sampled.chunks_exact(width).zip(values[first * channels..].chunks_exact(channels));
    for ((sampled, own), out) in pixels.zip(out.chunks_exact_mut(sources)) {
        let mut sums = [0.0; 3];
        for (source, own) in sampled[width - channels..].iter().zip(own) {
            sums[0] += own * source;
            sums[1] += source;
            sums[2] += source * source;
        }
        out[source] = sums.map(|sum| sum * share);
    }
}
best_of!(reduce_channels => moments_of<const ONE>(
    own: Own<'_>,
    first: usize,
    rows: (&[f32], usize),
    source: (usize, usize),
    out: &mut [Moments],
));

/// The mean over the source views of exp(sharpness · (NCC − 1)), from their moments (h·w, sources), as the last column of
/// `out`, (h·w, columns), with `width` pixels in a row of the image. Windows end at the image's border.
pub(crate) fn similarity(ncc: Ncc, own: Own<'_>, moments: &[Moments], width: usize, out: &mut [f32]) {
    let pixels = own.values.len() / own.channels;
    let (sources, columns) = (moments.len() / pixels, out.len() / pixels);
    let own_moments = |values: &[f32]| {
        let share = 1.0 / own.channels as f32;
        let squares: f32 = values.iter().map(|value| value * value).sum();
        [values.iter().sum::<f32>() * share, squares * share]
    };
    let own: Vec<[f32; 2]> = own.values.chunks_exact(own.channels).map(own_moments).collect();
    let height = pixels / width;
    out.par_chunks_mut(width * columns).enumerate().for_each_init(Vec::new, |sums, (y, out)| {
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        for (x, out) in out.iter_mut().skip(columns - 1).step_by(columns).enumerate() {
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let share = 1.0 / (rows.len() * columns.len()) as f32;
            sums.clear();
            sums.resize(3 * sources, 0.0);
            let mut own_sums = [0.0; 2];
            for row in rows.clone() {
                let (first, last) = (row * width + columns.start, row * width + columns.end);
                for pixel in moments[first * sources..last * sources].as_flattened().chunks_exact(3 * sources)
                {
                    sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value);
                }
                own[first..last].iter().for_each(|pixel| (0..2).for_each(|i| own_sums[i] += pixel[i]));
            }
            let [mean, square] = own_sums.map(|sum| sum * share);
            let own_variance = square - mean * mean + ncc.noise;
            let of_source = |sums: &Moments| {
                let [product, source, square] = sums.map(|sum| sum * share);
                let variance = square - source * source + ncc.noise;
                let correlation = (product - mean * source) / (own_variance * variance).sqrt();
                (ncc.sharpness * (correlation - 1.0)).exp()
            };
            *out = sums.as_chunks::<3>().0.iter().map(of_source).sum::<f32>() / sources as f32;
        }
    });
}
