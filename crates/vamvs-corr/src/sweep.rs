//! The plane sweep: correlations of the reference view with each source view at planes, averaged over the views.
//!
//! Channels are in groups, and a correlation is the mean product of a group's channels (Guo et al., CVPR 2019). All planes are
//! first pooled, to predict what a view sees, and then averaged with these weights. Correlations are computed twice rather than
//! kept, because writing a volume takes longer than computing it.

use vamvs_core::homography::PixelTransfer;
use vamvs_core::{Pinhole, Planes, Pose, Size, Spacing};

use crate::map::{Map, Row};
use crate::pyramid::CHANNELS;
use crate::wide::widened;

/// Groups of channels; channel c belongs to group c mod `GROUPS`.
pub const GROUPS: usize = 8;

/// The weight that a view counts for which sees nothing, so that no weights add up to zero.
pub const UNSEEN: f32 = 1e-3;

/// A point whose depth in a camera is below this counts as behind it; in units of the nearest depth searched.
pub const BEHIND: f32 = 1e-3;

/// A camera whose photograph has features.
#[derive(Clone, Copy, Debug)]
pub struct Placed<'a> {
    pub features: &'a Map,
    pub camera: Pinhole,
    pub cam_from_world: Pose,
    /// Size of the photograph with its padding.
    pub padded: Size,
}

/// A sweep of one reference view: its planes, and where its pixels lie.
#[derive(Debug)]
pub struct Sweep<'a> {
    reference: Placed<'a>,
    /// Stride of the features in the photograph.
    stride: usize,
    depths: Depths<'a>,
    /// The nearest depth searched, scene units.
    near: f64,
}

/// The planes of a sweep.
#[derive(Debug)]
enum Depths<'a> {
    /// The depth of each, in units of the nearest depth searched.
    Planes(Vec<f32>),
    /// Planes around a depth map in plane coordinates.
    Around { u: &'a [f32], planes: PlaneDepth, count: usize, step: f32 },
}

/// Depths of plane coordinates in units of the nearest depth searched; outside of the range they are clamped, so that they stay
/// positive and finite.
#[derive(Clone, Copy, Debug)]
pub struct PlaneDepth {
    /// Of the depth, or of its inverse, from one plane to the next.
    pub slope: f32,
    /// The least depth, or inverse depth.
    pub least: f32,
    /// Whether planes are uniform in inverse depth.
    pub is_inverse: bool,
}

impl PlaneDepth {
    /// That of a sweep's planes.
    #[must_use]
    pub fn new(planes: &Planes) -> Self {
        let (last, ratio) = ((planes.count - 1) as f64, planes.range.far / planes.range.near);
        let is_inverse = planes.spacing == Spacing::InverseDepth;
        let (far, least) = if is_inverse { (1.0 / ratio, 0.25 / ratio) } else { (ratio, 0.25) };
        Self { slope: ((far - 1.0) / last) as f32, least: least as f32, is_inverse }
    }

    #[inline(always)]
    pub(crate) fn of(self, u: f32) -> f32 {
        let along = u.mul_add(self.slope, 1.0).max(self.least);
        if self.is_inverse { 1.0 / along } else { along }
    }
}

/// A source view of a sweep: its features, and the transfer of the reference view's pixels into it: the pixel at depth d is at the
/// homogeneous pixel d · linear · pixel + offset.
struct Source<'a> {
    features: &'a Map,
    linear: [[f64; 3]; 3],
    offset: [f32; 3],
    /// From pixels of the photograph to those of the features.
    scale: [f32; 2],
}

impl<'a> Sweep<'a> {
    /// All planes.
    pub fn all(reference: Placed<'a>, planes: &Planes) -> Self {
        let depth = PlaneDepth::new(planes);
        let depths = (0..planes.count).map(|plane| depth.of(plane as f32)).collect();
        Self::new(reference, planes, Depths::Planes(depths))
    }

    /// `count` planes, `step` plane distances apart, around a depth map in plane coordinates, (h, w).
    pub fn around(reference: Placed<'a>, planes: &Planes, (u, count, step): (&'a [f32], usize, f32)) -> Self {
        Self::new(reference, planes, Depths::Around { u, planes: PlaneDepth::new(planes), count, step })
    }

    fn new(reference: Placed<'a>, planes: &Planes, depths: Depths<'a>) -> Self {
        let stride = reference.padded.width / reference.features.width;
        Self { reference, stride, depths, near: planes.range.near }
    }

    fn count(&self) -> usize {
        match &self.depths {
            Depths::Planes(depths) => depths.len(),
            Depths::Around { count, .. } => *count,
        }
    }

    /// The depths of a plane at pixels.
    #[inline(always)]
    fn depths(&self, plane: usize, pixels: Pixels) -> [f32; RUN] {
        match &self.depths {
            Depths::Planes(depths) => [depths[plane]; RUN],
            Depths::Around { u, planes, count, step } => {
                let mut around = [0.0; RUN];
                let first = pixels.y * self.reference.features.width + pixels.first;
                around[..pixels.count].copy_from_slice(&u[first..][..pixels.count]);
                let offset = plane as f32 - 0.5 * (count - 1) as f32;
                // Not `map`, which would not be compiled for the caller's instruction set.
                for u in &mut around {
                    *u = planes.of(offset.mul_add(*step, *u));
                }
                around
            }
        }
    }

    fn source(&self, source: &Placed<'a>) -> Source<'a> {
        let between = source.cam_from_world.compose(&self.reference.cam_from_world.inverse());
        let transfer = PixelTransfer::new(&self.reference.camera, &source.camera, &between);
        let Size { width, height } = source.padded;
        let scale =
            [source.features.width as f32 / width as f32, source.features.height as f32 / height as f32];
        Source {
            features: source.features,
            linear: std::array::from_fn(|row| std::array::from_fn(|column| transfer.linear[(row, column)])),
            offset: std::array::from_fn(|row| (transfer.offset[row] / self.near) as f32),
            scale,
        }
    }

    /// What one source view's correlations are over all planes: the largest and the mean of each group, an image with twice as
    /// many channels as groups.
    pub fn pooled(&self, source: &Placed<'a>) -> Map {
        let source = self.source(source);
        Map::by_rows(self.reference.features.sides(), 2 * GROUPS, |row, to| pool_row(self, &source, row, to))
    }

    /// The mean over the source views of their correlations, each weighted by its mask (h, w).
    pub fn volume(&self, sources: &[Placed<'a>], masks: &[Vec<f32>]) -> Map {
        let sources: Vec<_> = sources.iter().map(|source| self.source(source)).collect();
        let [_, height, width] = self.reference.features.sides();
        Map::through_planes([self.count(), height, width], GROUPS, |y, planes| {
            weigh_rows(self, &sources, masks, y, planes);
        })
    }
}

/// Pixels of a row that are swept at once: their positions are computed in vectors.
const RUN: usize = 32;

/// A few neighbouring pixels of a row, from the `first` on.
#[derive(Clone, Copy)]
struct Pixels {
    y: usize,
    first: usize,
    count: usize,
}

/// The rays of pixels by axis: the pixel at depth d is at d · ray + offset.
type Rays = [[f32; RUN]; 3];

impl Source<'_> {
    #[inline(always)]
    fn rays(&self, stride: usize, pixels: Pixels) -> Rays {
        let centre = |at: usize| (at as f64 + 0.5) * stride as f64;
        let y = centre(pixels.y);
        self.linear
            .map(|[a, b, c]| std::array::from_fn(|at| (a * centre(pixels.first + at) + b * y + c) as f32))
    }

    /// Where pixels at these depths lie in the view, each with the weight of its correlation.
    #[inline(always)]
    fn samples(&self, rays: &Rays, depths: &[f32; RUN], weights: &[f32; RUN]) -> Samples {
        let mut samples = Samples { corners: [[0; RUN]; 4], weights: [[0.0; RUN]; 4] };
        let (width, height) = (self.features.width, self.features.height);
        for at in 0..RUN {
            let [x, y, z]: [f32; 3] =
                std::array::from_fn(|axis| depths[at].mul_add(rays[axis][at], self.offset[axis]));
            let inverse = 1.0 / z;
            let (x, y) = (x * inverse * self.scale[0] - 0.5, y * inverse * self.scale[1] - 0.5);
            let is_inside = z > BEHIND && x > -1.0 && y > -1.0 && x < width as f32 && y < height as f32;
            let weight = if is_inside { weights[at] * GROUPS as f32 / CHANNELS as f32 } else { 0.0 };
            let (x, [left, right]) = along(if is_inside { x } else { 0.0 }, width);
            let (y, [above, below]) = along(if is_inside { y } else { 0.0 }, height);
            let weights = [left * above, right * above, left * below, right * below];
            for (corner, [x, y]) in
                [[x[0], y[0]], [x[1], y[0]], [x[0], y[1]], [x[1], y[1]]].into_iter().enumerate()
            {
                samples.corners[corner][at] = y * width as u32 + x;
                samples.weights[corner][at] = weights[corner] * weight;
            }
        }
        samples
    }
}

/// The two pixels around a position along an axis, and their weights for linear interpolation; a pixel outside has weight 0.
#[inline(always)]
fn along(position: f32, count: usize) -> ([u32; 2], [f32; 2]) {
    // Not below -1, so that truncation is the floor.
    let first = (position + 1.0) as i32 - 1;
    let (last, share) = (count as i32 - 1, position - first as f32);
    let low = if first >= 0 { 1.0 - share } else { 0.0 };
    let high = if first < last { share } else { 0.0 };
    ([first.max(0) as u32, (first + 1).min(last) as u32], [low, high])
}

/// Positions in a source view: the four pixels around each, as numbers in the image, and their weights, which are 0 behind the
/// camera and outside of the image.
struct Samples {
    corners: [[u32; RUN]; 4],
    weights: [[f32; RUN]; 4],
}

impl Samples {
    /// Adds the weighed correlation of one sample with a reference pixel to the sums of the groups.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "with an iterator this takes twice the time")]
    fn add_correlation(
        &self,
        at: usize,
        features: &[[f32; CHANNELS]],
        reference: &[f32; CHANNELS],
        sums: &mut [f32; GROUPS],
    ) {
        let [wa, wb, wc, wd] = std::array::from_fn(|corner| self.weights[corner][at]);
        let [a, b, c, d] = std::array::from_fn(|corner| &features[self.corners[corner][at] as usize]);
        for first in (0..CHANNELS).step_by(GROUPS) {
            for g in 0..GROUPS {
                let k = first + g;
                let sampled = wd.mul_add(d[k], wc.mul_add(c[k], wb.mul_add(b[k], wa * a[k])));
                sums[g] = sampled.mul_add(reference[k], sums[g]);
            }
        }
    }
}

/// The features of a map, pixel by pixel.
#[inline(always)]
fn pixels_of(values: &[f32]) -> &[[f32; CHANNELS]] {
    values.as_chunks().0
}

#[inline(always)]
fn pool(sweep: &Sweep<'_>, source: &Source<'_>, row: Row, to: &mut [f32]) {
    let reference = pixels_of(sweep.reference.features.row(row));
    let features = pixels_of(&source.features.values);
    let count = sweep.count();
    let share = 1.0 / count as f32;
    let (pooled, _) = to.as_chunks_mut::<GROUPS>().0.as_chunks_mut::<2>();
    for (run, pooled) in pooled.chunks_mut(RUN).enumerate() {
        let pixels = Pixels { y: row.y, first: run * RUN, count: pooled.len() };
        let rays = source.rays(sweep.stride, pixels);
        pooled.fill([[f32::NEG_INFINITY; GROUPS], [0.0; GROUPS]]);
        for plane in 0..count {
            let samples = source.samples(&rays, &sweep.depths(plane, pixels), &[1.0; RUN]);
            for (at, [largest, sum]) in pooled.iter_mut().enumerate() {
                let mut values = [0.0; GROUPS];
                samples.add_correlation(at, features, &reference[pixels.first + at], &mut values);
                for g in 0..GROUPS {
                    largest[g] = largest[g].max(values[g]);
                    sum[g] += values[g];
                }
            }
        }
        pooled.iter_mut().for_each(|[_, sum]| sum.iter_mut().for_each(|sum| *sum *= share));
    }
}
widened!(pool => pool_row(sweep: &Sweep<'_>, source: &Source<'_>, row: Row, to: &mut [f32]));

/// Row `y` of all planes of the volume. A few pixels go through all planes before the next ones do, because neighbouring planes see
/// neighbouring features.
#[inline(always)]
fn weigh(sweep: &Sweep<'_>, sources: &[Source<'_>], masks: &[Vec<f32>], y: usize, planes: &mut [&mut [f32]]) {
    let reference = pixels_of(sweep.reference.features.line(y));
    let width = sweep.reference.features.width;
    for first in (0..width).step_by(RUN) {
        let pixels = Pixels { y, first, count: RUN.min(width - first) };
        let mut total = [0.0; RUN];
        for (source, mask) in sources.iter().zip(masks) {
            let rays = source.rays(sweep.stride, pixels);
            let features = pixels_of(&source.features.values);
            let mut weights = [0.0; RUN];
            weights[..pixels.count].copy_from_slice(&mask[y * width + first..][..pixels.count]);
            total.iter_mut().zip(weights).for_each(|(total, weight)| *total += weight);
            for (plane, to) in planes.iter_mut().enumerate() {
                let sums = &mut to.as_chunks_mut::<GROUPS>().0[first..][..pixels.count];
                let samples = source.samples(&rays, &sweep.depths(plane, pixels), &weights);
                for (at, sums) in sums.iter_mut().enumerate() {
                    samples.add_correlation(at, features, &reference[first + at], sums);
                }
            }
        }
        let shares = total.map(|total| 1.0 / (total + UNSEEN));
        for to in planes.iter_mut() {
            let sums = &mut to.as_chunks_mut::<GROUPS>().0[first..][..pixels.count];
            for (sums, share) in sums.iter_mut().zip(shares) {
                sums.iter_mut().for_each(|sum| *sum *= share);
            }
        }
    }
}
widened!(weigh => weigh_rows(
    sweep: &Sweep<'_>,
    sources: &[Source<'_>],
    masks: &[Vec<f32>],
    y: usize,
    planes: &mut [&mut [f32]],
));
