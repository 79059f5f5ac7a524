//! The geometric filter: does another view see the same surface there (section 4.2.2)?

use std::sync::Arc;

use nalgebra::{Matrix3, Vector2, Vector3};
use rayon::prelude::*;
use vamvs_core::homography::PixelTransfer;
use vamvs_core::{Pose, Roi};

use crate::bits::{self, BitGrid};
use crate::photometric::{FilteredView, Sample, centre, focal};
use crate::{FuseOptions, ViewReport};

/// A reference view and a source view.
///
/// The transfers hold no world coordinates, so single precision is enough wherever the scene lies.
pub(crate) struct Pair {
    /// The source view's number.
    pub source_view: usize,
    pub source: Arc<FilteredView>,
    pub reference_from_source: Pose,
    to_source: Transfer,
    to_reference: Transfer,
    max_reprojection: f32,
    max_relative_depth: f32,
}

/// What a source view says of a reference pixel that it agrees with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Match {
    /// The source view's pixel and inverse depth.
    pub sample: Sample,
    /// The source's surface point as a homogeneous reference pixel over the source depth.
    back: Vector3<f32>,
}

/// [`PixelTransfer`] in single precision and for inverse depths.
struct Transfer {
    linear: Matrix3<f32>,
    offset: Vector3<f32>,
}

impl Transfer {
    /// The homogeneous pixel in the other view, divided by the depth in this one.
    #[inline]
    fn apply(&self, pixel: Vector2<f32>, inverse_depth: f32) -> Vector3<f32> {
        self.linear * pixel.push(1.0) + self.offset * inverse_depth
    }
}

impl From<PixelTransfer> for Transfer {
    fn from(transfer: PixelTransfer) -> Self {
        Self { linear: transfer.linear.cast(), offset: transfer.offset.cast() }
    }
}

impl Pair {
    pub fn new(
        reference: &FilteredView,
        source_view: usize,
        source: Arc<FilteredView>,
        options: &FuseOptions,
    ) -> Self {
        let reference_from_source = reference.cam_from_world.compose(&source.cam_from_world.inverse());
        let source_from_reference = reference_from_source.inverse();
        Self {
            source_view,
            to_source: PixelTransfer::new(&reference.camera, &source.camera, &source_from_reference).into(),
            to_reference: PixelTransfer::new(&source.camera, &reference.camera, &reference_from_source)
                .into(),
            reference_from_source,
            source,
            max_reprojection: options.max_reprojection,
            max_relative_depth: options.max_relative_depth,
        }
    }

    /// What the source view says of the reference pixel at image coordinates `pixel`: its depth there
    /// is taken back to the reference view and must end near the pixel and near its depth.
    #[inline]
    pub fn agreement(&self, pixel: Vector2<f32>, inverse_depth: f32) -> Option<Match> {
        let seen = self.to_source.apply(pixel, inverse_depth);
        if seen.z <= 0.0 {
            return None;
        }
        let sample = self.source.sample(seen.xy() * seen.z.recip())?;
        let back = self.to_reference.apply(sample.at, sample.inverse_depth);
        // The depth that comes back is back.z / w, with w the source's inverse depth.
        let depth_error = (back.z * inverse_depth - sample.inverse_depth).abs();
        let way = (back.xy() - pixel * back.z).norm_squared();
        let agrees = depth_error < self.max_relative_depth * sample.inverse_depth
            && way < (self.max_reprojection * back.z).powi(2);
        agrees.then_some(Match { sample, back })
    }
}

impl Match {
    /// The source's surface point in the reference camera's frame.
    pub fn x_in_reference(&self, reference: &FilteredView) -> Vector3<f32> {
        let k = &reference.camera.intrinsics;
        let z = self.back.z / self.sample.inverse_depth;
        let (x, y) = (self.back.x / self.back.z, self.back.y / self.back.z);
        Vector3::new((x - k.cx as f32) / k.fx as f32 * z, (y - k.cy as f32) / k.fy as f32 * z, z)
    }
}

/// What the filters left of a view.
#[derive(Default)]
pub(crate) struct Kept {
    /// The pixels that are kept.
    pub bits: BitGrid,
    /// How many of them there are.
    pub count: u64,
    /// The sum of their sizes on the surface (depth over focal length), scene units.
    pub footprints: f64,
    /// What was removed so far.
    pub report: ViewReport,
}

/// Finds the pixels of `reference` on which enough views agree.
pub(crate) fn keep(reference: &FilteredView, pairs: &[Pair], min_views: usize, roi: Option<&Roi>) -> Kept {
    let filter = RowFilter { reference, pairs, min_views, roi: roi.map(|roi| RoiTest::new(reference, roi)) };
    let mut kept = BitGrid::zeros(reference.size());
    let rows: Vec<RowCount> = kept.rows_mut().enumerate().map(|(y, row)| filter.keep(y, row)).collect();
    let mut report = reference.report;
    report.outside_roi = rows.iter().map(|row| row.outside_roi).sum();
    report.inconsistent = rows.iter().map(|row| row.inconsistent).sum();
    let depths: f64 = rows.iter().map(|row| row.depths).sum();
    let count = rows.iter().map(|row| row.kept).sum();
    Kept { bits: kept, count, footprints: depths / focal(&reference.camera), report }
}

struct RowFilter<'a> {
    reference: &'a FilteredView,
    pairs: &'a [Pair],
    min_views: usize,
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
        for (x, &inverse_depth) in self.reference.inverse_depth.row(y).iter().enumerate() {
            if inverse_depth <= 0.0 {
                continue;
            }
            let pixel = centre(x, y);
            if self.roi.as_ref().is_some_and(|roi| !roi.contains(pixel, inverse_depth)) {
                count.outside_roi += 1;
            } else if self.is_confirmed(pixel, inverse_depth) {
                bits::set(row, x);
                count.kept += 1;
                count.depths += 1.0 / f64::from(inverse_depth);
            } else {
                count.inconsistent += 1;
            }
        }
        count
    }

    /// Whether enough views agree; asks no more views than it takes.
    fn is_confirmed(&self, pixel: Vector2<f32>, inverse_depth: f32) -> bool {
        let mut missing = self.min_views - 1;
        for (asked, pair) in self.pairs.iter().enumerate() {
            if missing == 0 || missing > self.pairs.len() - asked {
                break;
            }
            missing -= usize::from(pair.agreement(pixel, inverse_depth).is_some());
        }
        missing == 0
    }
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

    fn contains(&self, pixel: Vector2<f32>, inverse_depth: f32) -> bool {
        let ray = self.reference.camera.intrinsics.ray(&pixel.cast());
        self.roi.contains(&self.world_from_cam.transform(&(ray / f64::from(inverse_depth))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FusionView;
    use vamvs_core::{DepthMap, Grid, Intrinsics, Pinhole, Size};

    const SIZE: Size = Size::new(80, 60);

    /// A camera at (x, 0, 0) that looks along z and sees the same depth everywhere.
    fn wall(x: f64, depth: f32, options: &FuseOptions) -> FilteredView {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 40.0, cy: 30.0 };
        let map = DepthMap {
            camera: Pinhole { size: SIZE, intrinsics },
            cam_from_world: Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() },
            depth: Grid::filled(SIZE, depth),
            confidence: Grid::filled(SIZE, 1.0),
            coarse_confidence: None,
        };
        let view = FusionView { map, colour: Grid::filled(SIZE, [0; 3]), mask: None };
        FilteredView::new(0, view, options).unwrap()
    }

    /// Whether a camera one unit beside agrees on a wall at depth 4 that it sees at 4 (1 + error).
    fn agrees(error: f32, max_reprojection: f32, max_relative_depth: f32) -> bool {
        let options = FuseOptions { max_reprojection, max_relative_depth, ..FuseOptions::default() };
        let reference = wall(0.0, 4.0, &options);
        let source = Arc::new(wall(1.0, 4.0 * (1.0 + error), &options));
        Pair::new(&reference, 1, source, &options).agreement(centre(50, 30), 0.25).is_some()
    }

    #[test]
    fn both_the_way_back_and_the_depth_are_bounded() {
        // The disparity is 25 pixels, so 3 % of depth are 0.75 · 1/1.03 = 0.728 pixels of the way.
        for (error, way) in [(0.03, 0.7281), (-0.03, 0.7732), (0.002, 0.0499)] {
            assert!(agrees(error, way + 1e-3, 0.05) && !agrees(error, way - 1e-3, 0.05), "{error}");
            let depth = error.abs();
            assert!(agrees(error, 2.0, depth + 1e-5) && !agrees(error, 2.0, depth - 1e-5), "{error}");
        }
    }

    #[test]
    fn what_the_source_does_not_see_gets_no_agreement() {
        let options = FuseOptions::default();
        let (reference, source) = (wall(0.0, 4.0, &options), Arc::new(wall(1.0, 4.0, &options)));
        let pair = Pair::new(&reference, 1, source, &options);
        assert!(pair.agreement(centre(25, 30), 0.25).is_some());
        assert!(pair.agreement(centre(24, 30), 0.25).is_none(), "25 pixels to the left is outside");
        assert!(pair.agreement(centre(50, 30), -0.25).is_none(), "behind the camera");
    }

    #[test]
    fn a_match_lies_where_the_source_sees_it() {
        let options = FuseOptions::default();
        let (reference, source) = (wall(0.0, 4.0, &options), Arc::new(wall(1.0, 4.02, &options)));
        let found = Pair::new(&reference, 1, source, &options).agreement(centre(50, 30), 0.25).unwrap();
        // Seen at x = 25.5, 0.145 left of the source's axis per unit of depth.
        let expected = Vector3::new(1.0 - 0.145 * 4.02, 0.005 * 4.02, 4.02);
        assert!((found.x_in_reference(&reference) - expected).norm() < 1e-5);
    }
}
