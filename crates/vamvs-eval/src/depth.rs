//! How well depth maps agree with true ones, over regions of pixels.
//!
//! [`DepthSamples`] collects the pixels of as many maps as wanted; what they come to is asked region by
//! region. A depth map may be of another size than the ground truth: a [`PixelMap`] says which true pixel is under
//! the centre of which pixel, and ground truth is never interpolated, since that would make depths at edges that
//! no surface has.

use serde::Serialize;
use vamvs_core::{Grid, Pinhole, Planes, Size, depth_map::is_valid};

use crate::stats::Spread;

/// How near is near.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "unit", content = "error", rename_all = "kebab-case")]
pub enum Threshold {
    /// |depth − true|, scene units.
    Absolute(f64),
    /// |depth − true| / true, as a share.
    Relative(f64),
    /// The error in plane distances of the sweep.
    Planes(f64),
}

/// What one plane distance is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaneUnit {
    /// The planes of the sweep, uniform in depth or in inverse depth.
    Planes(Planes),
    /// A depth, scene units.
    Distance(f64),
}

/// A part of the pixels that have a true depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Region {
    /// All of them.
    All,
    /// Those whose surface some source view does not see.
    Invisible,
    /// Those whose surface all source views see.
    Visible,
}

/// Errors over the pixels of a region that have a true depth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DepthErrors {
    /// Pixels with a true depth.
    pub true_pixels: usize,
    /// The share of them that has a depth, 0 to 1.
    pub coverage: f64,
    /// |depth − true| over the pixels that have both, scene units.
    pub absolute: Spread,
    /// |depth − true| / true over the pixels that have both.
    pub relative: Spread,
    /// For each threshold, the share of the pixels that have both within it.
    pub within: Vec<Within>,
}

/// How many pixels are within a threshold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Within {
    /// The threshold.
    #[serde(flatten)]
    pub threshold: Threshold,
    /// The share of pixels with an error of at most that, 0 to 1; 0 if there are no pixels.
    pub share: f64,
}

/// Depth maps that cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "a depth map of {depth} pixels cannot be compared with a true one of {ground_truth}: they are not of the same shape; with cameras for both (cams/ beside depths/) any sizes can be compared"
)]
pub struct SizeMismatch {
    /// Size of the depth map.
    pub depth: Size,
    /// Size of the true one.
    pub ground_truth: Size,
}

/// Which pixel of the ground truth is at the centre of a pixel of a depth map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelMap {
    scale: [f64; 2],
    offset: [f64; 2],
}

/// A depth map and its ground truth.
#[derive(Clone, Copy, Debug)]
pub struct MapPair<'a> {
    /// The depth map; depths that are not finite and positive count as none.
    pub depth: &'a Grid<f32>,
    /// The ground truth, of the same size.
    pub ground_truth: &'a Grid<f32>,
    /// For each pixel whether all source views see its surface, of the same size; `None` if not known, and
    /// in pixels of which it is not known.
    pub visible: Option<&'a Grid<Option<bool>>>,
    /// What a plane distance is, if known.
    pub plane: Option<PlaneUnit>,
}

/// Pixels with a true depth, and their errors.
#[derive(Clone, Debug, Default)]
pub struct DepthSamples {
    samples: Vec<Sample>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    /// NaN without a depth.
    absolute: f32,
    relative: f32,
    /// NaN if not known.
    planes: f32,
    visible: Option<bool>,
}

impl PixelMap {
    /// Between images of sizes that show the same.
    ///
    /// # Errors
    /// If their shapes differ by more than the rounding of a side.
    pub fn between_sizes(depth: Size, ground_truth: Size) -> Result<Self, SizeMismatch> {
        let ratio = |depth: usize, ground_truth: usize| ground_truth as f64 / depth as f64;
        let scale = [ratio(depth.width, ground_truth.width), ratio(depth.height, ground_truth.height)];
        let height = ground_truth.height as f64 / scale[0];
        if (height - depth.height as f64).abs() > 1.0 {
            return Err(SizeMismatch { depth, ground_truth });
        }
        Ok(Self { scale, offset: [0.0; 2] })
    }

    /// Between images of two cameras that stand in the same place and look the same way.
    #[must_use]
    pub fn between_cameras(depth: &Pinhole, ground_truth: &Pinhole) -> Self {
        let (from, to) = (&depth.intrinsics, &ground_truth.intrinsics);
        let scale = [to.fx / from.fx, to.fy / from.fy];
        Self { scale, offset: [to.cx - scale[0] * from.cx, to.cy - scale[1] * from.cy] }
    }

    /// The values under the centres of the pixels of an image of `size`; the default beside the image.
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
    /// The error in plane distances.
    fn error(&self, depth: f64, ground_truth: f64) -> f64 {
        match self {
            Self::Planes(planes) => (planes.coordinate(depth) - planes.coordinate(ground_truth)).abs(),
            Self::Distance(distance) => (depth - ground_truth).abs() / distance,
        }
    }
}

impl DepthSamples {
    /// Adds the pixels of a depth map that have a true depth.
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

    /// Whether visibility is known of any pixel.
    #[must_use]
    pub fn know_visibility(&self) -> bool {
        self.samples.iter().any(|sample| sample.visible.is_some())
    }

    /// What the pixels of a region come to.
    #[must_use]
    pub fn errors(&self, region: Region, thresholds: &[Threshold]) -> DepthErrors {
        let wanted = |sample: &&Sample| match region {
            Region::All => true,
            Region::Invisible => sample.visible == Some(false),
            Region::Visible => sample.visible == Some(true),
        };
        let in_region = self.samples.iter().filter(wanted);
        let true_pixels = in_region.clone().count();
        let both: Vec<&Sample> = in_region.filter(|sample| !sample.absolute.is_nan()).collect();
        let spread =
            |value: fn(&Sample) -> f32| Spread::of(both.iter().map(|s| f64::from(value(s))).collect());
        DepthErrors {
            true_pixels,
            coverage: share(both.len(), true_pixels),
            absolute: spread(|sample| sample.absolute),
            relative: spread(|sample| sample.relative),
            within: thresholds.iter().map(|&threshold| within(&both, threshold)).collect(),
        }
    }
}

impl DepthErrors {
    /// The mean of errors of several scenes, each weighing the same; those without a true pixel are left out.
    /// Counts are added. `None` if nothing is left; thresholds must be the same.
    #[must_use]
    pub fn mean_of(scenes: &[&Self]) -> Option<Self> {
        let scenes: Vec<&Self> = scenes.iter().copied().filter(|scene| scene.true_pixels > 0).collect();
        let mean = |value: &dyn Fn(&Self) -> f64| {
            scenes.iter().map(|&scene| value(scene)).sum::<f64>() / scenes.len() as f64
        };
        let spread = |of: fn(&Self) -> &Spread| Spread {
            count: scenes.iter().map(|&scene| of(scene).count).sum(),
            mean: mean(&|scene| of(scene).mean),
            median: mean(&|scene| of(scene).median),
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

fn within(samples: &[&Sample], threshold: Threshold) -> Within {
    let (error, limit): (fn(&Sample) -> f32, f64) = match threshold {
        Threshold::Absolute(limit) => (|sample| sample.absolute, limit),
        Threshold::Relative(limit) => (|sample| sample.relative, limit),
        Threshold::Planes(limit) => (|sample| sample.planes, limit),
    };
    let near = samples.iter().filter(|sample| error(sample) <= limit as f32).count();
    Within { threshold, share: share(near, samples.len()) }
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
    }

    #[test]
    fn a_smaller_map_is_compared_with_the_truth_at_its_centres() {
        let ground_truth = Grid::from_fn(Size::new(8, 4), |x, y| (10 * y + x) as f32);
        let half = PixelMap::between_sizes(Size::new(4, 2), ground_truth.size()).unwrap();
        assert_eq!(
            half.sampled(&ground_truth, Size::new(4, 2)).data(),
            [11.0, 13.0, 15.0, 17.0, 31.0, 33.0, 35.0, 37.0]
        );
        // A map of the part from pixel (2, 1) on, at half size, as cameras tell.
        let camera = |size, f, cx, cy| Pinhole { size, intrinsics: Intrinsics { fx: f, fy: f, cx, cy } };
        let (whole, part) =
            (camera(ground_truth.size(), 10.0, 4.0, 2.0), camera(Size::new(4, 1), 5.0, 1.0, 0.5));
        let sampled = PixelMap::between_cameras(&part, &whole).sampled(&ground_truth, Size::new(4, 1));
        assert_eq!(sampled.data(), [23.0, 25.0, 27.0, 0.0], "the last pixel is beside the image");
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
