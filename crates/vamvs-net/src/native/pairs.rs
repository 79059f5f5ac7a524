//! vis-max and vis-avg: features of pairs of the reference view and each source view, reduced over the source views.
//!
//! A block of points goes through sampling and all layers of the shared MLP while its values are in the processor's
//! cache; libtorch writes the output of each of these steps to memory.

use rayon::prelude::*;

use super::Level;
use super::dot::best_of;
use super::layers::{Layer, PairMlp, Rows, relu};
use super::ncc::{Moments, Own, moments_of};
use super::samples::{Points, Sampled, sample_pixels};
use crate::Aggregation;

/// Points that go through the layers at once: their widest values, 128 channels, take 128 KiB.
const BLOCK: usize = 256;

/// What all source views share.
pub(crate) struct Pairs<'a> {
    pub points: Points<'a>,
    /// What [`PairMlp::of_reference`] gives for the reference view's own features at the pixels, (h·w, H).
    pub reference: &'a [f32],
    pub mlp: &'a PairMlp,
    /// The part of the first layer that depends on the source view; absent if the sampled features went through it
    /// before, because interpolation and a linear map commute.
    pub of_source: Option<&'a Layer>,
    pub reduction: Reduction,
    /// The reference view's channels that the MLP leaves aside, if their correlation is wanted.
    pub aside: Option<Own<'a>>,
}

/// How pairs are reduced over the source views.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reduction {
    Max,
    Mean,
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    rays: Vec<Vec<[f32; 3]>>,
    sampled: Vec<f32>,
    now: Vec<f32>,
    next: Vec<f32>,
}

impl Reduction {
    /// The reduction of an aggregation that relates pairs.
    pub fn of(aggregation: Aggregation) -> Self {
        if aggregation == Aggregation::VisMax { Self::Max } else { Self::Mean }
    }
}

/// What a layer gives for the features of all pixels, (h·w, outputs).
pub(crate) fn of_pixels(layer: &Layer, features: Level<'_>) -> Vec<f32> {
    let Level { values, width, height, channels } = features;
    let outputs = layer.outputs();
    let mut out = vec![0.0; width * height * outputs];
    let blocks = out.par_chunks_mut(BLOCK * outputs).zip(values.par_chunks(BLOCK * channels));
    blocks.for_each(|(out, values)| {
        layer.apply(Rows { values, width: channels, count: out.len() / outputs }, out);
    });
    out
}

/// Writes the reduced pair features of all points to the first columns of `out`, (h·w·J, at least C'), and the moments of
/// the channels that the MLP leaves aside to `moments`, (h·w·J, S); nothing if [`Pairs::aside`] is absent.
pub(crate) fn related(pairs: &Pairs<'_>, sources: &[Sampled<'_>], out: &mut [f32], moments: &mut [Moments]) {
    let Pairs { points, .. } = pairs;
    let (rows, points_of_row) = (points.pixel_grid.y.len(), points.columns() * points.hypotheses());
    let mut moments: Vec<&mut [Moments]> = match pairs.aside {
        None => (0..rows).map(|_| Default::default()).collect(),
        Some(_) => moments.chunks_mut(points_of_row * sources.len()).collect(),
    };
    let out = out.par_chunks_mut(out.len() / rows).zip(&mut moments).enumerate();
    out.for_each_init(Scratch::default, |scratch, (y, (out, moments))| {
        scratch.rays.resize(sources.len(), Vec::new());
        for (source, rays) in sources.iter().zip(&mut scratch.rays) {
            source.transfer.rays(points.pixel_grid, y, rays);
        }
        relate_row(pairs, sources, y, scratch, (out, moments));
    });
}

fn relate_row(
    pairs: &Pairs<'_>,
    sources: &[Sampled<'_>],
    y: usize,
    scratch: &mut Scratch,
    (out, moments): (&mut [f32], &mut [Moments]),
) {
    let Pairs { points, mlp, reduction, aside, .. } = pairs;
    let (columns, hypotheses, outputs) = (points.columns(), points.hypotheses(), mlp.outputs());
    let pixel = out.len() / columns; // values of a pixel
    let step = (BLOCK / hypotheses).max(1);
    for first in (0..columns).step_by(step) {
        let last = (first + step).min(columns);
        let place = y * columns + first;
        let out = &mut out[first * pixel..last * pixel];
        for (index, source) in sources.iter().enumerate() {
            let channels = source.channels();
            scratch.sampled.resize((last - first) * hypotheses * channels, 0.0);
            sample_pixels::<1>(
                points,
                source,
                &scratch.rays[index][first..last],
                place,
                &mut scratch.sampled,
            );
            if let Some(own) = aside {
                let moments = &mut moments[first * sources.len()..last * sources.len()];
                let rows = (scratch.sampled.as_slice(), channels);
                moments_of::<1>(*own, place, rows, (index, sources.len()), moments);
            }
            relate_block(pairs, place, channels, scratch);
            let share = if index + 1 == sources.len() { 1.0 / sources.len() as f32 } else { 1.0 };
            reduce_block::<1>(
                (*reduction, index == 0, share),
                (&scratch.now, outputs),
                out,
                pixel / hypotheses,
            );
        }
    }
}

/// Puts a block of sampled features through the layers, into `scratch.now`. Its pixels begin with `first`.
fn relate_block(pairs: &Pairs<'_>, first: usize, channels: usize, scratch: &mut Scratch) {
    let Scratch { sampled, now, next, .. } = scratch;
    let (mlp, hypotheses) = (pairs.mlp, pairs.points.hypotheses());
    let count = sampled.len() / channels;
    let hidden = mlp.of_reference.outputs();
    now.resize(count * hidden, 0.0);
    let reference = pairs.reference[first * hidden..].chunks_exact(hidden);
    for (now, reference) in now.chunks_exact_mut(hypotheses * hidden).zip(reference) {
        now.chunks_exact_mut(hidden).for_each(|now| now.copy_from_slice(reference));
    }
    match pairs.of_source {
        Some(layer) => layer.add(Rows { values: sampled, width: channels, count }, now),
        None => add_rows::<1>(sampled, channels, now, hidden),
    }
    relu(now);
    run(&mlp.rest, count, now, next);
}

/// Runs layers, each with a ReLU, on `count` rows in `now`, where the result is too. `next` is scratch memory.
pub(super) fn run(layers: &[Layer], count: usize, now: &mut Vec<f32>, next: &mut Vec<f32>) {
    for layer in layers {
        next.resize(count * layer.outputs(), 0.0);
        layer.apply(Rows { values: now, width: layer.inputs(), count }, next);
        relu(next);
        std::mem::swap(now, next);
    }
}

/// Adds the first columns of `rows`, which are `width` apart, to those of `out`.
#[inline(always)]
fn add_columns<const ONE: usize>(rows: &[f32], width: usize, out: &mut [f32], columns: usize) {
    for (out, row) in out.chunks_exact_mut(columns).zip(rows.chunks_exact(width)) {
        out.iter_mut().zip(row).for_each(|(out, value)| *out += value);
    }
}
best_of!(add_columns => add_rows<const ONE>(rows: &[f32], width: usize, out: &mut [f32], columns: usize));

/// Reduces rows of `columns` values into the first columns of `out`, whose rows are `width` apart. The first source view
/// begins the reduction; a mean is multiplied by `share`.
#[inline(always)]
fn reduce<const ONE: usize>(
    (reduction, first, share): (Reduction, bool, f32),
    (rows, columns): (&[f32], usize),
    out: &mut [f32],
    width: usize,
) {
    for (out, row) in out.chunks_exact_mut(width).zip(rows.chunks_exact(columns)) {
        let pairs = out.iter_mut().zip(row);
        match (reduction, first) {
            (Reduction::Max, true) => out[..columns].copy_from_slice(row),
            (Reduction::Max, false) => pairs.for_each(|(out, value)| *out = out.max(*value)),
            (Reduction::Mean, true) => pairs.for_each(|(out, value)| *out = value * share),
            (Reduction::Mean, false) => pairs.for_each(|(out, value)| *out = (*out + value) * share),
        }
    }
}
best_of!(reduce => reduce_block<const ONE>(
    how: (Reduction, bool, f32),
    rows: (&[f32], usize),
    out: &mut [f32],
    width: usize,
));
