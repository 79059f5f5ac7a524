//! The geometric filter: do other views see the same surface there (section 4.2.2)?

use nalgebra::Vector2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vamvs_core::{Pose, Roi};

use crate::alternate;
use crate::bits::BitGrid;
use crate::consistency::Rule;
use crate::lanes::{LANES, bits, set_bits};
use crate::pair::Pair;
use crate::photometric::{FilteredView, focal};
use crate::{FuseOptions, ViewReport};

/// The pixels of a view that passed the filters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConsistentPixels {
    /// Their counts.
    pub counts: Counts,
    /// The pixels that are kept.
    pub(crate) bits: BitGrid,
}

/// The counts of the first pass for a view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counts {
    /// Pixels that are kept.
    pub consistent: u64,
    /// The sum of their sizes on the surface (depth over focal length), scene units.
    pub footprints: f64,
    /// What the filters removed.
    pub report: ViewReport,
}

/// Finds the pixels of `reference` that the views of `pairs` confirm.
pub(crate) fn keep(
    reference: &FilteredView,
    pairs: &[Pair<'_>],
    options: &FuseOptions,
    roi: Option<&Roi>,
) -> ConsistentPixels {
    let rule = Rule::new(reference, pairs, options);
    let filter = RowFilter { reference, rule, roi: roi.map(|roi| RoiTest::new(reference, roi)) };
    let mut kept = BitGrid::zeros(reference.size());
    let rows: Vec<RowCount> = kept.rows_mut().enumerate().map(|(y, row)| filter.keep(y, row)).collect();
    let mut report = reference.report;
    report.outside_roi = rows.iter().map(|row| row.outside_roi).sum();
    report.inconsistent = rows.iter().map(|row| row.inconsistent).sum();
    let depths: f64 = rows.iter().map(|row| row.depths).sum();
    let consistent = rows.iter().map(|row| row.kept).sum();
    let footprints = depths / focal(&reference.camera);
    ConsistentPixels { counts: Counts { consistent, footprints, report }, bits: kept }
}

struct RowFilter<'a> {
    reference: &'a FilteredView,
    rule: Rule<'a>,
    roi: Option<RoiTest<'a>>,
}

#[derive(Default)]
struct RowCount {
    outside_roi: u64,
    inconsistent: u64,
    kept: u64,
    depths: f64,
}

impl RowFilter<'_> {
    /// Sets the bits of the pixels of row `y` that are kept.
    fn keep(&self, y: usize, kept: &mut [u64]) -> RowCount {
        let row = self.reference.samples.row(y);
        let with_depth = with_depth(row);
        let asked = match &self.roi {
            Some(roi) => roi.inside(&with_depth, row, y),
            None => with_depth.clone(),
        };
        let needed = self.rule.needed(y);
        let confirmed = |pixels: &[usize]| self.rule.confirmed(pixels, y, &needed);
        kept.copy_from_slice(&alternate::answers(&asked, row, self.rule.flat(), confirmed));
        let mut count = RowCount { outside_roi: ones(&with_depth) - ones(&asked), ..RowCount::default() };
        (count.kept, count.inconsistent) = (ones(kept), ones(&asked) - ones(kept));
        for (kept, samples) in kept.iter().zip(row.chunks(LANES)) {
            count.depths += depths(*kept, samples);
        }
        count
    }
}

/// The pixels of a row that have a depth, one bit each.
fn with_depth(row: &[[f32; 2]]) -> Vec<u64> {
    let bits = |samples: &[[f32; 2]]| {
        let mut with_depth = [false; LANES];
        with_depth.iter_mut().zip(samples).for_each(|(with_depth, [w, _])| *with_depth = *w > 0.0);
        bits(&with_depth)
    };
    row.chunks(LANES).map(bits).collect()
}

fn ones(row: &[u64]) -> u64 {
    row.iter().map(|word| u64::from(word.count_ones())).sum()
}

/// The sum of the depths of at most [`LANES`] pixels, of those that are kept.
fn depths(kept: u64, samples: &[[f32; 2]]) -> f64 {
    // Eight sums, which do not wait for one another.
    let mut depths = [0.0; 8];
    for (lane, [inverse_depth, _]) in samples.iter().enumerate() {
        depths[lane % 8] += if kept >> lane & 1 == 1 { 1.0 / inverse_depth } else { 0.0 };
    }
    depths.map(f64::from).iter().sum()
}

struct RoiTest<'a> {
    reference: &'a FilteredView,
    world_from_cam: Pose,
    roi: &'a Roi,
}

impl<'a> RoiTest<'a> {
    fn new(reference: &'a FilteredView, roi: &'a Roi) -> Self {
        Self { reference, world_from_cam: reference.cam_from_world.inverse(), roi }
    }

    /// The pixels of row `y` among `pixels` whose points are in the region, one bit each.
    fn inside(&self, pixels: &[u64], row: &[[f32; 2]], y: usize) -> Vec<u64> {
        let is_inside = |x: usize| self.contains(Vector2::new(x as f32 + 0.5, y as f32 + 0.5), row[x][0]);
        let inside = |(word, &pixels): (usize, &u64)| {
            let inside = set_bits(pixels).filter(|bit| is_inside(word * LANES + bit));
            inside.fold(0, |bits, bit| bits | 1 << bit)
        };
        pixels.iter().enumerate().map(inside).collect()
    }

    fn contains(&self, pixel: Vector2<f32>, inverse_depth: f32) -> bool {
        let ray = self.reference.camera.intrinsics.ray(&pixel.cast());
        self.roi.contains(&self.world_from_cam.transform(&(ray / f64::from(inverse_depth))))
    }
}
