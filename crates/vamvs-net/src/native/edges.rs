//! PointFlow's layers (section 3.4): edge convolutions over the neighbours of a point, and an MLP.
//!
//! Gathering, difference, ReLU and mean are one pass over the neighbours; libtorch writes each of these steps, sixteen
//! times as many values as there are points, to memory.

use rayon::prelude::*;

use super::dot::best_of;
use super::layers::{EdgeConv, Layer, Layers, Rows, relu};
use super::pairs::run;

/// Points that a thread takes at once.
const BLOCK: usize = 256;

/// Channels of which the sums over the neighbours are kept in registers.
const LANES: usize = 16;

/// The score of each point, a low one is likely: features (P, C) and the indices of k neighbours of each, (P, k), → (P).
pub(crate) fn scores(layers: &Layers, features: &[f32], neighbours: &[i64], out: &mut [f32]) {
    let points = out.len();
    let width: usize = layers.edges.iter().map(EdgeConv::outputs).sum();
    let mut joined = vec![0.0; points * width]; // the outputs of all edge convolutions, side by side
    let most = layers.edges.iter().map(|edge| edge.near.outputs()).max().unwrap_or(0);
    let (mut near, mut centre) = (vec![0.0; points * most], vec![0.0; points * most]);
    let mut end = 0;
    for (index, edge) in layers.edges.iter().enumerate() {
        let channels = edge.near.outputs();
        let (near, centre) = (&mut near[..points * channels], &mut centre[..points * channels]);
        let before = if index == 0 { None } else { Some(end - layers.edges[index - 1].outputs()) };
        linear_parts(edge, features, &mut joined, (width, before, end), near, centre);
        end += edge.outputs();
        gather(near, centre, neighbours, &mut joined, (width, end - channels, channels));
    }
    let blocks = out.par_chunks_mut(BLOCK).zip(joined.par_chunks(BLOCK * width));
    blocks.for_each_init(Default::default, |(now, next), (out, joined)| {
        score_block(&layers.scores, joined, width, (now, next), out);
    });
}

/// Computes the linear parts of an edge convolution. It reads the points' features, or the columns of `joined` from
/// `before` on, and writes what points keep of themselves to the columns from `own` on.
fn linear_parts(
    edge: &EdgeConv,
    features: &[f32],
    joined: &mut [f32],
    (width, before, own): (usize, Option<usize>, usize),
    near: &mut [f32],
    centre: &mut [f32],
) {
    let (channels, kept, inputs) = (edge.near.outputs(), edge.own.outputs(), edge.near.inputs());
    let of_features = features.len() / (near.len() / channels);
    let blocks = joined.par_chunks_mut(BLOCK * width).zip(features.par_chunks(BLOCK * of_features));
    let blocks =
        blocks.zip(near.par_chunks_mut(BLOCK * channels)).zip(centre.par_chunks_mut(BLOCK * channels));
    blocks.for_each_init(Vec::new, |scratch, (((joined, features), near), centre)| {
        let count = near.len() / channels;
        let rows = match before {
            None => Rows { values: features, width: inputs, count },
            Some(before) => Rows { values: &joined[before..], width, count },
        };
        edge.near.apply(rows, near);
        edge.centre.apply(rows, centre);
        if kept > 0 {
            scratch.resize(count * kept, 0.0);
            edge.own.apply(rows, scratch);
            relu(scratch);
            for (joined, own_values) in joined.chunks_exact_mut(width).zip(scratch.chunks_exact(kept)) {
                joined[own..][..kept].copy_from_slice(own_values);
            }
        }
    });
}

/// Writes the mean over the neighbours q of ReLU(near(q) − centre(p)) for each point p to the columns of `joined` from
/// `first` on.
fn gather(
    near: &[f32],
    centre: &[f32],
    neighbours: &[i64],
    joined: &mut [f32],
    (width, first, channels): (usize, usize, usize),
) {
    let k = neighbours.len() / (near.len() / channels);
    let blocks = joined.par_chunks_mut(BLOCK * width).zip(centre.par_chunks(BLOCK * channels));
    blocks.zip(neighbours.par_chunks(BLOCK * k)).for_each(|((joined, centre), neighbours)| {
        gather_block::<LANES>(near, centre, (neighbours, k), joined, (width, first, channels));
    });
}

#[inline(always)]
fn gather_points<const N: usize>(
    near: &[f32],
    centre: &[f32],
    (neighbours, k): (&[i64], usize),
    joined: &mut [f32],
    (width, first, channels): (usize, usize, usize),
) {
    let share = 1.0 / k as f32;
    let points =
        joined.chunks_exact_mut(width).zip(centre.chunks_exact(channels)).zip(neighbours.chunks_exact(k));
    for ((joined, centre), neighbours) in points {
        let (lanes, rest) = centre.as_chunks::<N>();
        let (out, out_rest) = joined[first..][..channels].as_chunks_mut::<N>();
        for (index, (centre, out)) in lanes.iter().zip(out).enumerate() {
            let mut sum = [0.0; N];
            for &q in neighbours {
                let near = &near[q as usize * channels + index * N..][..N];
                for lane in 0..N {
                    sum[lane] += (near[lane] - centre[lane]).max(0.0);
                }
            }
            *out = sum.map(|sum| sum * share);
        }
        for (index, (centre, out)) in rest.iter().zip(out_rest).enumerate() {
            let channel = channels - rest.len() + index;
            let of = |&q: &i64| (near[q as usize * channels + channel] - centre).max(0.0);
            *out = neighbours.iter().map(of).sum::<f32>() * share;
        }
    }
}
best_of!(gather_points => gather_block<const N>(
    near: &[f32],
    centre: &[f32],
    neighbours: (&[i64], usize),
    joined: &mut [f32],
    columns: (usize, usize, usize),
));

/// The MLP that ends the flow, on a block of rows of `width` channels.
fn score_block(
    layers: &[Layer],
    joined: &[f32],
    width: usize,
    (now, next): (&mut Vec<f32>, &mut Vec<f32>),
    out: &mut [f32],
) {
    let count = out.len();
    let (last, hidden) = layers.split_last().expect("an MLP has a layer");
    let Some((first, hidden)) = hidden.split_first() else {
        return last.apply(Rows { values: joined, width, count }, out);
    };
    now.resize(count * first.outputs(), 0.0);
    first.apply(Rows { values: joined, width, count }, now);
    relu(now);
    run(hidden, count, now, next);
    last.apply(Rows { values: now, width: last.inputs(), count }, out);
}
