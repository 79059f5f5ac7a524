//! Depth by vis-corr, without libtorch.

use std::path::Path;

use vamvs_core::{MonotoneMap, Photo};
use vamvs_corr::{EncodedView, Network, Stage};

use super::part::{placed, placed_visibility, widened};
use super::{Clock, Estimated, Features, Task};
use crate::feature_cache::Encoded;
use crate::memory::keeping_freed;
use crate::output::ConfidenceKind;
use crate::{DepthOptions, VamvsError};

/// Pixels of a photograph, along a side, for one of a depth map.
const STRIDE: usize = 4;

/// The network, and the hash of its weights.
pub struct VisCorr {
    network: Network,
    weights: blake3::Hash,
}

impl VisCorr {
    /// The network with these weights, a safetensors file.
    pub(super) fn new(name: &Path, bytes: &[u8], options: &DepthOptions) -> Result<Self, VamvsError> {
        let DepthOptions { coarse_stride, iterations, fovea, .. } = options;
        let wrong = match (coarse_stride, iterations, fovea) {
            (Some(stride), ..) if *stride != STRIDE => {
                format!("a coarse stride of {stride} (--coarse-stride): its own is {STRIDE}")
            }
            (_, Some(1..), _) => "iterations (--iterations): it has none".to_owned(),
            (.., true) => {
                "foveated depth (--fovea): it has no flow iterations, so nothing is finer in a fovea"
                    .to_owned()
            }
            _ => {
                let network = Network::new(bytes)
                    .map_err(|error| VamvsError::Corr { name: name.display().to_string(), source: error })?;
                return Ok(Self { network, weights: blake3::hash(bytes) });
            }
        };
        Err(VamvsError::Request(format!(
            "the network {} cannot make {wrong}; use vis-max (--weights)",
            name.display()
        )))
    }

    pub(super) fn name(&self) -> String {
        format!("network {} on cpu", self.network.manifest().name)
    }

    pub(super) fn plane_step(&self) -> f64 {
        self.network.manifest().plane_step
    }

    /// The hash of its weights.
    pub(super) fn identity(&self) -> String {
        format!("{} in Rust", self.weights)
    }

    pub(super) fn confidence(&self) -> ConfidenceKind {
        let calibrated = |map: &MonotoneMap| ConfidenceKind::Calibrated(map.clone());
        self.network.calibration().map_or(ConfidenceKind::Probability, calibrated)
    }

    pub(super) fn refined_calibration(&self) -> Option<&MonotoneMap> {
        self.network.manifest().refined_calibration.as_ref()
    }

    pub(super) fn peak_bytes(&self, photograph: vamvs_core::Size, views: usize, planes: usize) -> u64 {
        self.network.peak_bytes(photograph, views, planes) as u64
    }

    pub(super) fn encode(&self, photo: &Photo, clock: &mut Clock) -> Result<Features, VamvsError> {
        Ok(Features::VisCorr(Box::new(
            clock.time("encode", || keeping_freed(|| self.network.encode(photo)))?,
        )))
    }

    pub(super) fn estimate(&self, task: &Task<'_>, clock: &mut Clock) -> Result<Estimated, VamvsError> {
        let Task { reference, sources, plan, region } = task;
        let sources: Vec<&EncodedView> = sources.iter().map(|source| features(source)).collect();
        let camera = reference.photo.camera;
        let mut time = |stage, run: &mut dyn FnMut()| {
            let name = match stage {
                Stage::Sweep => "sweep",
                Stage::Regularize => "regularize",
            };
            clock.time(name, || keeping_freed(run));
        };
        let reference = features(reference);
        let Some(region) = *region else {
            let estimate = self.network.estimate(reference, &sources, &plan.planes, &mut time)?;
            return Ok((vec![estimate.map], estimate.visibility));
        };
        let (part, place) = reference.cropped(&widened(region, camera.size))?;
        let estimate = self.network.estimate(&part, &sources, &plan.planes, &mut time)?;
        let placed_seen = |seen| placed_visibility(seen, (place, STRIDE), camera.size);
        let seen = estimate.visibility.iter().map(placed_seen).collect();
        Ok((vec![placed(&estimate.map, camera, place, region)], seen))
    }
}

fn features(view: &Encoded) -> &EncodedView {
    match &view.features {
        Features::VisCorr(features) => features,
        _ => unreachable!("vis-corr encodes every photograph that it is given"),
    }
}
