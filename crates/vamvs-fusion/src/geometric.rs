//! The geometric filter: do other views see the same surface there (section 4.2.2)?

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vamvs_core::{CloudPoint, Pose, Roi};

use crate::bits::BitGrid;
use crate::consistency::Rule;
use crate::lanes::{LANES, bits};
use crate::pair::Pair;
use crate::photometric::{FilteredView, focal};
use crate::round_trip::Strip;
use crate::{FuseOptions, ViewReport};

/// The pixels of a view that passed the filters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConsistentPixels {
    /// Their counts.
    pub counts: Counts,
    /// The pixels that are kept.
    pub(crate) bits: BitGrid,
}

impl ConsistentPixels {
    /// Whether the pixel in column `x` and row `y` is kept.
    #[must_use]
    pub fn contains(&self, x: usize, y: usize) -> bool {
        self.bits.get(x, y)
    }
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
    fn keep(&self, y: usize, row: &mut [u64]) -> RowCount {
        let mut count = RowCount::default();
        let parts = self.reference.samples.row(y).chunks(LANES).enumerate();
        let mut strips: Vec<Strip> =
            parts.map(|(number, part)| Strip::of_row(y, number * LANES, part)).collect();
        if let Some(roi) = &self.roi {
            count.outside_roi = strips.iter_mut().map(|strip| roi.remove_outside(strip)).sum();
        }
        self.rule.confirm(&strips, y, row);
        row.iter().zip(&strips).for_each(|(&kept, strip)| count.add(kept, strip));
        count
    }
}

impl RowCount {
    /// Counts the pixels of a strip; those of `kept` are confirmed.
    fn add(&mut self, kept: u64, strip: &Strip) {
        let asked = bits(&strip.inverse_depth.map(|w| w > 0.0));
        self.kept += u64::from(kept.count_ones());
        self.inconsistent += u64::from((asked & !kept).count_ones());
        // Eight sums, which do not wait for one another.
        let mut depths = [0.0; 8];
        for (eight, inverse_depths) in strip.inverse_depth.as_chunks::<8>().0.iter().enumerate() {
            for (lane, (sum, inverse_depth)) in depths.iter_mut().zip(inverse_depths).enumerate() {
                let is_kept = kept >> (8 * eight + lane) & 1 == 1;
                *sum += if is_kept { 1.0 / inverse_depth } else { 0.0 };
            }
        }
        self.depths += depths.map(f64::from).iter().sum::<f64>();
    }
}

/// Tells which pixels of a view have their points in a region.
pub(crate) struct RoiTest<'a> {
    reference: &'a FilteredView,
    world_from_cam: Pose,
    roi: &'a Roi,
}

impl<'a> RoiTest<'a> {
    pub fn new(reference: &'a FilteredView, roi: &'a Roi) -> Self {
        Self { reference, world_from_cam: reference.cam_from_world.inverse(), roi }
    }

    /// Removes the pixels outside of the region from the strip; returns their number.
    fn remove_outside(&self, strip: &mut Strip) -> u64 {
        let mut removed = 0;
        for (&x, inverse_depth) in strip.x.iter().zip(&mut strip.inverse_depth) {
            if *inverse_depth > 0.0 && !self.contains(Vector2::new(x, strip.y), *inverse_depth) {
                *inverse_depth = 0.0;
                removed += 1;
            }
        }
        removed
    }

    /// Puts the point of a pixel, whose mean of several views may lie outside of the region, where the pixel alone sees it.
    pub fn hold(&self, point: &mut CloudPoint, (x, y): (usize, usize)) {
        if !self.roi.contains(&point.x_in_world.into()) {
            let pixel = Vector2::new(x as f32 + 0.5, y as f32 + 0.5);
            point.x_in_world = self.point(pixel, self.reference.inverse_depth((x, y))).into();
        }
    }

    fn contains(&self, pixel: Vector2<f32>, inverse_depth: f32) -> bool {
        self.roi.contains(&self.point(pixel, inverse_depth))
    }

    /// The point of a pixel in the world.
    fn point(&self, pixel: Vector2<f32>, inverse_depth: f32) -> Vector3<f64> {
        let ray = self.reference.camera.intrinsics.ray(&pixel.cast());
        self.world_from_cam.transform(&(ray / f64::from(inverse_depth)))
    }
}
