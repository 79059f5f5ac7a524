//! Depth by a plane sweep over photographs alone.

use vamvs_core::{Photo, Size};
use vamvs_refine::{RefineOptions, SWEEP_STRIDE};

use super::{Clock, Estimated, Task};
use crate::refinement::limited;
use crate::region::shares;
use crate::{DepthOptions, VamvsError};

/// Distance between neighbouring planes in the source views, pixels of the photographs: one of the depth map.
pub const PLANE_STEP: f64 = SWEEP_STRIDE as f64;

/// What the photographs of a sweep take for each of their pixels, bytes: colours, luminance and its pyramid.
const BYTES_PER_PIXEL: u64 = 12;

/// Refuses options of networks.
pub fn check(options: &DepthOptions) -> Result<(), VamvsError> {
    let DepthOptions { coarse_stride, iterations, fovea, visibility, .. } = options;
    let wrong = match (coarse_stride, iterations, fovea, visibility) {
        (Some(_), ..) => "a coarse stride (--coarse-stride)",
        (_, Some(_), ..) => "iterations (--iterations)",
        (_, _, true, _) => "foveated depth (--fovea)",
        (.., true) => "predicted visibility (--visibility)",
        _ => return Ok(()),
    };
    Err(VamvsError::Request(format!("--weights none has no network, and {wrong} needs one")))
}

/// What a depth map takes at its peak, bytes.
pub fn peak_bytes(photograph: Size, views: usize, planes: usize) -> u64 {
    vamvs_refine::sweep_bytes(photograph, planes) + (views * photograph.area()) as u64 * BYTES_PER_PIXEL
}

/// The depth map of a view.
pub fn estimate(task: &Task<'_>, clock: &mut Clock) -> Result<Estimated, VamvsError> {
    let photo = &task.reference.photo;
    let inside = task.region.map(|region| limited(photo, shares(region, photo.camera.size)));
    let sources: Vec<&Photo> = task.sources.iter().map(|source| &source.photo).collect();
    let reference = inside.as_ref().unwrap_or(photo);
    let sweep =
        || vamvs_refine::plane_sweep(reference, &sources, &task.plan.planes, &RefineOptions::default());
    let map = clock.time("plane-sweep", sweep)?;
    Ok((vec![map], Vec::new()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_needs_a_network_is_refused() {
        assert!(check(&DepthOptions::default()).is_ok());
        let strided = DepthOptions { coarse_stride: Some(4), ..DepthOptions::default() };
        let iterated = DepthOptions { iterations: Some(1), ..DepthOptions::default() };
        let foveated = DepthOptions { fovea: true, ..DepthOptions::default() };
        let seen = DepthOptions { visibility: true, ..DepthOptions::default() };
        for (options, flag) in [
            (strided, "--coarse-stride"),
            (iterated, "--iterations"),
            (foveated, "--fovea"),
            (seen, "--visibility"),
        ] {
            assert!(check(&options).unwrap_err().to_string().contains(flag));
        }
    }
}
