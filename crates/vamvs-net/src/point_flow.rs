//! PointFlow (sections 3.3, 3.4): refines depth on a cloud of hypothesised points.
//!
//! At finer resolutions a point's neighbourhood keeps its extent in the image: its window is dilated by
//! stride / scale, where `stride` is that of the coarse features. A dilated window never leaves its dilation phase,
//! that is, the pixels with equal coordinates modulo the dilation. With a stride of 8, a map at 1/4 therefore splits
//! into 4 independent phases and one at 1/2 into 16, each of the size of the map at 1/8. Each phase is refined by
//! itself, so no pixel is computed twice and memory does not grow with the resolution. Large phases are cut into
//! strips of rows, computed with a halo as wide as the network's receptive field.

mod features;

use tch::{Kind, TchError, Tensor};
use vamvs_core::window_knn::WindowKnn;
use vamvs_core::{Planes, Size};

use crate::coarse::{PlaneMap, expectation_and_confidence};
use crate::native::layers::Layers;
use crate::native::{edges, in_memory, in_memory_mut};
use crate::profile::{Profile, Stage};
use crate::project::{PixelGrid, depth_of};
use crate::{EncodedView, Iteration, NetError, Network};

/// Radius of the window in which a point's neighbours are searched, pixels of its phase (5 × 5 windows).
pub const WINDOW_RADIUS: usize = 2;

/// The inputs of one flow iteration.
pub struct FlowStage<'a> {
    /// The network.
    pub network: &'a Network,
    /// The reference view.
    pub reference: &'a EncodedView,
    /// The source views.
    pub sources: &'a [&'a EncodedView],
    /// The planes of the sweep, which define the plane coordinates.
    pub planes: &'a Planes,
    /// vis-var and vis-corr: the visibility masks (1, 1, h, w) at the coarse resolution, one for each source view; else
    /// empty.
    pub visibility: &'a [Tensor],
    /// Scale and step of this iteration.
    pub iteration: Iteration,
    /// Rows of a strip, halo excluded.
    pub strip_rows: usize,
}

impl FlowStage<'_> {
    /// Refines a depth map of any resolution, (h, w) in plane coordinates, and returns it at the iteration's scale.
    ///
    /// # Errors
    /// If the module breaks its contract or memory runs out.
    pub fn refine(&self, u: &Tensor, profile: &mut Profile) -> Result<PlaneMap, NetError> {
        let size = self.reference.size_at(self.iteration.scale);
        let u = upsample_nearest(u, size)?;
        let map = PlaneMap { u: u.f_zeros_like()?, confidence: u.f_zeros_like()? };
        let step = self.reference.stride / self.iteration.scale;
        for y in 0..step {
            for x in 0..step {
                let part = |map: &Tensor| dilation_phase(map, x, y, step);
                let refined = self.refine_phase((x, y), &part(&u)?, profile)?;
                part(&map.u)?.f_copy_(&refined.u)?;
                part(&map.confidence)?.f_copy_(&refined.confidence)?;
            }
        }
        Ok(map)
    }

    /// Refines one dilation phase, strip by strip: the pixels whose coordinates are ≡ `(x, y)` modulo stride / scale,
    /// which depend on no others. `u` are their depths, (h, w) in plane coordinates.
    ///
    /// # Errors
    /// As [`FlowStage::refine`].
    pub fn refine_phase(
        &self,
        (x, y): (usize, usize),
        u: &Tensor,
        profile: &mut Profile,
    ) -> Result<PlaneMap, NetError> {
        let scale = self.iteration.scale;
        let pixel_grid =
            PixelGrid::new(scale, (x, y), self.reference.stride / scale, self.reference.size_at(scale));
        let rows = pixel_grid.y.len();
        let reach = self.network.manifest().flow_layers * WINDOW_RADIUS;
        let layers = self.network.kernel_layers(&self.reference.flow)?;
        let mut strips = Vec::new();
        for first in (0..rows).step_by(self.strip_rows) {
            let end = (first + self.strip_rows).min(rows);
            let (top, bottom) = (first.saturating_sub(reach), (end + reach).min(rows));
            let strip = pixel_grid.rows(top, bottom);
            let u = u.f_narrow(0, top as i64, (bottom - top) as i64)?;
            let map = self.refine_strip(&strip, &u, layers.as_ref(), profile)?;
            let inner = |map: &Tensor| map.f_narrow(0, (first - top) as i64, (end - first) as i64);
            strips.push(PlaneMap { u: inner(&map.u)?, confidence: inner(&map.confidence)? });
        }
        join(strips)
    }

    /// Refines one strip: hypotheses, features, neighbours, flow (equations of section 3.4). No gradient flows into
    /// the input depth `u`, so each iteration learns only to improve the depth that it is given.
    fn refine_strip(
        &self,
        pixel_grid: &PixelGrid,
        u: &Tensor,
        layers: Option<&Layers>,
        profile: &mut Profile,
    ) -> Result<PlaneMap, NetError> {
        let Size { width, height } = pixel_grid.size();
        let m = self.network.manifest().hypotheses as i64;
        let hypotheses = 2 * m + 1;
        let u = u.f_detach()?.f_contiguous()?.f_view([1, -1])?;
        let offsets = Tensor::f_arange_start(-m, m + 1, (Kind::Float, u.device()))?
            .f_mul_scalar(self.iteration.step)?
            .f_view([-1, 1])?;
        let depth = depth_of(self.planes, &u.f_add(&offsets)?)?; // (J, h·w), units of near
        let points = self.points(pixel_grid, &depth)?; // (3, P)
        let features = profile.time(Stage::Fetch, || self.features(pixel_grid, &depth, &points, layers))?; // (1, C, P)
        let neighbours =
            profile.time(Stage::Neighbours, || self.neighbours(&points, pixel_grid.size(), hypotheses))?;
        profile.time(Stage::Flow, || {
            let scores = self.scores(&features, &neighbours, layers)?; // (1, P)
            let scores = scores.f_view([-1, hypotheses])?.f_tr()?; // (J, h·w)
            let flow = offset(&scores)?;
            let moved = u.f_select(0, 0)?.f_add(&flow.u.f_mul_scalar(self.iteration.step)?)?;
            let shape = [height as i64, width as i64];
            Ok(PlaneMap { u: moved.f_view(shape)?, confidence: flow.confidence.f_view(shape)? })
        })
    }

    /// The points in the reference camera's frame, centred and scaled by the depth range: (3, P), in the order
    /// (y, x, hypothesis).
    fn points(&self, pixel_grid: &PixelGrid, depth: &Tensor) -> Result<Tensor, TchError> {
        let rays = pixel_grid.rays(&self.reference.camera, depth.device())?; // (1, 3, h·w)
        let points = depth.f_unsqueeze(1)?.f_mul(&rays)?.f_permute([1, 2, 0])?; // (3, h·w, J)
        let ratio = self.planes.range.far / self.planes.range.near;
        let (centre, half) = (0.5 * (ratio + 1.0), 0.5 * (ratio - 1.0));
        let centre = Tensor::f_from_slice(&[0.0, 0.0, centre as f32])?.f_to_device(depth.device())?;
        points.f_reshape([3, -1])?.f_sub(&centre.f_view([3, 1])?)?.f_div_scalar(half)
    }

    /// The scores of points, (1, P), from their features (1, C'' + 24, P) and neighbours (1, P, k).
    fn scores(
        &self,
        features: &Tensor,
        neighbours: &Tensor,
        layers: Option<&Layers>,
    ) -> Result<Tensor, NetError> {
        let Some(layers) = layers else { return self.network.flow(features, neighbours) };
        let rows = features.f_squeeze_dim(0)?.f_tr()?.f_contiguous()?; // (P, C'' + 24)
        let mut scores = Tensor::f_empty([1, rows.size()[0]], (Kind::Float, tch::Device::Cpu))?;
        edges::scores(layers, in_memory(&rows)?, in_memory(neighbours)?, in_memory_mut(&mut scores)?);
        Ok(scores)
    }

    /// The indices of the k nearest neighbours of each point: (1, P, k).
    fn neighbours(&self, points: &Tensor, size: Size, hypotheses: i64) -> Result<Tensor, NetError> {
        let k = self.network.manifest().neighbours;
        let on_cpu =
            points.f_detach()?.f_tr()?.f_to_device(tch::Device::Cpu)?.f_contiguous()?.f_flatten(0, -1)?;
        let positions = Vec::<f32>::try_from(on_cpu)?;
        let (positions, _) = positions.as_chunks::<3>();
        let mut indices = vec![0_i64; positions.len() * k];
        let knn = WindowKnn { k, radius: WINDOW_RADIUS, dilation: 1 };
        knn.neighbours(positions, size.width, size.height, hypotheses as usize, &mut indices);
        let indices = Tensor::f_from_slice(&indices)?.f_view([1, positions.len() as i64, k as i64])?;
        Ok(indices.f_to_device(points.device())?)
    }
}

/// The offset of the depth, in steps s, from the scores (2m + 1, h·w) of the hypotheses: the soft-argmin, with the
/// probability of the two hypotheses that enclose it as confidence. A single score (m = 0) is the offset itself, with
/// confidence 1.
fn offset(scores: &Tensor) -> Result<PlaneMap, TchError> {
    let hypotheses = scores.size()[0];
    if hypotheses == 1 {
        let u = scores.f_select(0, 0)?;
        return Ok(PlaneMap { confidence: u.f_ones_like()?.f_detach()?, u });
    }
    let flow = expectation_and_confidence(&scores.f_neg()?.f_softmax(0, Kind::Float)?)?;
    Ok(PlaneMap { u: flow.u.f_sub_scalar((hypotheses / 2) as f64)?, ..flow })
}

/// Joins strips of rows into one map.
fn join(mut strips: Vec<PlaneMap>) -> Result<PlaneMap, NetError> {
    if strips.len() == 1 {
        return Ok(strips.remove(0));
    }
    let (u, confidence): (Vec<_>, Vec<_>) = strips.into_iter().map(|map| (map.u, map.confidence)).unzip();
    Ok(PlaneMap { u: Tensor::f_cat(&u, 0)?, confidence: Tensor::f_cat(&confidence, 0)? })
}

/// The dilation phase of a map (h, w): the pixels with coordinates ≡ (x, y) modulo `step`, sharing memory with it.
///
/// # Errors
/// If `map` is not of two dimensions.
pub fn dilation_phase(map: &Tensor, x: usize, y: usize, step: usize) -> Result<Tensor, TchError> {
    map.f_slice(0, y as i64, None, step as i64)?.f_slice(1, x as i64, None, step as i64)
}

/// Nearest-neighbour upsampling of a map (h, w) to `size`.
///
/// # Errors
/// If memory runs out.
pub fn upsample_nearest(map: &Tensor, size: Size) -> Result<Tensor, TchError> {
    let target = [size.height as i64, size.width as i64];
    if map.size() == target {
        return Ok(map.shallow_clone());
    }
    map.f_unsqueeze(0)?.f_unsqueeze(0)?.f_upsample_nearest2d(target, None, None)?.f_squeeze()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The claim in the module's documentation: plain windows in a phase are dilated windows in the map.
    #[test]
    fn neighbours_in_a_dilation_phase_are_those_in_the_dilated_window() {
        const STEP: usize = 4;
        let (width, height, hypotheses, k) = (24, 16, 3, 16);
        let point = |x: usize, y: usize, j: usize| {
            let wave = ((x * 37 + y * 91 + j * 53) % 101) as f32 / 101.0;
            [x as f32 + 0.3 * wave, y as f32 - 0.2 * wave, 2.0 * j as f32 + wave]
        };
        let cloud = |xs: &[usize], ys: &[usize]| -> Vec<[f32; 3]> {
            let pixels = ys.iter().flat_map(|&y| xs.iter().map(move |&x| (x, y)));
            pixels.flat_map(|(x, y)| (0..hypotheses).map(move |j| point(x, y, j))).collect()
        };
        let all = |end: usize| (0..end).collect::<Vec<_>>();
        let whole = cloud(&all(width), &all(height));
        let mut dilated = vec![0; whole.len() * k];
        WindowKnn { k, radius: WINDOW_RADIUS, dilation: STEP }.neighbours(
            &whole,
            width,
            height,
            hypotheses,
            &mut dilated,
        );
        for (x0, y0) in [(0, 0), (3, 1), (2, 3)] {
            let xs: Vec<usize> = (x0..width).step_by(STEP).collect();
            let ys: Vec<usize> = (y0..height).step_by(STEP).collect();
            let pixel_grid = cloud(&xs, &ys);
            let mut plain = vec![0; pixel_grid.len() * k];
            WindowKnn { k, radius: WINDOW_RADIUS, dilation: 1 }.neighbours(
                &pixel_grid,
                xs.len(),
                ys.len(),
                hypotheses,
                &mut plain,
            );
            let in_whole = |index: usize| {
                let (pixel, j) = (index / hypotheses, index % hypotheses);
                (ys[pixel / xs.len()] * width + xs[pixel % xs.len()]) * hypotheses + j
            };
            for (index, near) in plain.chunks_exact(k).enumerate() {
                let expected = &dilated[in_whole(index) * k..][..k];
                let found: Vec<i64> = near.iter().map(|&near| in_whole(near as usize) as i64).collect();
                assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn offsets_are_expectations_over_hypotheses_or_the_single_score() {
        let sharp = Tensor::from_slice(&[90.0_f32, 90.0, 90.0, 0.0, 90.0]).view([5, 1]);
        let flow = offset(&sharp).unwrap();
        assert!((flow.u.double_value(&[0]) - 1.0).abs() < 1e-6);
        let even = offset(&Tensor::zeros([7, 1], (Kind::Float, tch::Device::Cpu))).unwrap();
        assert!(even.u.double_value(&[0]).abs() < 1e-6);
        assert!((even.confidence.double_value(&[0]) - 2.0 / 7.0).abs() < 1e-6);
        let single = offset(&Tensor::from_slice(&[-0.7_f32, 0.2]).view([1, 2])).unwrap();
        assert!((single.u.double_value(&[0]) + 0.7).abs() < 1e-6);
        assert!((single.confidence.double_value(&[1]) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn dilation_phases_share_memory_and_cover_the_map_once() {
        let map = Tensor::zeros([6, 10], (Kind::Float, tch::Device::Cpu));
        for y in 0..2 {
            for x in 0..2 {
                let mut part = dilation_phase(&map, x, y, 2).unwrap();
                assert_eq!(part.size(), [3, 5]);
                let _ = part.g_add_scalar_(1.0);
            }
        }
        assert!(map.equal(&map.ones_like()));
    }
}
