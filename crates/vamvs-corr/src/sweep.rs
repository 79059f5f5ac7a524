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

    /// The depth of a plane at a pixel, by its number in the image.
    #[inline(always)]
    fn depth(&self, plane: usize, pixel: usize) -> f32 {
        match &self.depths {
            Depths::Planes(depths) => depths[plane],
            Depths::Around { u, planes, count, step } => {
                planes.of((plane as f32 - 0.5 * (count - 1) as f32).mul_add(*step, u[pixel]))
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
        Map::by_rows([self.count(), height, width], GROUPS, |row, to| {
            weigh_row(self, &sources, masks, row, to);
        })
    }
}

impl Source<'_> {
    /// The rays of a row's pixels: the pixel at depth d is at d · ray + offset.
    fn rays(&self, sweep: &Sweep<'_>, y: usize, rays: &mut Vec<[f32; 3]>) {
        let centre = |at: usize| (at as f64 + 0.5) * sweep.stride as f64;
        let y = centre(y);
        rays.clear();
        rays.extend((0..sweep.reference.features.width).map(|x| {
            let x = centre(x);
            self.linear.map(|[a, b, c]| (a * x + b * y + c) as f32)
        }));
    }

    /// The four pixels around a point, `None` behind the camera and outside.
    #[inline(always)]
    fn corners(&self, ray: [f32; 3], depth: f32) -> Option<Corners> {
        let [x, y, z]: [f32; 3] = std::array::from_fn(|axis| depth.mul_add(ray[axis], self.offset[axis]));
        if z <= BEHIND {
            return None;
        }
        let inverse = 1.0 / z;
        Corners::around(self.features, [x * inverse * self.scale[0] - 0.5, y * inverse * self.scale[1] - 0.5])
    }
}

/// The four pixels around a position, as offsets into the values, and their bilinear weights. Pixels outside of the image have
/// weight 0.
#[derive(Clone, Copy)]
struct Corners {
    offsets: [usize; 4],
    weights: [f32; 4],
}

impl Corners {
    #[inline(always)]
    fn around(map: &Map, [x, y]: [f32; 2]) -> Option<Self> {
        if !(x > -1.0 && y > -1.0 && x < map.width as f32 && y < map.height as f32) {
            return None;
        }
        // x + 1 and y + 1 are not negative, so truncation is their floor.
        let (x0, y0) = ((x + 1.0) as i32 - 1, (y + 1.0) as i32 - 1);
        let axis = |first: i32, share: f32, count: usize| {
            let last = count as i32 - 1;
            let low = if first >= 0 { 1.0 - share } else { 0.0 };
            let high = if first < last { share } else { 0.0 };
            ([first.max(0) as usize, (first + 1).min(last) as usize], [low, high])
        };
        let ([x0, x1], [left, right]) = axis(x0, x - x0 as f32, map.width);
        let ([y0, y1], [above, below]) = axis(y0, y - y0 as f32, map.height);
        let at = |x: usize, y: usize| (y * map.width + x) * CHANNELS;
        Some(Self {
            offsets: [at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)],
            weights: [left * above, right * above, left * below, right * below],
        })
    }

    /// Adds `weight` times the correlation with a reference pixel to the sums of the groups.
    #[inline(always)]
    fn add_correlation(&self, map: &Map, reference: &[[f32; GROUPS]], weight: f32, sums: &mut [f32; GROUPS]) {
        let corner = |index: usize| map.values[self.offsets[index]..][..CHANNELS].as_chunks::<GROUPS>().0;
        let (a, b, c, d) = (corner(0), corner(1), corner(2), corner(3));
        let weight = weight * GROUPS as f32 / CHANNELS as f32;
        let [wa, wb, wc, wd] = self.weights.map(|corner| corner * weight);
        for j in 0..CHANNELS / GROUPS {
            for g in 0..GROUPS {
                let sampled = wd.mul_add(d[j][g], wc.mul_add(c[j][g], wb.mul_add(b[j][g], wa * a[j][g])));
                sums[g] = sampled.mul_add(reference[j][g], sums[g]);
            }
        }
    }
}

#[inline(always)]
fn pool(sweep: &Sweep<'_>, source: &Source<'_>, row: Row, to: &mut [f32]) {
    let reference = sweep.reference.features.row(row).as_chunks::<GROUPS>().0;
    let mut rays = Vec::new();
    source.rays(sweep, row.y, &mut rays);
    let (count, width) = (sweep.count(), rays.len());
    let share = 1.0 / count as f32;
    let (pixels, _) = to.as_chunks_mut::<GROUPS>().0.as_chunks_mut::<2>();
    for (x, (ray, pooled)) in rays.iter().zip(pixels).enumerate() {
        let reference = &reference[x * CHANNELS / GROUPS..][..CHANNELS / GROUPS];
        let (mut largest, mut sum) = ([f32::NEG_INFINITY; GROUPS], [0.0; GROUPS]);
        for plane in 0..count {
            let mut values = [0.0; GROUPS];
            if let Some(corners) = source.corners(*ray, sweep.depth(plane, row.y * width + x)) {
                corners.add_correlation(source.features, reference, 1.0, &mut values);
            }
            for g in 0..GROUPS {
                largest[g] = largest[g].max(values[g]);
                sum[g] += values[g];
            }
        }
        *pooled = [largest, sum.map(|sum| sum * share)];
    }
}
widened!(pool => pool_row(sweep: &Sweep<'_>, source: &Source<'_>, row: Row, to: &mut [f32]));

#[inline(always)]
fn weigh(sweep: &Sweep<'_>, sources: &[Source<'_>], masks: &[Vec<f32>], Row { z, y }: Row, to: &mut [f32]) {
    let reference = sweep.reference.features.line(y).as_chunks::<GROUPS>().0;
    let mut rays = Vec::new();
    let (pixels, _) = to.as_chunks_mut::<GROUPS>();
    let first = y * pixels.len();
    for (source, mask) in sources.iter().zip(masks) {
        source.rays(sweep, y, &mut rays);
        for (x, (sums, ray)) in pixels.iter_mut().zip(&rays).enumerate() {
            let Some(corners) = source.corners(*ray, sweep.depth(z, first + x)) else { continue };
            let reference = &reference[x * CHANNELS / GROUPS..][..CHANNELS / GROUPS];
            corners.add_correlation(source.features, reference, mask[first + x], sums);
        }
    }
    for (x, sums) in pixels.iter_mut().enumerate() {
        let weight: f32 = masks.iter().map(|mask| mask[first + x]).sum();
        let share = 1.0 / (weight + UNSEEN);
        sums.iter_mut().for_each(|sum| *sum *= share);
    }
}
widened!(weigh => weigh_row(
    sweep: &Sweep<'_>,
    sources: &[Source<'_>],
    masks: &[Vec<f32>],
    row: Row,
    to: &mut [f32],
));
