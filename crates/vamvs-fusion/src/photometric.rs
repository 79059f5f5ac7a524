//! The photometric filter: keeps depths that are valid, unmasked and confident (section 4.2.2).

use rayon::prelude::*;
use vamvs_core::depth_map::is_valid;
use vamvs_core::{Grid, Pinhole, Pose, Size};

use crate::{FuseError, FuseOptions, MaskedMap, ViewReport};

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
    /// 1/depth; 0 where there is none or it was filtered out.
    pub inverse_depth: Grid<f32>,
    pub confidence: Grid<f32>,
    /// What the filter removed; the later fields are 0.
    pub report: ViewReport,
    /// The relative change of inverse depth from a pixel to the next beyond which there is an edge.
    pub edge_step: f32,
}

impl FilteredView {
    /// Applies the filter to view number `view`.
    pub fn new(view: usize, loaded: MaskedMap, options: &FuseOptions) -> Result<Self, FuseError> {
        loaded.check(view)?;
        let (inverse_depth, report) = filter(&loaded, options);
        let camera = loaded.map.camera;
        Ok(Self {
            camera,
            cam_from_world: loaded.map.cam_from_world,
            inverse_depth,
            confidence: loaded.map.confidence,
            report,
            edge_step: (MAX_SLOPE / focal(&camera)) as f32,
        })
    }

    pub fn size(&self) -> Size {
        self.inverse_depth.size()
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        self.size().area() * 2 * size_of::<f32>()
    }
}

/// The geometric mean of both focal lengths, pixels.
pub(crate) fn focal(camera: &Pinhole) -> f64 {
    (camera.intrinsics.fx * camera.intrinsics.fy).sqrt()
}

fn filter(loaded: &MaskedMap, options: &FuseOptions) -> (Grid<f32>, ViewReport) {
    let size = loaded.map.depth.size();
    let mut inverse_depth = Grid::filled(size, 0.0);
    let rows = inverse_depth.data_mut().par_chunks_mut(size.width.max(1)).enumerate();
    let reports: Vec<ViewReport> = rows.map(|(y, row)| filter_row(loaded, options, y, row)).collect();
    let mut report = ViewReport { pixels: size.area() as u64, ..ViewReport::default() };
    reports.into_iter().for_each(|row| report += row);
    (inverse_depth, report)
}

fn filter_row(loaded: &MaskedMap, options: &FuseOptions, y: usize, row: &mut [f32]) -> ViewReport {
    let map = &loaded.map;
    let (depth, confidence) = (map.depth.row(y), map.confidence.row(y));
    let coarse = map.coarse_confidence.as_ref().map(|grid| grid.row(y));
    let mask = loaded.mask.as_ref().map(|grid| grid.row(y));
    let mut report = ViewReport::default();
    let min = (options.min_confidence, options.min_coarse_confidence);
    for (x, inverse) in row.iter_mut().enumerate() {
        // Without branches: whether a pixel is confident may change from one to the next.
        let with_depth = is_valid(depth[x]);
        let unmasked = mask.is_none_or(|mask| mask[x]);
        let confident = (confidence[x] >= min.0) & coarse.is_none_or(|coarse| coarse[x] >= min.1);
        report.without_depth += u64::from(!with_depth);
        report.masked += u64::from(with_depth & !unmasked);
        report.unconfident += u64::from(with_depth & unmasked & !confident);
        *inverse = if with_depth & unmasked & confident { depth[x].recip() } else { 0.0 };
    }
    report
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
        for (x, bad) in [0.0, -1.0, f32::NAN, f32::INFINITY].into_iter().enumerate() {
            loaded.map.depth[(x, 0)] = bad;
        }
        loaded.mask = Some(Grid::from_fn(SIZE, |x, y| (x, y) != (0, 1) && y != 0));
        loaded.map.confidence[(1, 1)] = 0.09;
        loaded.map.confidence[(2, 1)] = f32::NAN;
        loaded.map.coarse_confidence.as_mut().unwrap()[(3, 1)] = 0.19;
        let filtered = FilteredView::new(0, loaded, &FuseOptions::default()).unwrap();
        let expected =
            ViewReport { pixels: 12, without_depth: 4, masked: 1, unconfident: 3, ..Default::default() };
        assert_eq!(filtered.report, expected);
        assert!(filtered.inverse_depth.data()[..8].iter().all(|&w| w == 0.0));
        assert!(filtered.inverse_depth.row(2).iter().all(|&w| w == 0.5));
    }

    #[test]
    fn parts_of_another_size_are_refused() {
        let mut loaded = view(Grid::filled(SIZE, 2.0));
        loaded.mask = Some(Grid::filled(Size::new(3, 3), true));
        let error = FilteredView::new(7, loaded, &FuseOptions::default()).unwrap_err();
        assert_eq!(error.to_string(), "view 7: expected a mask of 4×3 pixels like the depth map, got 3×3");
    }
}
