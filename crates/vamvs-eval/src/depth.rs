//! Errors of depth maps against ground truth, over regions of pixels.
//!
//! [`DepthSamples`] collects the pixels of any number of maps; [`DepthSamples::errors`] summarises a region of
//! them. A depth map may differ in size from the ground truth: a [`PixelMap`] tells which pixel of the
//! ground truth lies under the centre of a pixel of the depth map. Ground truth is never interpolated, because
//! that would create depths between the two surfaces at an edge.

use serde::Serialize;
use vamvs_core::{Grid, Pinhole, Planes, Size, depth_map::is_valid};

use crate::stats::Spread;

/// A limit of the error of a depth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "unit", content = "error", rename_all = "kebab-case")]
pub enum Threshold {
    /// Limit of |depth − true depth|, scene units.
    Absolute(f64),
    /// Limit of |depth − true depth| / true depth, as a share.
    Relative(f64),
    /// Limit of the error in plane distances of the sweep.
    Planes(f64),
}

/// The unit of errors in plane distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaneUnit {
    /// The planes of the sweep, uniform in depth or in inverse depth.
    Planes(Planes),
    /// A fixed difference of depth, scene units.
    Distance(f64),
}

/// A subset of the pixels with ground truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Region {
    /// All pixels with ground truth.
    All,
    /// Those whose surface at least one source view does not see.
    Invisible,
    /// Those whose surface all source views see.
    Visible,
}

/// Errors over the pixels of a region that have ground truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DepthErrors {
    /// Number of pixels with ground truth.
    pub true_pixels: usize,
    /// The share of them that have an estimated depth, 0 to 1.
    pub coverage: f64,
    /// |depth − true depth| over the pixels that have both, scene units.
    pub absolute: Spread,
    /// |depth − true depth| / true depth over the pixels that have both.
    pub relative: Spread,
    /// For each threshold, the share of the pixels with both depths whose error is at most the threshold.
    pub within: Vec<Within>,
}

/// The share of pixels within a threshold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Within {
    /// The threshold.
    #[serde(flatten)]
    pub threshold: Threshold,
    /// The share of pixels with an error of at most the threshold, 0 to 1; 0 if there are no pixels.
    pub share: f64,
}

/// Two depth maps whose sizes do not allow a comparison.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "a depth map of {depth} pixels cannot be compared with a ground-truth map of {ground_truth} pixels: the aspect ratios differ; with cameras for both (cams/ beside depths/) maps of any sizes can be compared"
)]
pub struct SizeMismatch {
    /// Size of the depth map.
    pub depth: Size,
    /// Size of the ground-truth map.
    pub ground_truth: Size,
}

/// Maps the centre of a pixel of a depth map to the pixel of the ground truth under it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelMap {
    scale: [f64; 2],
    offset: [f64; 2],
}

/// A depth map with its ground truth, for [`DepthSamples::add`].
#[derive(Clone, Copy, Debug)]
pub struct MapPair<'a> {
    /// The depth map; values that are not finite and positive count as no depth.
    pub depth: &'a Grid<f32>,
    /// The ground truth, of the same size.
    pub ground_truth: &'a Grid<f32>,
    /// For each pixel, whether all source views see its surface, a grid of the same size; `None` for the grid, or
    /// for a pixel, if that is not known.
    pub visible: Option<&'a Grid<Option<bool>>>,
    /// The unit of [`Threshold::Planes`]; `None` if not known.
    pub plane: Option<PlaneUnit>,
}

/// The errors of pixels with ground truth, one by one.
#[derive(Clone, Debug, Default)]
pub struct DepthSamples {
    samples: Vec<Sample>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    /// In scene units. This and `relative` are NaN without an estimated depth.
    absolute: f32,
    relative: f32,
    /// In plane distances; NaN without an estimated depth or a plane unit.
    planes: f32,
    visible: Option<bool>,
}

impl PixelMap {
    /// The map between two images of different sizes that show the same field of view.
    ///
    /// # Errors
    /// If the aspect ratios differ by more than one pixel of the depth map's height.
    pub fn between_sizes(depth: Size, ground_truth: Size) -> Result<Self, SizeMismatch> {
        let ratio = |depth: usize, ground_truth: usize| ground_truth as f64 / depth as f64;
        let scale = [ratio(depth.width, ground_truth.width), ratio(depth.height, ground_truth.height)];
        let height = ground_truth.height as f64 / scale[0];
        if (height - depth.height as f64).abs() > 1.0 {
            return Err(SizeMismatch { depth, ground_truth });
        }
        Ok(Self { scale, offset: [0.0; 2] })
    }

    /// The map between images of two cameras that have the same pose.
    #[must_use]
    pub fn between_cameras(depth: &Pinhole, ground_truth: &Pinhole) -> Self {
        let (from, to) = (&depth.intrinsics, &ground_truth.intrinsics);
        let scale = [to.fx / from.fx, to.fy / from.fy];
        Self { scale, offset: [to.cx - scale[0] * from.cx, to.cy - scale[1] * from.cy] }
    }

    /// The values of `image` under the pixel centres of an image of `size`; the type's default outside of `image`.
    #[must_use]
    pub fn sampled<T: Clone + Default>(&self, image: &Grid<T>, size: Size) -> Grid<T> {
        let place =
            |at: usize, axis: usize| (self.scale[axis] * (at as f64 + 0.5) + self.offset[axis]).floor();
        Grid::from_fn(size, |x, y| {
            let (x, y) = (place(x, 0), place(y, 1));
            let inside = x >= 0.0 && y >= 0.0;
            inside.then(|| image.get(x as usize, y as usize).cloned()).flatten().unwrap_or_default()
        })
    }
}

impl PlaneUnit {
    /// The error of a depth, in plane distances.
    fn error(&self, depth: f64, ground_truth: f64) -> f64 {
        match self {
            Self::Planes(planes) => (planes.coordinate(depth) - planes.coordinate(ground_truth)).abs(),
            Self::Distance(distance) => (depth - ground_truth).abs() / distance,
        }
    }
}

impl DepthSamples {
    /// Adds the pixels of a depth map that have ground truth.
    ///
    /// # Errors
    /// If the sizes differ.
    pub fn add(&mut self, pair: &MapPair) -> Result<(), SizeMismatch> {
        let size = pair.depth.size();
        let sizes = [Some(pair.ground_truth.size()), pair.visible.map(Grid::size)];
        if let Some(other) = sizes.into_iter().flatten().find(|other| *other != size) {
            return Err(SizeMismatch { depth: size, ground_truth: other });
        }
        let pixels = pair.depth.data().iter().zip(pair.ground_truth.data()).enumerate();
        self.samples.extend(pixels.filter(|(_, (_, ground_truth))| is_valid(**ground_truth)).map(
            |(index, (&depth, &ground_truth))| Sample {
                visible: pair.visible.and_then(|visible| visible.data()[index]),
                ..Sample::of(depth, ground_truth, pair.plane)
            },
        ));
        Ok(())
    }

    /// Adds the pixels of other samples.
    pub fn append(&mut self, other: &Self) {
        self.samples.extend_from_slice(&other.samples);
    }

    /// Whether visibility is known for any pixel.
    #[must_use]
    pub fn know_visibility(&self) -> bool {
        self.samples.iter().any(|sample| sample.visible.is_some())
    }

    /// The errors over the pixels of a region.
    #[must_use]
    pub fn errors(&self, region: Region, thresholds: &[Threshold]) -> DepthErrors {
        let wanted = |sample: &&Sample| match region {
            Region::All => true,
            Region::Invisible => sample.visible == Some(false),
            Region::Visible => sample.visible == Some(true),
        };
        let in_region = self.samples.iter().filter(wanted);
        let true_pixels = in_region.clone().count();
        let both = in_region.filter(|sample| !sample.absolute.is_nan());
        let spread = |value: fn(&Sample) -> f32| Spread::of_singles(both.clone().map(value).collect());
        DepthErrors {
            true_pixels,
            coverage: share(both.clone().count(), true_pixels),
            absolute: spread(|sample| sample.absolute),
            relative: spread(|sample| sample.relative),
            within: thresholds.iter().map(|&threshold| within(both.clone(), threshold)).collect(),
        }
    }
}

impl DepthErrors {
    /// The mean of the errors of several scenes, with equal weights; scenes without ground truth are left out.
    /// Counts are added. `None` if no scene is left. All must have the same thresholds.
    #[must_use]
    pub fn mean_of(scenes: &[&Self]) -> Option<Self> {
        let scenes: Vec<&Self> = scenes.iter().copied().filter(|scene| scene.true_pixels > 0).collect();
        let mean_over = |scenes: &[&Self], value: &dyn Fn(&Self) -> f64| {
            scenes.iter().map(|&scene| value(scene)).sum::<f64>() / scenes.len() as f64
        };
        let mean = |value: &dyn Fn(&Self) -> f64| mean_over(&scenes, value);
        // A scene without estimated depth has no error, but no coverage and no inliers either.
        let estimated: Vec<&Self> = scenes.iter().copied().filter(|scene| scene.absolute.count > 0).collect();
        let spread = |of: fn(&Self) -> &Spread| Spread {
            count: scenes.iter().map(|&scene| of(scene).count).sum(),
            mean: mean_over(&estimated, &|scene| of(scene).mean),
            median: mean_over(&estimated, &|scene| of(scene).median),
        };
        let within = |(index, within): (usize, &Within)| Within {
            share: mean(&|scene| scene.within[index].share),
            ..*within
        };
        Some(Self {
            true_pixels: scenes.iter().map(|scene| scene.true_pixels).sum(),
            coverage: mean(&|scene| scene.coverage),
            absolute: spread(|scene| &scene.absolute),
            relative: spread(|scene| &scene.relative),
            within: scenes.first()?.within.iter().enumerate().map(within).collect(),
        })
    }
}

impl Sample {
    fn of(depth: f32, ground_truth: f32, plane: Option<PlaneUnit>) -> Self {
        let (d, t) = (f64::from(depth), f64::from(ground_truth));
        let (absolute, planes) = match is_valid(depth) {
            true => ((d - t).abs(), plane.map_or(f64::NAN, |plane| plane.error(d, t))),
            false => (f64::NAN, f64::NAN),
        };
        Self {
            absolute: absolute as f32,
            relative: (absolute / t) as f32,
            planes: planes as f32,
            visible: None,
        }
    }
}

fn within<'a>(samples: impl Iterator<Item = &'a Sample> + Clone, threshold: Threshold) -> Within {
    let (error, limit): (fn(&Sample) -> f32, f64) = match threshold {
        Threshold::Absolute(limit) => (|sample| sample.absolute, limit),
        Threshold::Relative(limit) => (|sample| sample.relative, limit),
        Threshold::Planes(limit) => (|sample| sample.planes, limit),
    };
    let near = samples.clone().filter(|sample| error(sample) <= limit as f32).count();
    Within { threshold, share: share(near, samples.count()) }
}

fn share(part: usize, of: usize) -> f64 {
    if of == 0 { 0.0 } else { part as f64 / of as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{DepthRange, Intrinsics, Spacing};

    fn grid<T: Clone>(values: &[T]) -> Grid<T> {
        Grid::from_vec(Size::new(values.len(), 1), values.to_vec())
    }

    fn errors(depth: &[f32], ground_truth: &[f32], thresholds: &[Threshold]) -> DepthErrors {
        let mut samples = DepthSamples::default();
        let plane = Some(PlaneUnit::Distance(0.25));
        samples
            .add(&MapPair { depth: &grid(depth), ground_truth: &grid(ground_truth), visible: None, plane })
            .unwrap();
        samples.errors(Region::All, thresholds)
    }

    #[test]
    fn shares_count_pixels_with_both_depths_and_coverage_those_with_truth() {
        use Threshold::{Absolute, Planes, Relative};
        let ground_truth = [2.0, 2.0, 2.0, 2.0, 2.0, 0.0, f32::NAN, 2.0];
        let depth = [2.0, 2.25, 1.5, 4.0, 0.0, 9.0, 9.0, f32::INFINITY];
        let limits = [Relative(0.0), Relative(0.125), Relative(0.2), Absolute(0.5), Planes(0.9), Planes(2.0)];
        let errors = errors(&depth, &ground_truth, &limits);
        assert_eq!((errors.true_pixels, errors.coverage), (6, 4.0 / 6.0));
        assert_eq!(errors.relative, Spread { count: 4, mean: 1.375 / 4.0, median: 0.1875 });
        assert_eq!(errors.absolute, Spread { count: 4, mean: 2.75 / 4.0, median: 0.375 });
        let shares: Vec<f64> = errors.within.iter().map(|w| w.share).collect();
        assert_eq!(shares, [0.25, 0.5, 0.5, 0.75, 0.25, 0.75]);
    }

    #[test]
    fn nothing_in_common_has_no_median() {
        let errors = errors(&[0.0, 1.0], &[1.0, 0.0], &[Threshold::Relative(0.1)]);
        assert_eq!((errors.coverage, errors.within[0].share), (0.0, 0.0));
        assert!(errors.relative.median.is_nan() && errors.absolute.mean.is_nan());
    }

    #[test]
    fn planes_uniform_in_inverse_depth_are_counted_as_such() {
        let range = DepthRange { near: 1.0, far: 4.0 };
        let planes = Planes { range, count: 4, spacing: Spacing::InverseDepth };
        // Planes at 1, 4/3, 2, 4.
        let error = PlaneUnit::Planes(planes).error(4.0, 4.0 / 3.0);
        assert!((error - 2.0).abs() < 1e-12, "{error}");
    }

    #[test]
    fn regions_split_the_pixels_whose_visibility_is_known() {
        let mut samples = DepthSamples::default();
        let (depth, ground_truth) = (grid(&[1.0, 2.0, 3.0, 0.0, 5.0]), grid(&[1.0, 1.0, 1.0, 1.0, 1.0]));
        let visible = grid(&[Some(true), Some(false), None, Some(true), Some(false)]);
        assert!(!samples.know_visibility());
        samples
            .add(&MapPair {
                depth: &depth,
                ground_truth: &ground_truth,
                visible: Some(&visible),
                plane: None,
            })
            .unwrap();
        assert!(samples.know_visibility());
        let of = |region| samples.errors(region, &[Threshold::Absolute(0.5), Threshold::Planes(1e9)]);
        let [all, invisible, visible] = [Region::All, Region::Invisible, Region::Visible].map(of);
        assert_eq!([all.true_pixels, invisible.true_pixels, visible.true_pixels], [5, 2, 2]);
        assert_eq!((visible.coverage, visible.within[0].share), (0.5, 1.0));
        assert_eq!((invisible.coverage, invisible.absolute.mean), (1.0, 2.5));
        assert_eq!(all.within[1].share, 0.0, "without planes nothing is within them");
    }

    #[test]
    fn several_maps_are_one_population() {
        let mut samples = DepthSamples::default();
        for value in [1.0, 2.0] {
            let (depth, ground_truth) = (grid(&[value; 3]), grid(&[1.0; 3]));
            samples
                .add(&MapPair { depth: &depth, ground_truth: &ground_truth, visible: None, plane: None })
                .unwrap();
        }
        let mut twice = samples.clone();
        twice.append(&samples);
        for (samples, count) in [(samples, 6), (twice, 12)] {
            let spread = samples.errors(Region::All, &[]).absolute;
            assert_eq!(spread, Spread { count, mean: 0.5, median: 0.5 });
        }
    }

    #[test]
    fn scenes_weigh_the_same_in_their_mean_and_empty_ones_nothing() {
        let limit = [Threshold::Absolute(0.5)];
        let (one, three) = (errors(&[2.0], &[1.0], &limit), errors(&[1.0; 3], &[1.0; 3], &limit));
        let mean = DepthErrors::mean_of(&[&one, &three, &errors(&[1.0], &[0.0], &limit)]).unwrap();
        assert_eq!((mean.true_pixels, mean.coverage, mean.within[0].share), (4, 1.0, 0.5));
        assert_eq!(mean.absolute, Spread { count: 4, mean: 0.5, median: 0.5 });
        assert_eq!(DepthErrors::mean_of(&[]), None);
        let without_depth = errors(&[0.0], &[1.0], &limit);
        let mean = DepthErrors::mean_of(&[&one, &without_depth]).unwrap();
        assert_eq!((mean.coverage, mean.within[0].share), (0.5, 0.0));
        assert_eq!(mean.absolute, Spread { count: 1, mean: 1.0, median: 1.0 });
    }

    #[test]
    fn a_smaller_map_is_compared_with_the_truth_at_its_centres() {
        let ground_truth = Grid::from_fn(Size::new(8, 4), |x, y| (10 * y + x) as f32);
        let half = PixelMap::between_sizes(Size::new(4, 2), ground_truth.size()).unwrap();
        assert_eq!(
            half.sampled(&ground_truth, Size::new(4, 2)).data(),
            [11.0, 13.0, 15.0, 17.0, 31.0, 33.0, 35.0, 37.0]
        );
        // A map of half the resolution of the part that begins at pixel (2, 1), given by its camera.
        let camera = |size, f, cx, cy| Pinhole { size, intrinsics: Intrinsics { fx: f, fy: f, cx, cy } };
        let (whole, part) =
            (camera(ground_truth.size(), 10.0, 4.0, 2.0), camera(Size::new(4, 1), 5.0, 1.0, 0.5));
        let sampled = PixelMap::between_cameras(&part, &whole).sampled(&ground_truth, Size::new(4, 1));
        assert_eq!(sampled.data(), [23.0, 25.0, 27.0, 0.0], "the last pixel is outside of the image");
    }

    #[test]
    fn shapes_must_agree_but_for_rounding() {
        let fits = |depth, ground_truth| PixelMap::between_sizes(depth, ground_truth).is_ok();
        assert!(fits(Size::new(426, 320), Size::new(853, 640)));
        assert!(fits(Size::new(640, 480), Size::new(320, 240)));
        let error = PixelMap::between_sizes(Size::new(320, 200), Size::new(640, 480)).unwrap_err();
        assert!(error.to_string().contains("320×200") && error.to_string().contains("640×480"));
        let mut samples = DepthSamples::default();
        let (depth, ground_truth) = (grid(&[1.0]), grid(&[1.0, 1.0]));
        assert!(
            samples
                .add(&MapPair { depth: &depth, ground_truth: &ground_truth, visible: None, plane: None })
                .is_err()
        );
    }
}
