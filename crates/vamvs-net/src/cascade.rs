//! A cascade's second stage: planes around the first depth at twice its resolution, and where there is no surface.

use tch::{Kind, TchError, Tensor};
use vamvs_core::{DepthMap, Grid, Planes, Size};

use crate::coarse::{PlaneMap, soft_argmin};
use crate::cost_volume::{self, CostVolume, SweepInputs};
use crate::profile::{Profile, Stage};
use crate::{Coarse, EncodedView, Estimator, Manifest, NetError};

/// The output of a cascade's second stage.
#[derive(Debug)]
pub struct Fine {
    /// The depth map, (h, w).
    pub map: PlaneMap,
    /// The costs of the planes, (1, K, h, w); a low cost is likely.
    pub costs: Tensor,
    /// The depth that the planes lie around, (h, w), in plane coordinates: the coarse map enlarged.
    pub around: Tensor,
    /// The coarse pixels that it was enlarged from.
    pub parents: Parents,
    /// The probability that a pixel shows a surface inside the depth range, (h, w) in [0, 1].
    pub surface: Tensor,
    /// The visibility mask of each source view, (1, 1, h, w) in [0, 1]: those of the coarse stage enlarged.
    pub visibility: Vec<Tensor>,
}

/// For each pixel of a map, the 3×3 pixels around it of a map of half the resolution, rows first.
#[derive(Debug)]
pub struct Parents {
    /// Their depths, (9, h, w), in plane coordinates.
    pub depths: Tensor,
    /// How likely each of them shows the pixel's surface, (9, h, w); the sum is 1.
    pub shares: Tensor,
}

/// Depths that differ by more than this are of different surfaces; plane distances.
const ONE_SURFACE: f64 = 1.0;

impl Parents {
    /// The parents in the map `u`, (h, w), with their shares (1, 9, 2h, 2w).
    fn of(u: &Tensor, shares: &Tensor) -> Result<Self, TchError> {
        let (h, w) = u.size2()?;
        let wide = u.f_unsqueeze(0)?.f_unsqueeze(0)?.f_replication_pad2d([1, 1, 1, 1])?;
        let near = (0..9).map(|k| wide.f_narrow(2, k / 3, h)?.f_narrow(3, k % 3, w));
        let near = Tensor::f_cat(&near.collect::<Result<Vec<_>, _>>()?, 1)?;
        let depths = near.f_upsample_nearest2d([2 * h, 2 * w], None, None)?.f_squeeze_dim(0)?;
        Ok(Self { depths, shares: shares.f_squeeze_dim(0)? })
    }

    /// The depth of each pixel, (h, w): the mean of the likeliest parent and of those on one surface with it, so that no
    /// pixel lies between two surfaces.
    fn depth(&self) -> Result<Tensor, TchError> {
        let likeliest = self.depths.f_gather(0, &self.shares.f_argmax(0, true)?, false)?;
        let is_one = self.depths.f_sub(&likeliest)?.f_abs()?.f_le(ONE_SURFACE)?;
        let shares = self.shares.f_mul(&is_one)?;
        let sum = |of: &Tensor| of.f_sum_dim_intlist([0].as_slice(), false, Kind::Float);
        sum(&shares.f_mul(&self.depths)?)?.f_div(&sum(&shares)?)
    }
}

impl Estimator {
    /// A cascade's second stage, around the map of the first one and with its weights of the views. The network must be a
    /// cascade.
    ///
    /// # Errors
    /// As [`Estimator::estimate`].
    pub fn fine(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        coarse: &Coarse,
        profile: &mut Profile,
    ) -> Result<Fine, NetError> {
        let (network, slab_bytes) = (self.network(), self.options().slab_bytes);
        let Manifest { cascade, window, .. } = network.manifest();
        let Some(cascade) = *cascade else {
            return Err(NetError::Request("a second stage needs a network that is a cascade".to_owned()));
        };
        let size = reference.size_at(reference.stride);
        let parents = {
            let u = coarse.map.u.f_detach()?;
            Parents::of(&u, &network.enlarge_depth(&u, &reference.coarse[1], &reference.coarse[0])?)?
        };
        let around = parents.depth()?.f_detach()?;
        let visibility: Vec<Tensor> =
            coarse.visibility.iter().map(|mask| enlarged(mask, size)).collect::<Result<_, _>>()?;
        let inputs =
            SweepInputs { network, reference, sources, planes, level: 0, around: Some(&around), slab_bytes };
        let masks = visibility.iter().map(Tensor::shallow_clone).collect();
        let CostVolume { volume, .. } =
            profile.time(Stage::Sweep, || cost_volume::sweep(&inputs, Some(masks)))?;
        let costs = profile.time(Stage::Regularize, || cost_volume::regularize(&inputs, &volume))?;
        let PlaneMap { u: place, confidence } = soft_argmin(&costs, *window)?;
        let from_middle = place.f_sub_scalar(0.5 * (cascade.planes - 1) as f64)?;
        let u = around.f_add(&from_middle.f_mul_scalar(cascade.step)?)?;
        let as_images = |map: &Tensor| map.f_unsqueeze(0)?.f_unsqueeze(0);
        let coarse_confidence = enlarged(&as_images(&coarse.map.confidence)?, size)?;
        let evidence = [
            coarse_confidence.shallow_clone(),
            enlarged(&spread_of(&coarse.costs)?, size)?,
            as_images(&confidence)?,
            volume.f_mean_dim([1].as_slice(), false, Kind::Float)?.f_amax([1], true)?,
            Tensor::f_cat(&visibility, 1)?.f_mean_dim([1].as_slice(), true, Kind::Float)?,
            as_images(&u)?.f_div_scalar((planes.count - 1) as f64)?,
        ];
        let evidence = Tensor::f_cat(&evidence, 1)?.f_detach()?;
        let surface = network.surface(&evidence, &reference.coarse[0])?.f_squeeze_dims([0, 1].as_slice())?;
        let confidence = confidence.f_mul(&coarse_confidence.f_squeeze_dims([0, 1].as_slice())?)?;
        Ok(Fine { map: PlaneMap { u, confidence }, costs, around, parents, surface, visibility })
    }
}

/// Pixels that are less likely than this to show a surface have no depth.
const LEAST_SURFACE: f32 = 0.5;

/// Where there may be no surface, there is less confidence in a depth; where there likely is none, there is no depth.
pub(crate) fn keep_surfaces(map: &mut DepthMap, surface: &Grid<f32>) {
    let width = map.depth.width();
    let pixels = map.depth.data_mut().iter_mut().zip(map.confidence.data_mut());
    for (at, (depth, confidence)) in pixels.enumerate() {
        let surface = surface[(at % width, at / width)];
        *confidence *= surface;
        if surface < LEAST_SURFACE {
            (*depth, *confidence) = (0.0, 0.0);
        }
    }
}

/// A map (1, 1, h, w) enlarged bilinearly to this size.
pub(crate) fn enlarged(map: &Tensor, size: Size) -> Result<Tensor, TchError> {
    map.f_upsample_bilinear2d([size.height as i64, size.width as i64], false, None, None)
}

/// How widely the probability of costs (1, D, h, w) is spread over the planes: its entropy as a share of the largest,
/// (1, 1, h, w).
fn spread_of(costs: &Tensor) -> Result<Tensor, TchError> {
    let logs = costs.f_neg()?.f_log_softmax(1, Kind::Float)?;
    let entropy =
        logs.f_exp()?.f_mul(&logs)?.f_sum_dim_intlist([1].as_slice(), true, Kind::Float)?.f_neg()?;
    entropy.f_div_scalar((costs.size()[1] as f64).ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where a depth breaks, each pixel has the depth of one side; on a slope it has the mean.
    #[test]
    fn a_pixel_never_lies_between_two_surfaces() {
        let u = Tensor::from_slice(&[1.0_f32, 1.5, 9.0, 9.2]).view([1, 4]);
        let shares = Tensor::full([1, 9, 2, 8], 0.0, (Kind::Float, tch::Device::Cpu));
        for (column, left, middle, right) in [(2, 0.3, 0.6, 0.1), (3, 0.1, 0.4, 0.5), (5, 0.45, 0.3, 0.25)] {
            for (k, share) in [(3, left), (4, middle), (5, right)] {
                let _filled = shares.select(1, k).select(2, column).fill_(share);
            }
        }
        let _others = shares.narrow(3, 0, 2).select(1, 4).fill_(1.0);
        let depth = Parents::of(&u, &shares).unwrap().depth().unwrap();
        let at = |column| depth.double_value(&[0, column]);
        assert!((at(0) - 1.0).abs() < 1e-6);
        assert!((at(2) - (0.3 * 1.0 + 0.6 * 1.5) / 0.9).abs() < 1e-6, "{}", at(2));
        assert!((at(3) - 9.0).abs() < 1e-6, "{}", at(3));
        assert!((at(5) - 1.5).abs() < 1e-6, "{}", at(5));
    }
}
