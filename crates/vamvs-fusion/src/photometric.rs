//! The photometric filter: depths that are there, count and are confident (section 4.2.2).

use nalgebra::Vector2;
use rayon::prelude::*;
use vamvs_core::depth_map::is_valid;
use vamvs_core::{Grid, Pinhole, Pose, Rgb, Size};

use crate::{FuseError, FuseOptions, FusionView, ViewReport};

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
    pub colour: Grid<Rgb>,
    /// What the filter removed; the later fields are 0.
    pub report: ViewReport,
    /// The relative change of inverse depth from a pixel to the next beyond which there is an edge.
    pub edge_step: f32,
    /// The relative difference of inverse depths up to which neighbours agree.
    max_spread: f32,
}

/// Where a view was asked for its depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// The pixel that covers the place.
    pub pixel: (usize, usize),
    /// Image coordinates of the place.
    pub at: Vector2<f32>,
    /// Inverse depth at the place.
    pub inverse_depth: f32,
}

impl FilteredView {
    /// Applies the filter to view number `view`.
    pub fn new(view: usize, loaded: FusionView, options: &FuseOptions) -> Result<Self, FuseError> {
        loaded.check(view)?;
        let (inverse_depth, report) = filter(&loaded, options);
        let camera = loaded.map.camera;
        Ok(Self {
            camera,
            cam_from_world: loaded.map.cam_from_world,
            inverse_depth,
            confidence: loaded.map.confidence,
            colour: loaded.colour,
            report,
            edge_step: (MAX_SLOPE / focal(&camera)) as f32,
            max_spread: options.max_relative_depth,
        })
    }

    pub fn size(&self) -> Size {
        self.inverse_depth.size()
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        self.size().area() * (2 * size_of::<f32>() + size_of::<Rgb>())
    }

    /// The inverse depth at image coordinates `at`: interpolated where the four pixels around agree,
    /// else that of the pixel there, at its centre. `None` outside and where there is no depth.
    #[inline]
    pub fn sample(&self, at: Vector2<f32>) -> Option<Sample> {
        let Size { width, height } = self.size();
        if !(at.x >= 0.0 && at.y >= 0.0 && at.x < width as f32 && at.y < height as f32) {
            return None;
        }
        let pixel = (at.x as usize, at.y as usize);
        if let Some(inverse_depth) = self.interpolated(at) {
            return Some(Sample { pixel, at, inverse_depth });
        }
        let inverse_depth = self.inverse_depth[pixel];
        (inverse_depth > 0.0).then(|| Sample { pixel, at: centre(pixel.0, pixel.1), inverse_depth })
    }

    /// Bilinear between the four pixels around; linear beyond the outermost centres.
    #[inline]
    fn interpolated(&self, at: Vector2<f32>) -> Option<f32> {
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let Size { width, height } = self.size();
        let (x0, y0) = ((x as usize).min(width.checked_sub(2)?), (y as usize).min(height.checked_sub(2)?));
        let corner = y0 * width + x0;
        let [top, bottom] = [corner, corner + width].map(|i| &self.inverse_depth.data()[i..i + 2]);
        let least = top[0].min(top[1]).min(bottom[0].min(bottom[1]));
        let most = top[0].max(top[1]).max(bottom[0].max(bottom[1]));
        if least <= 0.0 || most - least > self.max_spread * least {
            return None;
        }
        let (s, t) = (x - x0 as f32, y - y0 as f32);
        let upper = top[0] + s * (top[1] - top[0]);
        let lower = bottom[0] + s * (bottom[1] - bottom[0]);
        Some(upper + t * (lower - upper))
    }
}

/// Image coordinates of a pixel's centre.
#[inline]
pub(crate) fn centre(x: usize, y: usize) -> Vector2<f32> {
    Vector2::new(x as f32 + 0.5, y as f32 + 0.5)
}

/// The geometric mean of both focal lengths, pixels.
pub(crate) fn focal(camera: &Pinhole) -> f64 {
    (camera.intrinsics.fx * camera.intrinsics.fy).sqrt()
}

fn filter(loaded: &FusionView, options: &FuseOptions) -> (Grid<f32>, ViewReport) {
    let size = loaded.map.depth.size();
    let mut inverse_depth = Grid::filled(size, 0.0);
    let rows = inverse_depth.data_mut().par_chunks_mut(size.width.max(1)).enumerate();
    let reports: Vec<ViewReport> = rows.map(|(y, row)| filter_row(loaded, options, y, row)).collect();
    let mut report = ViewReport { pixels: size.area() as u64, ..ViewReport::default() };
    reports.into_iter().for_each(|row| report += row);
    (inverse_depth, report)
}

fn filter_row(loaded: &FusionView, options: &FuseOptions, y: usize, row: &mut [f32]) -> ViewReport {
    let map = &loaded.map;
    let (depth, confidence) = (map.depth.row(y), map.confidence.row(y));
    let coarse = map.coarse_confidence.as_ref().map(|grid| grid.row(y));
    let mask = loaded.mask.as_ref().map(|grid| grid.row(y));
    let mut report = ViewReport::default();
    for (x, inverse) in row.iter_mut().enumerate() {
        let coarse_ok = coarse.is_none_or(|c| c[x] >= options.min_coarse_confidence);
        if !is_valid(depth[x]) {
            report.without_depth += 1;
        } else if mask.is_some_and(|mask| !mask[x]) {
            report.masked += 1;
        } else if !(coarse_ok && confidence[x] >= options.min_confidence) {
            report.unconfident += 1;
        } else {
            *inverse = depth[x].recip();
        }
    }
    report
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{DepthMap, Intrinsics};

    const SIZE: Size = Size::new(4, 3);

    fn view(depth: Grid<f32>) -> FusionView {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 2.0, cy: 1.5 };
        let map = DepthMap {
            camera: Pinhole { size: SIZE, intrinsics },
            cam_from_world: Pose::identity(),
            depth,
            confidence: Grid::filled(SIZE, 1.0),
            coarse_confidence: Some(Grid::filled(SIZE, 1.0)),
        };
        FusionView { map, colour: Grid::filled(SIZE, [0; 3]), mask: None }
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
    fn samples_interpolate_on_a_surface_and_not_across_an_edge() {
        let depth = Grid::from_fn(SIZE, |x, _| if x < 2 { 1.0 / (1.0 + 0.008 * x as f32) } else { 5.0 });
        let filtered = FilteredView::new(0, view(depth), &FuseOptions::default()).unwrap();
        let at = |x, y| filtered.sample(Vector2::new(x, y));
        for (x, expected) in [(1.0, 1.004), (0.0, 0.996), (1.9, 1.008), (2.1, 0.2)] {
            assert!((at(x, 1.2).unwrap().inverse_depth - expected).abs() < 1e-6);
        }
        assert_eq!(at(1.0, 1.2).unwrap().at, Vector2::new(1.0, 1.2));
        assert_eq!(at(1.9, 1.2).unwrap().at, Vector2::new(1.5, 1.5));
        assert_eq!(at(3.9, 2.9).unwrap().pixel, (3, 2));
        assert_eq!(at(0.0, 0.0).unwrap().pixel, (0, 0));
        for (x, y) in [(-0.01, 1.0), (4.0, 1.0), (1.0, 3.0), (f32::NAN, 1.0)] {
            assert_eq!(at(x, y), None);
        }
    }

    #[test]
    fn parts_of_another_size_are_refused() {
        let mut loaded = view(Grid::filled(SIZE, 2.0));
        loaded.mask = Some(Grid::filled(Size::new(3, 3), true));
        let error = FilteredView::new(7, loaded, &FuseOptions::default()).unwrap_err();
        assert_eq!(error.to_string(), "view 7: expected a mask of 4×3 pixels like the depth map, got 3×3");
    }
}
