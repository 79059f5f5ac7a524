//! Combines what several views measure of the points of a strip.

#![allow(
    clippy::needless_range_loop,
    reason = "one lane of many arrays at a time, as the compiler turns into vectors"
)]

use nalgebra::{Matrix3, Vector3};
use vamvs_core::{CloudPoint, Pose, Rgb};

use crate::appearance::{Look, Paint, SeenView};
use crate::lanes::{LANES, Lanes, first_lanes, fmax, fmin, set_bits};
use crate::packed_normal::PackedNormal;
use crate::pair::Pair;
use crate::photometric::focal;
use crate::points::USUAL_VIEWS;
use crate::round_trip::{Answers, PREFETCH_ROWS, prefetch};
use vamvs_core::widened;

/// The least confidence in the weight of a depth.
const LEAST_CONFIDENCE: f32 = 0.02;

/// Weight of the colour of a pixel at an edge, which may be that of a surface beside it; 1
/// elsewhere.
const AT_EDGE: f32 = 1.0 / 64.0;

/// The largest weight of a source's depth relative to that of the reference view, for its smaller
/// footprint.
const MOST_DETAIL: f32 = 4.0;

/// The largest weight of a depth by its standard deviation: that of a hundredth of a pixel.
const MOST_WEIGHT: f32 = 1e4;

/// Below this cosine between ray and normal, a tangent plane does not determine the depth along the
/// ray.
const LEAST_COSINE: f32 = 0.1;

/// A depth that differs from the median by this share of [`Pair::max_relative_depth`] has half the
/// weight.
const HALF_WEIGHT: f32 = 0.25;

/// The reference view, with what the points of its pixels have in common.
pub(crate) struct Viewpoint<'a> {
    seen: &'a SeenView,
    world_from_cam: Pose,
    /// The rotation of `cam_from_world`.
    rotation: Matrix3<f32>,
    /// Principal point, pixels.
    centre: [f32; 2],
    /// 1 over the focal lengths, per pixel.
    per_focal: [f32; 2],
    /// 1 over the geometric mean of the focal lengths, per pixel.
    radians_per_pixel: f32,
}

/// Pixels of the reference view that become points, one a lane, with the measurements of all views that agree.
/// Positions are in the reference camera's frame.
pub(crate) struct Means<'a> {
    reference: &'a Viewpoint<'a>,
    /// x and y of the pixels' rays, with z = 1.
    ray: [Lanes; 2],
    /// Size of the pixels on the surface, scene units.
    footprint: Lanes,
    /// The pixels' own normals.
    facing: [Lanes; 3],
    /// 1 over the scalar product of ray and normal; 0 if they are nearly perpendicular.
    per_slant: Lanes,
    /// 1 over how well the reference view sees the points, length on the surface per pixel.
    per_clarity: Lanes,
    /// Lengths of the rays to depth 1.
    length: Lanes,
    /// Whether the standard deviations of the pixels' own depths are known.
    has_sigma: Lanes<bool>,
    sums: Sums,
    /// What the views that agree measure, for each lane.
    measured: [Vec<Measured>; LANES],
    /// Room for the depths and weights of one lane.
    values: Vec<[f32; 2]>,
}

/// What a view measures of a point.
#[derive(Clone, Copy)]
struct Measured {
    /// The number of the view.
    view: u32,
    /// Depth along the ray, and its weight.
    depth: [f32; 2],
}

/// Sums over the views that agree.
struct Sums {
    /// Normals in the world's frame.
    normal: [Lanes; 3],
    colour: [Lanes; 3],
    colour_weight: Lanes,
    confidence: Lanes,
}

/// The pixels of a view that see the points, one a lane.
struct Looks {
    /// 1 where the view agrees, 0 elsewhere.
    agrees: Lanes,
    normal: Lanes<PackedNormal>,
    paint: Lanes<Paint>,
    /// Standard deviations of the depths, as shares of them; 0 if they are not known.
    sigma: Lanes,
}

impl<'a> Viewpoint<'a> {
    pub fn new(seen: &'a SeenView) -> Self {
        let view = &seen.filtered;
        let k = &view.camera.intrinsics;
        Self {
            seen,
            world_from_cam: view.cam_from_world.inverse(),
            rotation: view.cam_from_world.rotation.cast(),
            centre: [k.cx as f32, k.cy as f32],
            per_focal: [k.fx.recip() as f32, k.fy.recip() as f32],
            radians_per_pixel: focal(&view.camera).recip() as f32,
        }
    }
}

impl<'a> Means<'a> {
    /// Room for the points of a strip.
    pub fn new(reference: &'a Viewpoint<'a>) -> Self {
        let none = [0.0; LANES];
        Self {
            reference,
            ray: [none; 2],
            footprint: none,
            facing: [none; 3],
            per_slant: none,
            per_clarity: none,
            length: none,
            has_sigma: [false; LANES],
            sums: Sums::none(),
            measured: std::array::from_fn(|_| Vec::with_capacity(USUAL_VIEWS)),
            values: Vec::new(),
        }
    }

    /// Begins with what the reference view, number `view`, measures at the pixels x of row `y`, at most [`LANES`].
    pub fn begin(&mut self, view: usize, pixels: &[usize], y: usize) {
        let seen = self.reference.seen;
        let first = y * seen.filtered.size().width;
        let mut chosen = [0; LANES];
        chosen.iter_mut().zip(pixels).for_each(|(chosen, x)| *chosen = (first + x) as u32);
        let looks = Looks::at(seen, first_lanes(pixels.len()), &chosen);
        let (mut depth, mut confidence) = ([1.0; LANES], [0.0; LANES]);
        for (lane, &x) in pixels.iter().enumerate() {
            let sample = seen.filtered.samples.data()[first + x];
            (depth[lane], confidence[lane]) = (sample.inverse_depth().recip(), sample.confidence());
            self.ray[0][lane] = (x as f32 + 0.5 - self.reference.centre[0]) * self.reference.per_focal[0];
            self.ray[1][lane] = (y as f32 + 0.5 - self.reference.centre[1]) * self.reference.per_focal[1];
        }
        self.sums = Sums::none();
        self.measured.iter_mut().for_each(Vec::clear);
        let mut depths = [[0.0; LANES]; 2];
        measure_reference([&depth, &confidence], &looks, self, &mut depths);
        self.push(view, first_lanes(pixels.len()), &depths);
    }

    /// Adds the answers of a source view in the lanes in which it agrees.
    pub fn add(&mut self, pair: &Pair<'_>, source: &SeenView, answers: &Answers) {
        let agreeing = answers.agreeing();
        if agreeing != 0 {
            let (looks, mut depths) = (Looks::at(source, agreeing, &answers.pixel), [[0.0; LANES]; 2]);
            measure_source(pair, answers, &looks, self, &mut depths);
            self.push(pair.source_view, agreeing, &depths);
        }
    }

    fn push(&mut self, view: usize, agreeing: u64, [depth, weight]: &[Lanes; 2]) {
        for lane in set_bits(agreeing) {
            let depth = [depth[lane], weight[lane]];
            self.measured[lane].push(Measured { view: view as u32, depth });
        }
    }

    /// The views that agree on the point of a lane, in the order in which they were added.
    pub fn views(&self, lane: usize) -> impl Iterator<Item = u32> {
        self.measured[lane].iter().map(|measured| measured.view)
    }

    /// The point of a lane in the world; `max_relative_depth` is the largest relative difference of depths
    /// that agree.
    pub fn point(&mut self, lane: usize, max_relative_depth: f32) -> CloudPoint {
        self.values.clear();
        self.values.extend(self.measured[lane].iter().map(|measured| measured.depth));
        let views = self.values.len();
        let Mean { depth, weight, spread } = robust_mean(&mut self.values, HALF_WEIGHT * max_relative_depth);
        let of = |sums: &[Lanes; 3]| sums.map(|sum| sum[lane]);
        let colour: Rgb = of(&self.sums.colour).map(|sum| (sum / self.sums.colour_weight[lane] + 0.5) as u8);
        let position = Vector3::new(self.ray[0][lane], self.ray[1][lane], 1.0) * depth;
        CloudPoint {
            x_in_world: self.reference.world_from_cam.transform(&position.cast()).into(),
            normal: Vector3::from(of(&self.sums.normal)).cast::<f64>().normalize().cast::<f32>().into(),
            colour,
            confidence: self.sums.confidence[lane] / views as f32,
            sigma: self.sigma(lane, weight, spread),
            views: views.min(255) as u8,
        }
    }
}

impl Means<'_> {
    /// The standard deviation along the ray of a mean of depths with these summed weights and this weighted sum of squared
    /// differences; 0 if the depth's own is not known. Where the depths differ by more than theirs, it is larger.
    ///
    /// Maps that agree are not independent: their photographs are the same, and each was refined with the others. The variance
    /// of their mean is that of independent ones times the power 3/4 of their number, fitted to rendered scenes.
    fn sigma(&self, lane: usize, weight: f32, spread: f32) -> f32 {
        if !self.has_sigma[lane] {
            return 0.0;
        }
        let (footprint, views) = (self.footprint[lane], self.measured[lane].len() as f32);
        let excess =
            spread * self.length[lane] * self.length[lane] / (footprint * footprint * fmax(views - 1.0, 1.0));
        let root = views.sqrt();
        footprint * (fmax(excess, 1.0) * root * root.sqrt() / weight).sqrt()
    }
}

impl Looks {
    /// The pixels with these indices in the lanes that agree, one bit each.
    fn at(view: &SeenView, agreeing: u64, pixels: &Lanes<u32>) -> Self {
        let mut looks = Self {
            agrees: [0.0; LANES],
            normal: [PackedNormal::default(); LANES],
            paint: [Paint::default(); LANES],
            sigma: [0.0; LANES],
        };
        let (all, width) = (view.look.data(), view.look.width());
        for lane in set_bits(agreeing) {
            let pixel = pixels[lane] as usize;
            prefetch(all, pixel + PREFETCH_ROWS * width);
            let Look { normal, paint } = all[pixel];
            looks.agrees[lane] = 1.0;
            (looks.normal[lane], looks.paint[lane], looks.sigma[lane]) = (normal, paint, paint.sigma());
        }
        looks
    }
}

widened! {
    /// Measures the reference view's own pixels, which have these depths and confidences.
    fn measure_reference(own: [&Lanes; 2], looks: &Looks, means: &mut Means<'_>, depths: &mut [Lanes; 2]) = measure_reference_any;
}

widened! {
    /// Measures the pixels of a source view that agree.
    fn measure_source(
        pair: &Pair<'_>,
        answers: &Answers,
        looks: &Looks,
        means: &mut Means<'_>,
        depths: &mut [Lanes; 2],
    ) = measure_source_any;
}

// No closures from here on: they would not be compiled for the widest vectors.
#[inline(always)]
fn measure_reference_any(
    [depth, confidence]: [&Lanes; 2],
    looks: &Looks,
    means: &mut Means<'_>,
    depths: &mut [Lanes; 2],
) {
    let (rotation, radians_per_pixel) = (&means.reference.rotation, means.reference.radians_per_pixel);
    for lane in 0..LANES {
        let [a, b, c] = looks.normal[lane].components();
        let facing_x = rotation[(0, 0)] * a + rotation[(0, 1)] * b + rotation[(0, 2)] * c;
        let facing_y = rotation[(1, 0)] * a + rotation[(1, 1)] * b + rotation[(1, 2)] * c;
        let facing_z = rotation[(2, 0)] * a + rotation[(2, 1)] * b + rotation[(2, 2)] * c;
        let (x, y) = (means.ray[0][lane], means.ray[1][lane]);
        let slant = facing_x * x + facing_y * y + facing_z;
        let length = (x * x + y * y + 1.0).sqrt();
        let footprint = depth[lane] * radians_per_pixel;
        means.facing[0][lane] = facing_x;
        means.facing[1][lane] = facing_y;
        means.facing[2][lane] = facing_z;
        means.footprint[lane] = footprint;
        means.per_slant[lane] = if slant.abs() >= LEAST_COSINE * length { 1.0 / slant } else { 0.0 };
        means.per_clarity[lane] = footprint / fmax(slant.abs() / length, LEAST_COSINE);
        means.length[lane] = length;
        depths[0][lane] = depth[lane];
        let sigma = looks.sigma[lane] * depth[lane] * length;
        means.has_sigma[lane] = sigma > 0.0;
        let relative = footprint / sigma;
        let plain = fmax(confidence[lane], LEAST_CONFIDENCE);
        depths[1][lane] = if sigma > 0.0 { fmin(relative * relative, MOST_WEIGHT) } else { plain };
        means.sums.add(looks, (1.0, confidence[lane]), lane);
    }
}

#[inline(always)]
fn measure_source_any(
    pair: &Pair<'_>,
    answers: &Answers,
    looks: &Looks,
    means: &mut Means<'_>,
    depths: &mut [Lanes; 2],
) {
    let ([cx, cy], [per_fx, per_fy]) = (means.reference.centre, means.reference.per_focal);
    let (camera, pixels_per_radian) = (&pair.source_centre, pair.radians_per_pixel.recip());
    for lane in 0..LANES {
        // The source's surface point.
        let per_w = 1.0 / answers.inverse_depth[lane];
        let z = answers.back[2][lane];
        let px = (answers.back[0][lane] - cx * z) * per_fx * per_w;
        let py = (answers.back[1][lane] - cy * z) * per_fy * per_w;
        let pz = z * per_w;
        let (fx, fy, fz) = (means.facing[0][lane], means.facing[1][lane], means.facing[2][lane]);
        // The depth at which the ray meets the plane through that point with the pixel's own normal.
        let per_slant = means.per_slant[lane];
        let along = if per_slant == 0.0 { pz } else { (fx * px + fy * py + fz * pz) * per_slant };
        let per_footprint = answers.inverse_depth[lane] * pixels_per_radian;
        let relative = means.footprint[lane] * per_footprint;
        let detail = fmin(relative * relative, MOST_DETAIL);
        let (dx, dy, dz) = (px - camera.x, py - camera.y, pz - camera.z);
        let distance = (dx * dx + dy * dy + dz * dz).sqrt();
        let cosine = (fx * dx + fy * dy + fz * dz).abs() / distance;
        let clarity = fmax(cosine, LEAST_COSINE) * per_footprint;
        let ratio = fmin(clarity * means.per_clarity[lane], 1e3);
        depths[0][lane] = along;
        let confidence = answers.sureness[lane] * answers.sureness[lane];
        // A depth of the source moves the point along the reference ray by the ratio of the cosines.
        let sigma = looks.sigma[lane] * distance * fmax(cosine, LEAST_COSINE) * means.per_clarity[lane];
        let relative = means.footprint[lane] * means.footprint[lane] / sigma;
        let plain = fmax(confidence, LEAST_CONFIDENCE) * detail;
        depths[1][lane] = if sigma > 0.0 { fmin(relative * relative, MOST_WEIGHT) } else { plain };
        means.sums.add(looks, (ratio * ratio * ratio * ratio, confidence), lane);
    }
}

impl Sums {
    fn none() -> Self {
        let none = [0.0; LANES];
        Self { normal: [none; 3], colour: [none; 3], colour_weight: none, confidence: none }
    }

    /// Adds a pixel of a view with a weight of its colour and its confidence, if the view agrees.
    #[inline(always)]
    fn add(&mut self, looks: &Looks, (weight, confidence): (f32, f32), lane: usize) {
        let agrees = looks.agrees[lane] > 0.0;
        let [a, b, c] = looks.normal[lane].components();
        let turned = self.normal[0][lane] * a + self.normal[1][lane] * b + self.normal[2][lane] * c;
        // The back of a thin sheet must not cancel its front.
        let share = if agrees & (turned >= 0.0) { 1.0 } else { 0.0 };
        self.normal[0][lane] += share * a;
        self.normal[1][lane] += share * b;
        self.normal[2][lane] += share * c;
        let paint = looks.paint[lane];
        let weight = if paint.is_inner() { weight } else { AT_EDGE * weight };
        let weight = if agrees { weight } else { 0.0 };
        let [red, green, blue] = paint.colour();
        self.colour[0][lane] += weight * red;
        self.colour[1][lane] += weight * green;
        self.colour[2][lane] += weight * blue;
        self.colour_weight[lane] += weight;
        self.confidence[lane] += if agrees { confidence } else { 0.0 };
    }
}

/// A robust mean of depths.
struct Mean {
    depth: f32,
    /// The sum of the weights that counted.
    weight: f32,
    /// The weighted sum of the squared differences from the mean.
    spread: f32,
}

/// The robust mean of weighted values: a value whose distance to the weighted median is the share
/// `half_weight` of it has half its weight (Cauchy).
fn robust_mean(values: &mut [[f32; 2]], half_weight: f32) -> Mean {
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
    let depth = median + sum / weights;
    let spread = values.iter().map(|value| weight(value) * (value[0] - depth).powi(2)).sum();
    Mean { depth, weight: weights, spread }
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
        let mean = |values: &[[f32; 2]]| robust_mean(&mut values.to_vec(), 0.0025).depth;
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
