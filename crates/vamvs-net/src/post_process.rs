//! Processing between the stages, for networks whose manifest asks for it: depth completion on textureless surfaces
//! and joint bilateral upsampling. Neither is in the paper.

use crate::depth_completion::{Completion, complete};
use crate::joint_bilateral::{Guidance, upsample};
use tch::Tensor;
use vamvs_core::{Grid, Planes, Rgb, Spacing};

use crate::coarse::PlaneMap;
use crate::point_flow::FlowStage;
use crate::tensor_grid::{to_grid, to_tensor};
use crate::{EncodedView, Iteration, NetError};

/// Completes depth where confidence is low, in a map at the coarse resolution of the image that the network sees.
///
/// # Errors
/// If memory runs out.
pub(crate) fn completed(
    map: PlaneMap,
    reference: &EncodedView,
    planes: &Planes,
    how: Completion,
) -> Result<PlaneMap, NetError> {
    let image = reference.photograph(reference.stride).expect("photographs are kept at 1/2, 1/4 and 1/8");
    let confidence = to_grid(&map.confidence)?;
    let u = to_tensor(&fill(&to_grid(&map.u)?, &confidence, image, planes, how), &map.u)?;
    Ok(PlaneMap { u, confidence: map.confidence })
}

/// Completes `u` in plane coordinates that are uniform in inverse depth, because there a plane in the world is linear
/// in pixel coordinates.
fn fill(
    u: &Grid<f32>,
    confidence: &Grid<f32>,
    image: &Grid<Rgb>,
    planes: &Planes,
    how: Completion,
) -> Grid<f32> {
    let inverse = Planes { spacing: Spacing::InverseDepth, ..*planes };
    let last = (planes.count - 1) as f64;
    let between =
        |from: &Planes, to: &Planes, u: f32| to.coordinate(from.depth(f64::from(u).clamp(0.0, last))) as f32;
    let values = u.map(|&u| between(planes, &inverse, u));
    complete(&values, confidence, image, how).map(|&v| between(&inverse, planes, v))
}

/// Upsamples the depth map `u` to the iteration's scale by joint bilateral upsampling, if that doubles its size; else
/// returns it as it is. Depths that differ by more than the reach of the hypotheses (m · s plane distances) count as
/// two surfaces.
///
/// # Errors
/// If memory runs out.
pub(crate) fn upsampled(u: &Tensor, stage: &FlowStage<'_>, colour: f32) -> Result<Tensor, NetError> {
    let Iteration { scale, step } = stage.iteration;
    let photograph = |scale| stage.reference.photograph(scale);
    let map = to_grid(u)?;
    match (photograph(2 * scale), photograph(scale)) {
        (Some(coarse), Some(fine)) if coarse.size() == map.size() => {
            let jump = stage.network.manifest().hypotheses as f32 * step as f32;
            Ok(to_tensor(&upsample(&map, coarse, fine, Guidance { colour, jump }), u)?)
        }
        _ => Ok(u.shallow_clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{DepthRange, Size};

    #[test]
    fn a_tilted_wall_is_found_again_whatever_the_planes_are_uniform_in() {
        let size = Size::new(40, 32);
        for spacing in [Spacing::Depth, Spacing::InverseDepth] {
            let planes = Planes { range: DepthRange { near: 2.0, far: 6.0 }, count: 64, spacing };
            let wall = |x: usize, y: usize| 1.0 / (0.2 + 0.004 * x as f64 + 0.002 * y as f64);
            let textureless = |x: usize, y: usize| (8..32).contains(&x) && (6..26).contains(&y);
            let u = Grid::from_fn(size, |x, y| {
                if textureless(x, y) {
                    ((x * 37 + y * 91) % 64) as f32
                } else {
                    planes.coordinate(wall(x, y)) as f32
                }
            });
            let confidence = Grid::from_fn(size, |x, y| if textureless(x, y) { 0.1 } else { 1.0 });
            let how = Completion { stiffness: 20.0, power: 4.0 };
            let filled = fill(&u, &confidence, &Grid::filled(size, [180; 3]), &planes, how);
            for (x, y) in [(20, 16), (9, 7), (31, 25), (2, 2)] {
                let depth = planes.depth(f64::from(filled[(x, y)]));
                let error = (depth / wall(x, y) - 1.0).abs();
                assert!(error < 0.01, "{spacing:?}: {depth} is not {} at {x}, {y}", wall(x, y));
            }
        }
    }
}
