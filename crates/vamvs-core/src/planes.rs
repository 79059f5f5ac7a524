//! The fronto-parallel planes of a plane sweep, and the coordinate along them.
//!
//! A surface's position along a viewing ray is measured in *planes*: coordinate u = 0 is the nearest
//! plane, `count − 1` the farthest, and one unit is one plane distance (the paper's d). Hypotheses, flow
//! and losses are in this coordinate, so that they mean the same for every scene scale and for both
//! spacings.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::homography::PixelTransfer;
use crate::{DepthRange, Pinhole, Pose};

/// Fewest planes that [`Planes::for_views`] gives, unless `most` is smaller.
const FEWEST: usize = 32;

/// Ratio of far to near above which planes are uniform in inverse depth; equal steps of depth would be
/// too fine far away.
const WIDE_RATIO: f64 = 3.0;

/// Fewer known surfaces than this tell nothing of the others.
const FEWEST_SURFACES: usize = 10;

/// Depths of a grid of surfaces, spread as the planes are.
const GRID_DEPTHS: usize = 4;

/// Half the step between planes that tells how far they move in a source view, as a share of all.
const SMALL_STEP: f64 = 1e-3;

/// How the planes of a sweep are spaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Spacing {
    /// Equal steps of depth.
    Depth,
    /// Equal steps of inverse depth: equal steps of disparity, for wide ranges.
    InverseDepth,
}

/// The planes of a plane sweep.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Planes {
    /// Depths of the first and the last plane.
    pub range: DepthRange,
    /// Number of planes, at least 2.
    pub count: usize,
    /// How they are spaced.
    pub spacing: Spacing,
}

impl Planes {
    /// Depth at plane coordinate `u`, which may lie a little outside of `[0, count − 1]`.
    #[must_use]
    pub fn depth(&self, u: f64) -> f64 {
        let t = u / (self.count - 1) as f64;
        let DepthRange { near, far } = self.range;
        match self.spacing {
            Spacing::Depth => near + t * (far - near),
            Spacing::InverseDepth => 1.0 / (1.0 / near + t * (1.0 / far - 1.0 / near)),
        }
    }

    /// Plane coordinate of a depth: the inverse of [`Planes::depth`].
    #[must_use]
    pub fn coordinate(&self, depth: f64) -> f64 {
        let DepthRange { near, far } = self.range;
        let t = match self.spacing {
            Spacing::Depth => (depth - near) / (far - near),
            Spacing::InverseDepth => (1.0 / depth - 1.0 / near) / (1.0 / far - 1.0 / near),
        };
        t * (self.count - 1) as f64
    }

    /// Planes for a depth range, given the reference and source cameras. Neighbouring planes are about
    /// `step` pixels apart in the source images, where these show surfaces (the median over sources and surfaces): if a camera moves
    /// ahead, planes of one distance are much farther apart in front of surfaces that are far than of near ones.
    /// `surfaces` are points in the reference camera's frame that it sees; where none are known, surfaces may be anywhere.
    ///
    /// The number of planes is
    /// rounded up to a multiple of 8 and clamped to between 32 and `most`, which counts as 2 at least. Spacing is uniform in inverse
    /// depth if the range is wide, far > 3 · near.
    #[must_use]
    pub fn for_views(
        range: DepthRange,
        reference: (&Pinhole, &Pose),
        sources: &[(&Pinhole, &Pose)],
        surfaces: &[Vector3<f64>],
        (step, most): (f64, usize),
    ) -> Self {
        let wide = range.far > WIDE_RATIO * range.near;
        let ends =
            Self { range, count: 2, spacing: if wide { Spacing::InverseDepth } else { Spacing::Depth } };
        let seen = ends.seen(reference.0, surfaces);
        let span = median(sources.iter().filter_map(|source| ends.image_span(reference, *source, &seen)));
        let count = (span.unwrap_or(0.0) / step).ceil().min(most as f64) as usize + 1;
        let most = most.max(2);
        Self { count: count.next_multiple_of(8).clamp(FEWEST.min(most), most), ..ends }
    }

    /// The pixels and depths of the surfaces that lie between the planes, or if there are few, of a grid.
    fn seen(&self, camera: &Pinhole, surfaces: &[Vector3<f64>]) -> Vec<(Vector2<f64>, f64)> {
        let DepthRange { near, far } = self.range;
        let inside = surfaces.iter().filter(|x_in_cam| (near..=far).contains(&x_in_cam.z));
        let seen: Vec<_> =
            inside.filter_map(|x_in_cam| Some((camera.project_inside(x_in_cam)?, x_in_cam.z))).collect();
        if seen.len() >= FEWEST_SURFACES {
            return seen;
        }
        let share = |i: usize, count: usize| (i as f64 + 0.5) / count as f64;
        let (width, height) = (camera.size.width as f64, camera.size.height as f64);
        let last = (self.count - 1) as f64;
        let at = |i: usize| {
            let pixel = Vector2::new(width * share(i % 3, 3), height * share(i / 3 % 3, 3));
            (pixel, self.depth(last * share(i / 9, GRID_DEPTHS)))
        };
        (0..9 * GRID_DEPTHS).map(at).collect()
    }

    /// How many pixels the range would span in the source view if all of it were moved past there as it is around these pixels and
    /// depths of the reference view (the median); `None` if the source shows none of them.
    fn image_span(
        &self,
        reference: (&Pinhole, &Pose),
        source: (&Pinhole, &Pose),
        seen: &[(Vector2<f64>, f64)],
    ) -> Option<f64> {
        let source_from_reference = source.1.compose(&reference.1.inverse());
        let transfer = PixelTransfer::new(reference.0, source.0, &source_from_reference);
        let step = SMALL_STEP * (self.count - 1) as f64;
        let span = |&(pixel, depth): &(Vector2<f64>, f64)| {
            let (here, _) = transfer.project(&pixel, depth)?;
            let u = self.coordinate(depth);
            let (nearer, _) = transfer.project(&pixel, self.depth(u - step))?;
            let (farther, _) = transfer.project(&pixel, self.depth(u + step))?;
            source.0.contains(&here).then(|| (nearer - farther).norm() / (2.0 * SMALL_STEP))
        };
        median(seen.iter().filter_map(span))
    }

    /// Planes of the same range, as many pixels apart in photographs that are smaller by `factor` (at most 1).
    #[must_use]
    pub fn for_smaller(&self, factor: f64) -> Self {
        let count = (factor * self.count as f64).ceil() as usize;
        Self { count: count.next_multiple_of(8).max(FEWEST).min(self.count), ..*self }
    }

    /// Planes of another range, at the same distances, but not more than `most`.
    #[must_use]
    pub fn for_range(&self, range: DepthRange, most: usize) -> Self {
        let length = |range: DepthRange| match self.spacing {
            Spacing::Depth => range.far - range.near,
            Spacing::InverseDepth => 1.0 / range.near - 1.0 / range.far,
        };
        let count = (self.count - 1) as f64 * length(range) / length(self.range);
        let count = (count.ceil() as usize + 1).next_multiple_of(8).min(most.max(self.count));
        Self { range, count, ..*self }
    }

    /// The depths of all planes, nearest first.
    #[must_use]
    pub fn depths(&self) -> Vec<f64> {
        (0..self.count).map(|i| self.depth(i as f64)).collect()
    }
}

/// The upper median.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Intrinsics, Size};

    #[test]
    fn neighbouring_planes_are_a_step_apart_in_the_source() {
        let camera = Pinhole {
            size: Size::new(800, 600),
            intrinsics: Intrinsics { fx: 1000.0, fy: 1000.0, cx: 400.0, cy: 300.0 },
        };
        let (here, aside) =
            (Pose::identity(), Pose { translation: Vector3::new(-1.0, 0.0, 0.0), ..Pose::identity() });
        let range = DepthRange { near: 2.0, far: 10.0 };
        // A rectified pair: disparity 1000 · 1 · (1/2 − 1/10) = 400 pixels.
        let planes = |source, step, most| {
            Planes::for_views(range, (&camera, &here), &[(&camera, source)], &[], (step, most))
        };
        let four = planes(&aside, 4.0, 256);
        assert_eq!((four.count, four.spacing), (104, Spacing::InverseDepth));
        assert_eq!(planes(&aside, 2.0, 256).count, 208);
        assert_eq!(planes(&aside, 4.0, 64).count, 64);
        assert_eq!(planes(&here, 4.0, 64).count, FEWEST);
    }

    /// A source 4 m behind: a plane's distance is x f t / (z + t)² of inverse depth, most where surfaces are far.
    #[test]
    fn planes_are_as_close_as_the_surfaces_that_are_seen_need_them() {
        let camera = Pinhole {
            size: Size::new(800, 600),
            intrinsics: Intrinsics { fx: 500.0, fy: 500.0, cx: 400.0, cy: 300.0 },
        };
        let behind = Pose { translation: Vector3::new(0.0, 0.0, 4.0), ..Pose::identity() };
        let range = DepthRange { near: 2.0, far: 100.0 };
        let count = |depth: f64| {
            let surfaces = vec![Vector3::new(0.5 * depth, 0.0, depth); 20];
            let sources = [(&camera, &behind)];
            Planes::for_views(range, (&camera, &Pose::identity()), &sources, &surfaces, (4.0, 512)).count
        };
        for depth in [6.0_f64, 10.0, 40.0] {
            let moves = 250.0 * 4.0 / (1.0 + 4.0 / depth).powi(2) * (1.0 / 2.0 - 1.0 / 100.0);
            assert_eq!(count(depth), ((moves / 4.0).ceil() as usize + 1).next_multiple_of(8), "{depth}");
        }
    }

    #[test]
    fn smaller_photographs_need_fewer_planes() {
        let range = DepthRange { near: 2.0, far: 10.0 };
        let count = |count: usize, factor: f64| {
            let planes = Planes { range, count, spacing: Spacing::Depth }.for_smaller(factor);
            assert_eq!((planes.range, planes.spacing), (range, Spacing::Depth));
            planes.count
        };
        assert_eq!([count(96, 0.5), count(96, 0.7), count(40, 0.5), count(20, 0.5)], [48, 72, FEWEST, 20]);
        assert_eq!(count(96, 1.0), 96);
    }

    #[test]
    fn both_spacings_begin_near_end_far_and_invert() {
        for spacing in [Spacing::Depth, Spacing::InverseDepth] {
            let planes = Planes { range: DepthRange { near: 2.0, far: 10.0 }, count: 17, spacing };
            let depths = planes.depths();
            assert!((depths[0] - 2.0).abs() < 1e-12 && (depths[16] - 10.0).abs() < 1e-12);
            assert!(depths.windows(2).all(|pair| pair[0] < pair[1]));
            for u in [-0.5, 0.0, 3.25, 16.0] {
                assert!((planes.coordinate(planes.depth(u)) - u).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn the_middle_is_the_arithmetic_or_the_harmonic_mean() {
        let range = DepthRange { near: 2.0, far: 6.0 };
        assert!((Planes { range, count: 3, spacing: Spacing::Depth }.depth(1.0) - 4.0).abs() < 1e-12);
        assert!((Planes { range, count: 3, spacing: Spacing::InverseDepth }.depth(1.0) - 3.0).abs() < 1e-12);
    }
}
