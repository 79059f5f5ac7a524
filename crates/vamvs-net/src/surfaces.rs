//! What becomes of a map between the stages, for networks whose manifest asks for it: blank surfaces are
//! completed, and larger maps keep to the photograph's edges. Neither is in the paper.

use tch::{TchError, Tensor};
use vamvs_core::complete::{Completion, complete};
use vamvs_core::guided::{Guidance, enlarge};
use vamvs_core::{Grid, Planes, Rgb, Spacing};

use crate::coarse::PlaneMap;
use crate::estimator::to_grid;
use crate::{EncodedView, Iteration, NetError};

/// The map with the depths that bend least where confidence is low; `image` is the photograph at the map's size.
///
/// # Errors
/// If memory runs out.
pub(crate) fn completed(
    map: PlaneMap,
    image: &Grid<Rgb>,
    planes: &Planes,
    how: Completion,
) -> Result<PlaneMap, NetError> {
    // In steps of inverse depth a plane of the world is linear in the pixel's coordinates.
    let inverse = Planes { spacing: Spacing::InverseDepth, ..*planes };
    let last = (planes.count - 1) as f64;
    let between =
        |from: &Planes, to: &Planes, u: f32| to.coordinate(from.depth(f64::from(u).clamp(0.0, last))) as f32;
    let values = to_grid(&map.u)?.map(|&u| between(planes, &inverse, u));
    let filled = complete(&values, &to_grid(&map.confidence)?, image, how);
    let u = to_tensor(&filled.map(|&v| between(&inverse, planes, v)), &map.u)?;
    Ok(PlaneMap { u, confidence: map.confidence })
}

/// `u`, a map of `reference` at twice the iteration's scale or at the same, at the iteration's. Depths that differ
/// by more than its `hypotheses` to each side reach are of two surfaces.
///
/// # Errors
/// If memory runs out.
pub(crate) fn enlarged(
    u: &Tensor,
    reference: &EncodedView,
    iteration: Iteration,
    hypotheses: usize,
    colour: f32,
) -> Result<Tensor, NetError> {
    let scale = iteration.scale;
    let (Some(coarse), Some(fine)) = (reference.photograph(2 * scale), reference.photograph(scale)) else {
        return Ok(u.shallow_clone());
    };
    let map = to_grid(u)?;
    if map.size() != coarse.size() {
        return Ok(u.shallow_clone());
    }
    let jump = hypotheses as f32 * iteration.step as f32;
    Ok(to_tensor(&enlarge(&map, coarse, fine, Guidance { colour, jump }), u)?)
}

/// A map (h, w) where `like` lives.
fn to_tensor(map: &Grid<f32>, like: &Tensor) -> Result<Tensor, TchError> {
    let shape = [map.height() as i64, map.width() as i64];
    Tensor::f_from_slice(map.data())?.f_view(shape)?.f_to_device(like.device())
}
