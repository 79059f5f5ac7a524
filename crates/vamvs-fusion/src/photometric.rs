//! The photometric filter: keeps depths that are valid, unmasked and confident (section 4.2.2).

#![allow(
    clippy::needless_range_loop,
    reason = "one pixel of many arrays at a time, as the compiler turns into vectors"
)]

use rayon::prelude::*;
use vamvs_core::depth_map::is_valid;
use vamvs_core::{Grid, Pinhole, Pose, Size};

use crate::sample::Sample;
use crate::{FuseError, FuseOptions, MapSource, MaskedMap, ViewReport};
use vamvs_core::widened;

/// Tangent of the steepest slope against the image plane that counts as surface; beyond it (80.5°)
/// neighbouring depths belong to different surfaces.
const MAX_SLOPE: f64 = 6.0;

/// A view after the photometric filter, ready to be compared with others.
///
/// It holds *inverse* depths, for two reasons: they are linear in the image on a plane, so that
/// interpolation and slopes are exact there, and projection needs no division by them.
#[derive(Clone, Debug)]
pub(crate) struct FilteredView {
    pub camera: Pinhole,
    pub cam_from_world: Pose,
    /// 1/depth and confidence of each pixel; none where there is no depth or it was filtered out.
    pub samples: Grid<Sample>,
    /// What the filter removed; the later fields are 0.
    pub report: ViewReport,
    /// The relative change of inverse depth from a pixel to the next beyond which there is an edge.
    pub edge_step: f32,
}

impl FilteredView {
    /// Loads the depth map of view number `view` and applies the filter.
    pub fn load<S: MapSource + ?Sized>(
        view: usize,
        source: &S,
        options: &FuseOptions,
    ) -> Result<Self, FuseError> {
        Self::new(view, &source.load_map(view).map_err(FuseError::loading(view))?, options)
    }

    /// Applies the filter to view number `view`.
    pub fn new(view: usize, loaded: &MaskedMap, options: &FuseOptions) -> Result<Self, FuseError> {
        loaded.check(view)?;
        let (samples, report) = filter(loaded, options);
        let camera = loaded.map.camera;
        Ok(Self {
            camera,
            cam_from_world: loaded.map.cam_from_world,
            samples,
            report,
            edge_step: (MAX_SLOPE / focal(&camera)) as f32,
        })
    }

    pub fn size(&self) -> Size {
        self.samples.size()
    }

    /// 1/depth of a pixel.
    pub fn inverse_depth(&self, (x, y): (usize, usize)) -> f32 {
        self.samples[(x, y)].inverse_depth()
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        self.size().area() * size_of::<Sample>()
    }
}

/// The geometric mean of both focal lengths, pixels.
pub(crate) fn focal(camera: &Pinhole) -> f64 {
    (camera.intrinsics.fx * camera.intrinsics.fy).sqrt()
}

fn filter(loaded: &MaskedMap, options: &FuseOptions) -> (Grid<Sample>, ViewReport) {
    let size = loaded.map.depth.size();
    let mut samples = Grid::filled(size, Sample::NONE);
    let rows = samples.data_mut().par_chunks_mut(size.width.max(1)).enumerate();
    let reports: Vec<ViewReport> = rows.map(|(y, row)| filter_row(loaded, options, y, row)).collect();
    let mut report = ViewReport { pixels: size.area() as u64, ..ViewReport::default() };
    reports.into_iter().for_each(|row| report += row);
    (samples, report)
}

fn filter_row(loaded: &MaskedMap, options: &FuseOptions, y: usize, row: &mut [Sample]) -> ViewReport {
    let map = &loaded.map;
    let (certain, unmasked) = (vec![f32::INFINITY; row.len()], vec![true; row.len()]);
    let pixels = Pixels {
        depth: map.depth.row(y),
        confidence: map.confidence.row(y),
        coarse: map.coarse_confidence.as_ref().map_or(&certain, |grid| grid.row(y)),
        mask: loaded.mask.as_ref().map_or(&unmasked, |grid| grid.row(y)),
        least: [options.min_confidence, options.min_coarse_confidence],
    };
    let mut removed = Removed::default();
    filter_pixels(&pixels, row, &mut removed);
    let Removed { without_depth, masked, unconfident } = removed;
    ViewReport {
        without_depth: without_depth.into(),
        masked: masked.into(),
        unconfident: unconfident.into(),
        ..ViewReport::default()
    }
}

/// A row of a map, and the least confidences.
struct Pixels<'a> {
    depth: &'a [f32],
    confidence: &'a [f32],
    coarse: &'a [f32],
    mask: &'a [bool],
    least: [f32; 2],
}

/// Numbers of pixels that the filter removed from a row.
#[derive(Default)]
struct Removed {
    without_depth: u32,
    masked: u32,
    unconfident: u32,
}

widened! {
    /// Sets the samples of the pixels that pass; none elsewhere.
    fn filter_pixels(pixels: &Pixels<'_>, samples: &mut [Sample], removed: &mut Removed) = filter_pixels_any;
}

// Without branches and closures, so that it is compiled for the widest vectors.
#[inline(always)]
fn filter_pixels_any(pixels: &Pixels<'_>, samples: &mut [Sample], removed: &mut Removed) {
    let count = samples.len();
    let (depth, mask) = (&pixels.depth[..count], &pixels.mask[..count]);
    let (confidence, coarse) = (&pixels.confidence[..count], &pixels.coarse[..count]);
    let (mut without_depth, mut masked, mut unconfident) = (0, 0, 0);
    for x in 0..count {
        let with_depth = is_valid(depth[x]);
        let confident = (confidence[x] >= pixels.least[0]) & (coarse[x] >= pixels.least[1]);
        without_depth += u32::from(!with_depth);
        masked += u32::from(with_depth & !mask[x]);
        unconfident += u32::from(with_depth & mask[x] & !confident);
        let passes = with_depth & mask[x] & confident;
        let sample = Sample::new(1.0 / depth[x], confidence[x]);
        samples[x] = if passes { sample } else { Sample::NONE };
    }
    *removed = Removed { without_depth, masked, unconfident };
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{DepthMap, Intrinsics};

    const SIZE: Size = Size::new(4, 3);

    fn view(depth: Grid<f32>) -> MaskedMap {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 2.0, cy: 1.5 };
        let map = DepthMap {
            camera: Pinhole { size: SIZE, intrinsics },
            cam_from_world: Pose::identity(),
            depth,
            confidence: Grid::filled(SIZE, 1.0),
            coarse_confidence: Some(Grid::filled(SIZE, 1.0)),
        };
        MaskedMap { map, mask: None }
    }

    #[test]
    fn each_reason_removes_its_pixels_and_is_counted_once() {
        let mut loaded = view(Grid::filled(SIZE, 2.0));
        // One is a NaN with all bits set.
        for (x, bad) in [0.0, -1.0, f32::from_bits(u32::MAX), f32::INFINITY].into_iter().enumerate() {
            loaded.map.depth[(x, 0)] = bad;
        }
        loaded.mask = Some(Grid::from_fn(SIZE, |x, y| (x, y) != (0, 1) && y != 0));
        loaded.map.confidence[(1, 1)] = 0.09;
        loaded.map.confidence[(2, 1)] = f32::NAN;
        loaded.map.coarse_confidence.as_mut().unwrap()[(3, 1)] = 0.19;
        let filtered = FilteredView::new(0, &loaded, &FuseOptions::default()).unwrap();
        let expected =
            ViewReport { pixels: 12, without_depth: 4, masked: 1, unconfident: 3, ..Default::default() };
        assert_eq!(filtered.report, expected);
        assert!(filtered.samples.data()[..8].iter().all(|sample| *sample == Sample::NONE));
        assert!(filtered.samples.row(2).iter().all(|sample| *sample == Sample::new(0.5, 1.0)));
    }

    #[test]
    fn confidences_above_1_count_as_1() {
        let mut loaded = view(Grid::filled(SIZE, 2.0));
        (loaded.map.confidence[(0, 0)], loaded.map.confidence[(1, 0)]) = (f32::INFINITY, 1.5);
        let filtered = FilteredView::new(0, &loaded, &FuseOptions::default()).unwrap();
        assert_eq!(filtered.samples.row(0)[..2], [Sample::new(0.5, 1.0); 2]);
    }

    #[test]
    fn parts_of_another_size_are_refused() {
        let mut loaded = view(Grid::filled(SIZE, 2.0));
        loaded.mask = Some(Grid::filled(Size::new(3, 3), true));
        let error = FilteredView::new(7, &loaded, &FuseOptions::default()).unwrap_err();
        assert_eq!(error.to_string(), "view 7: expected a mask of 4×3 pixels like the depth map, got 3×3");
    }
}
