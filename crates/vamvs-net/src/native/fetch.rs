//! PointFlow's features of vis-corr: for each hypothesised point, its correlations at all levels, averaged over the
//! source views with their visibility as weights.

use rayon::prelude::*;

use super::Level;
use super::dot::{Corners, best_of};
use super::transfer::Transfer;
use crate::aggregate::UNSEEN;
use crate::project::PixelGrid;

/// Levels of the flow features.
const LEVELS: usize = 3;

/// A source view of the flow.
pub(crate) struct Source<'a> {
    pub levels: [Level<'a>; LEVELS],
    pub transfer: Transfer,
    /// The visibility of each reference pixel in this view, (h·w).
    pub mask: &'a [f32],
}

/// The points whose features are computed: J hypotheses for each pixel of a grid.
pub(crate) struct Points<'a> {
    pub pixel_grid: &'a PixelGrid,
    /// Depths, (J, h·w), in units of the nearest depth searched.
    pub depths: &'a [f32],
    /// The reference view's own features of all levels at the pixels, (h·w, C₁ + C₂ + C₃).
    pub reference: &'a [f32],
    /// Number of channels in a group.
    pub group: usize,
}

/// Writes the correlations of all points into the first columns of `rows`, (h·w·J, `width`). Points are in the order
/// (pixel, hypothesis).
pub(crate) fn correlations(points: &Points<'_>, sources: &[Source<'_>], rows: &mut [f32], width: usize) {
    let columns = points.pixel_grid.x.len();
    let hypotheses = points.depths.len() / (columns * points.pixel_grid.y.len());
    rows.par_chunks_mut(columns * hypotheses * width).enumerate().for_each(|(y, rows)| {
        correlate_row::<1>(points, sources, (y, hypotheses), rows, width);
    });
}

#[inline(always)]
fn correlate<const ONE: usize>(
    points: &Points<'_>,
    sources: &[Source<'_>],
    (y, hypotheses): (usize, usize),
    rows: &mut [f32],
    width: usize,
) {
    let columns = points.pixel_grid.x.len();
    let pixels = columns * points.pixel_grid.y.len();
    let mut rays = Vec::with_capacity(columns);
    let channels: usize =
        sources.first().map_or(0, |source| source.levels.iter().map(|level| level.channels).sum());
    for row in rows.chunks_exact_mut(width) {
        row[..channels / points.group].fill(0.0);
    }
    for source in sources {
        source.transfer.rays(points.pixel_grid, y, &mut rays);
        for (x, (ray, rows)) in rays.iter().zip(rows.chunks_exact_mut(hypotheses * width)).enumerate() {
            let pixel = y * columns + x;
            let reference = &points.reference[pixel * channels..][..channels];
            for (j, row) in rows.chunks_exact_mut(width).enumerate() {
                let Some(place) = source.transfer.place(*ray, points.depths[j * pixels + pixel]) else {
                    continue;
                };
                add_levels(&source.levels, (reference, place), points.group, source.mask[pixel], row);
            }
        }
    }
    for (x, rows) in rows.chunks_exact_mut(hypotheses * width).enumerate() {
        let weight: f32 = sources.iter().map(|source| source.mask[y * columns + x]).sum();
        let share = 1.0 / (weight + UNSEEN as f32);
        for row in rows.chunks_exact_mut(width) {
            row[..channels / points.group].iter_mut().for_each(|value| *value *= share);
        }
    }
}
best_of!(correlate => correlate_row<const ONE>(
    points: &Points<'_>,
    sources: &[Source<'_>],
    at: (usize, usize),
    rows: &mut [f32],
    width: usize,
));

/// Adds the correlations of one point at all levels to `row`, multiplied by `weight`.
#[inline(always)]
fn add_levels(
    levels: &[Level<'_>; LEVELS],
    (mut reference, place): (&[f32], [f32; 2]),
    group: usize,
    weight: f32,
    mut row: &mut [f32],
) {
    for level in levels {
        let (own, rest) = reference.split_at(level.channels);
        let (sums, others) = row.split_at_mut(level.channels / group);
        if let Some(corners) = Corners::around(level, place) {
            match sums.len() {
                4 => corners.add_correlation::<4>(level, own, weight, sums.try_into().expect("four groups")),
                _ => corners.add_correlation::<8>(level, own, weight, sums.try_into().expect("eight groups")),
            }
        }
        (reference, row) = (rest, others);
    }
}
