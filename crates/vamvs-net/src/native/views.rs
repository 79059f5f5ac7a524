//! avg, max, var and vis-var: features of all views at hypothesised points, reduced over the views.
//!
//! The formulas are those of [`crate::aggregate::Reducer`]; a block of points is reduced while it is in the
//! processor's cache.

use rayon::prelude::*;

use super::dot::best_of;
use super::samples::{Points, Sampled, sample_pixels};
use crate::Aggregation;

/// Points that are sampled at once.
const BLOCK: usize = 256;

/// What is reduced.
pub(crate) struct Views<'a> {
    pub points: Points<'a>,
    /// The reference view's own features at the pixels, (h·w, C).
    pub reference: &'a [f32],
    pub sources: &'a [Sampled<'a>],
    /// vis-var: the visibility of the pixels in each source view, (h·w); else empty, which stands for 1.
    pub masks: &'a [&'a [f32]],
    pub aggregation: Aggregation,
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    rays: Vec<Vec<[f32; 3]>>,
    sampled: Vec<f32>,
    squares: Vec<f32>,
}

/// The reduced features of all points, (h·w·J, C).
pub(crate) fn reduced(views: &Views<'_>, out: &mut [f32]) {
    let Views { points, sources, .. } = views;
    let row = out.len() / points.pixel_grid.y.len();
    out.par_chunks_mut(row).enumerate().for_each_init(Scratch::default, |scratch, (y, out)| {
        scratch.rays.resize(sources.len(), Vec::new());
        for (source, rays) in sources.iter().zip(&mut scratch.rays) {
            source.transfer.rays(points.pixel_grid, y, rays);
        }
        reduce_row(views, y, scratch, out);
    });
}

fn reduce_row(views: &Views<'_>, y: usize, scratch: &mut Scratch, out: &mut [f32]) {
    let Views { points, reference, sources, masks, aggregation } = views;
    let columns = points.columns();
    let pixel = out.len() / columns; // values of a pixel: C for each of its hypotheses
    let channels = pixel / points.hypotheses();
    let step = (BLOCK / points.hypotheses()).max(1);
    let Scratch { rays, sampled, squares } = scratch;
    for first in (0..columns).step_by(step) {
        let last = (first + step).min(columns);
        let out = &mut out[first * pixel..last * pixel];
        sampled.resize(out.len(), 0.0);
        squares.resize(out.len(), 0.0);
        let place = y * columns + first;
        let reference = &reference[place * channels..(place + last - first) * channels];
        for (out, own) in out.chunks_exact_mut(pixel).zip(reference.chunks_exact(channels)) {
            out.chunks_exact_mut(channels).for_each(|out| out.copy_from_slice(own));
        }
        squares.iter_mut().zip(&*out).for_each(|(square, value)| *square = value * value);
        for (index, source) in sources.iter().enumerate() {
            sample_pixels::<1>(points, source, &rays[index][first..last], place, sampled);
            let mask = masks.get(index).map(|mask| &mask[place..][..last - first]);
            add_view::<1>(*aggregation, mask, sampled, out, squares);
        }
        let weight = |x: usize| match masks.is_empty() {
            true => (1 + sources.len()) as f32,
            false => masks.iter().fold(1.0, |sum, mask| sum + mask[place + x]),
        };
        let pixels = out.chunks_exact_mut(pixel).zip(squares.chunks_exact(pixel)).enumerate();
        pixels.for_each(|(x, (out, squares))| finish(*aggregation, weight(x), out, squares));
    }
}

/// Adds the features of one source view to a block; `mask` has one weight for each of its pixels.
#[inline(always)]
fn add<const ONE: usize>(
    aggregation: Aggregation,
    mask: Option<&[f32]>,
    sampled: &[f32],
    out: &mut [f32],
    squares: &mut [f32],
) {
    if aggregation == Aggregation::Max {
        return out.iter_mut().zip(sampled).for_each(|(out, value)| *out = out.max(*value));
    }
    let pixel = sampled.len() / mask.map_or(1, <[f32]>::len);
    let pixels =
        sampled.chunks_exact(pixel).zip(out.chunks_exact_mut(pixel)).zip(squares.chunks_exact_mut(pixel));
    for (x, ((sampled, out), squares)) in pixels.enumerate() {
        let weight = mask.map_or(1.0, |mask| mask[x]);
        for ((value, out), square) in sampled.iter().zip(out).zip(squares) {
            let weighted = weight * value;
            *out += weighted;
            *square += weighted * value;
        }
    }
}
best_of!(add => add_view<const ONE>(
    aggregation: Aggregation,
    mask: Option<&[f32]>,
    sampled: &[f32],
    out: &mut [f32],
    squares: &mut [f32],
));

/// Turns the sums of a pixel into what the aggregation gives; `weight` is the sum of the views' weights.
fn finish(aggregation: Aggregation, weight: f32, out: &mut [f32], squares: &[f32]) {
    let share = 1.0 / weight;
    match aggregation {
        Aggregation::Avg => out.iter_mut().for_each(|sum| *sum *= share),
        Aggregation::Var | Aggregation::VisVar => {
            for (sum, square) in out.iter_mut().zip(squares) {
                let mean = *sum * share;
                *sum = square * share - mean * mean;
            }
        }
        // A maximum is finished already; the other aggregations reduce pairs of views.
        Aggregation::Max | Aggregation::VisAvg | Aggregation::VisMax | Aggregation::VisCorr => {}
    }
}
