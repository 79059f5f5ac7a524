//! Combines what several views measure of a point.

use nalgebra::Vector3;
use vamvs_core::{CloudPoint, Pose, Rgb};

use crate::appearance::SeenView;
use crate::pair::Pair;
use crate::photometric::focal;
use crate::round_trip::Answers;

/// The least confidence in the weight of a depth.
const LEAST_CONFIDENCE: f32 = 0.02;

/// Weight of the colour of a pixel at an edge, which may be that of a surface beside it; 1
/// elsewhere.
const AT_EDGE: f32 = 1.0 / 64.0;

/// The largest weight of a source's depth relative to that of the reference view, for its smaller
/// footprint.
const MOST_DETAIL: f32 = 4.0;

/// Below this cosine between ray and normal, a tangent plane does not determine the depth along the
/// ray.
const LEAST_COSINE: f32 = 0.1;

/// A depth that differs from the median by this share of [`Pair::max_relative_depth`] has half the
/// weight.
const HALF_WEIGHT: f32 = 0.25;

/// A pixel of the reference view that becomes a point, with the measurements of all views that
/// agree. Positions are in the reference camera's frame.
pub(crate) struct Mean<'a> {
    reference: &'a SeenView,
    /// The pixel's ray, with z = 1.
    ray: Vector3<f32>,
    /// Size of the pixel on the surface, scene units.
    footprint: f32,
    /// The pixel's own normal.
    facing: Vector3<f32>,
    /// How well the reference view sees the point: [`Mean::clarity`].
    clarity: f32,
    /// Depths along the ray with their weights.
    depths: Vec<[f32; 2]>,
    /// The sum of normals in the world's frame.
    normal: Vector3<f32>,
    colour: [f32; 3],
    colour_weight: f32,
    confidence: f32,
}

impl<'a> Mean<'a> {
    /// The measurement of the reference view at its pixel (x, y).
    pub fn new(reference: &'a SeenView, (x, y): (usize, usize)) -> Self {
        let view = &reference.filtered;
        let k = &view.camera.intrinsics;
        let (u, v) = (x as f32 + 0.5 - k.cx as f32, y as f32 + 0.5 - k.cy as f32);
        let depth = view.inverse_depth[(x, y)].recip();
        let pixel = y * view.size().width + x;
        let normal = reference.normal.data()[pixel].unpacked();
        let mut mean = Self {
            reference,
            ray: Vector3::new(u / k.fx as f32, v / k.fy as f32, 1.0),
            footprint: depth / focal(&view.camera) as f32,
            facing: view.cam_from_world.rotation.cast::<f32>() * normal,
            clarity: 1.0,
            depths: Vec::with_capacity(8),
            normal: Vector3::zeros(),
            colour: [0.0; 3],
            colour_weight: 0.0,
            confidence: 0.0,
        };
        mean.clarity = mean.clarity(&mean.ray, mean.footprint);
        mean.add_depth(depth, view.confidence.data()[pixel], 1.0);
        mean.add_look(reference, pixel, 1.0);
        mean
    }

    /// Adds the answer of a source view in a lane in which it agrees.
    pub fn add(&mut self, pair: &Pair<'_>, source: &SeenView, answers: &Answers, lane: usize) {
        let (inverse_depth, pixel) = (answers.inverse_depth[lane], answers.pixel[lane] as usize);
        let position = self.in_reference(answers, lane);
        let footprint = pair.radians_per_pixel / inverse_depth;
        let detail = (self.footprint / footprint).powi(2).min(MOST_DETAIL);
        self.add_depth(self.along_ray(&position), source.filtered.confidence.data()[pixel], detail);
        let from_camera = position - pair.reference_from_source.translation.cast::<f32>();
        let ratio = self.clarity(&from_camera, footprint) / self.clarity;
        self.add_look(source, pixel, ratio.min(1e3).powi(4));
    }

    /// The point in the world; `max_relative_depth` is the largest relative difference of depths
    /// that agree.
    pub fn point(mut self, world_from_cam: &Pose, max_relative_depth: f32) -> CloudPoint {
        let views = self.depths.len();
        let depth = robust_mean(&mut self.depths, HALF_WEIGHT * max_relative_depth);
        let colour: Rgb = self.colour.map(|sum| (sum / self.colour_weight + 0.5) as u8);
        CloudPoint {
            x_in_world: world_from_cam.transform(&(self.ray * depth).cast()).into(),
            normal: self.normal.cast::<f64>().normalize().cast::<f32>().into(),
            colour,
            confidence: self.confidence / views as f32,
            views: views.min(255) as u8,
        }
    }

    fn add_depth(&mut self, depth: f32, confidence: f32, detail: f32) {
        self.depths.push([depth, confidence.max(LEAST_CONFIDENCE) * detail]);
        self.confidence += confidence;
    }

    /// Adds normal and colour of a pixel of a view.
    fn add_look(&mut self, view: &SeenView, pixel: usize, weight: f32) {
        let normal = view.normal.data()[pixel].unpacked();
        // The back of a thin sheet must not cancel its front.
        if self.normal.dot(&normal) >= 0.0 {
            self.normal += normal;
        }
        let weight = weight * if view.inner.at(pixel, view.filtered.size().width) { 1.0 } else { AT_EDGE };
        for (sum, channel) in self.colour.iter_mut().zip(view.colour.data()[pixel]) {
            *sum += weight * f32::from(channel);
        }
        self.colour_weight += weight;
    }

    /// The source's surface point in the reference camera's frame.
    fn in_reference(&self, answers: &Answers, lane: usize) -> Vector3<f32> {
        let k = &self.reference.filtered.camera.intrinsics;
        let [x, y, z] = [0, 1, 2].map(|i| answers.back[i][lane]);
        let depth = z / answers.inverse_depth[lane];
        let (u, v) = (x / z - k.cx as f32, y / z - k.cy as f32);
        Vector3::new(u / k.fx as f32 * depth, v / k.fy as f32 * depth, depth)
    }

    /// The depth at which the pixel's ray meets the plane through `position` with the pixel's own normal.
    fn along_ray(&self, position: &Vector3<f32>) -> f32 {
        let slant = self.facing.dot(&self.ray);
        if slant.abs() < LEAST_COSINE * self.ray.norm() {
            return position.z;
        }
        self.facing.dot(position) / slant
    }

    /// Pixels per length on the surface for a camera that sees it along `direction` with pixels of size `footprint`.
    fn clarity(&self, direction: &Vector3<f32>, footprint: f32) -> f32 {
        let cosine = self.facing.dot(direction).abs() / direction.norm();
        cosine.max(LEAST_COSINE) / footprint
    }
}

/// The robust mean of weighted values: a value whose distance to the weighted median is the share
/// `half_weight` of it has half its weight (Cauchy).
fn robust_mean(values: &mut [[f32; 2]], half_weight: f32) -> f32 {
    values.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let median = weighted_median(values);
    let weight = |&[value, weight]: &[f32; 2]| {
        let off = (value - median) / (half_weight * median);
        weight / (1.0 + off * off)
    };
    let (sum, weights) = values.iter().fold((0.0, 0.0), |(sum, weights), value| {
        let weight = weight(value);
        (sum + weight * (value[0] - median), weights + weight)
    });
    median + sum / weights
}

/// The weighted median of ascending `values`; the mean of two values if it lies between them.
fn weighted_median(values: &[[f32; 2]]) -> f32 {
    let half = 0.5 * values.iter().map(|[_, weight]| weight).sum::<f32>();
    let mut before = 0.0;
    for (at, &[value, weight]) in values.iter().enumerate() {
        before += weight;
        if before == half && at + 1 < values.len() {
            return 0.5 * (value + values[at + 1][0]);
        }
        if before >= half {
            return value;
        }
    }
    values.last().map_or(0.0, |[value, _]| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outlier_moves_the_mean_little_and_symmetric_values_not_at_all() {
        let mean = |values: &[[f32; 2]]| robust_mean(&mut values.to_vec(), 0.0025);
        assert_eq!(mean(&[[2.0, 0.3]]), 2.0);
        assert!((mean(&[[2.002, 1.0], [1.998, 1.0]]) - 2.0).abs() < 1e-6);
        assert!((mean(&[[2.0, 1.0], [2.001, 3.0]]) - 2.000_75).abs() < 2e-5, "close values: their mean");
        let plain = 2.0 + 0.02 / 4.0;
        let robust = mean(&[[2.0, 1.0], [2.0, 1.0], [2.0, 1.0], [2.02, 1.0]]);
        assert!(robust - 2.0 < 0.1 * (plain - 2.0), "{robust}");
    }

    #[test]
    fn the_weighted_median_has_half_the_weight_on_each_side() {
        assert_eq!(weighted_median(&[[1.0, 1.0], [2.0, 1.0], [9.0, 1.0]]), 2.0);
        assert_eq!(weighted_median(&[[1.0, 1.0], [2.0, 1.0], [9.0, 5.0]]), 9.0);
        assert_eq!(weighted_median(&[[1.0, 1.0], [2.0, 1.0]]), 1.5);
    }
}
