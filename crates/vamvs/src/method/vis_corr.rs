//! Depth by vis-corr, without libtorch.

use std::path::Path;

use vamvs_core::roi::PixelBox;
use vamvs_core::{MonotoneMap, Photo, Pinhole};
use vamvs_corr::{EncodedView, Estimate, Network, Stage};

use super::part::{placed, placed_visibility, widened};
use super::{Clock, Estimated, Features, Task};
use crate::fit::MethodMemory;
use crate::method::Encoded;
use crate::output::ConfidenceKind;
use crate::{DepthOptions, MemoryLimit, VamvsError};

/// Pixels of a photograph, along a side, for one of a depth map.
const STRIDE: usize = 4;

/// The network, and the hash of its weights.
pub struct VisCorr {
    network: Network,
    weights: blake3::Hash,
    /// Where it runs, if not on the processor.
    #[cfg(feature = "gpu")]
    gpu: Option<vamvs_gpu::Network>,
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
                return Ok(Self {
                    network,
                    weights: blake3::hash(bytes),
                    #[cfg(feature = "gpu")]
                    gpu: None,
                });
            }
        };
        Err(VamvsError::Request(format!(
            "the network {} cannot make {wrong}; use vis-max (--weights)",
            name.display()
        )))
    }

    /// The network on a GPU.
    #[cfg(feature = "gpu")]
    pub(super) fn on_gpu(self, gpu: vamvs_gpu::Gpu) -> Result<Self, VamvsError> {
        let gpu = vamvs_gpu::Network::new(gpu, &self.network)?;
        Ok(Self { gpu: Some(gpu), ..self })
    }

    pub(super) fn name(&self) -> String {
        let name = &self.network.manifest().name;
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return format!("network {name} on {}", gpu.gpu().adapter());
        }
        format!("network {name} on cpu")
    }

    pub(super) fn is_on_gpu(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.gpu.is_some();
        #[cfg(not(feature = "gpu"))]
        false
    }

    /// The GPU, as refinement uses it.
    pub(super) fn matching(&self) -> Option<&dyn vamvs_refine::matching::Device> {
        #[cfg(feature = "gpu")]
        return self.gpu.as_ref().map(|network| network.gpu() as &dyn vamvs_refine::matching::Device);
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// The process's memory, or the largest piece of a GPU's.
    pub(super) fn memory(&self, limit: MemoryLimit) -> MethodMemory {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return MethodMemory::of_pieces(gpu.gpu().adapter().largest_buffer, limit);
        }
        MethodMemory::of_process(limit)
    }

    pub(super) fn plane_step(&self) -> f64 {
        self.network.manifest().plane_step
    }

    /// The hash of its weights, and whether a GPU runs it, whose sums are other ones.
    pub(super) fn identity(&self) -> String {
        let place = if self.is_on_gpu() { "on a GPU, refined there" } else { "in Rust" };
        format!("{} {place}", self.weights)
    }

    pub(super) fn confidence(&self) -> ConfidenceKind {
        let calibrated = |map: &MonotoneMap| ConfidenceKind::Calibrated(map.clone());
        self.network.calibration().map_or(ConfidenceKind::Probability, calibrated)
    }

    pub(super) fn refined_calibration(&self) -> Option<&MonotoneMap> {
        self.network.manifest().refined_calibration.as_ref()
    }

    pub(super) fn peak_bytes(&self, photograph: vamvs_core::Size, views: usize, planes: usize) -> u64 {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return gpu.largest_piece(photograph, planes) as u64;
        }
        self.network.peak_bytes(photograph, views, planes) as u64
    }

    pub(super) fn encode(&self, photo: &Photo, clock: &mut Clock) -> Result<Features, VamvsError> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return Ok(Features::Gpu(Box::new(clock.time("encode", || gpu.encode(photo))?)));
        }
        Ok(Features::VisCorr(Box::new(clock.time("encode", || self.network.encode(photo))?)))
    }

    pub(super) fn estimate(&self, task: &Task<'_>, clock: &mut Clock) -> Result<Estimated, VamvsError> {
        let mut time = |stage, run: &mut dyn FnMut()| {
            let name = match stage {
                Stage::Sweep => "sweep",
                Stage::Regularize => "regularize",
            };
            clock.time(name, run);
        };
        let Task { reference, sources, plan, region } = task;
        let camera = reference.photo.camera;
        let around = region.map(|region| widened(region, camera.size));
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            let sources: Vec<_> = sources.iter().map(|source| features_on_gpu(source)).collect();
            let whole = features_on_gpu(reference);
            let part = around.map(|around| whole.cropped(gpu.gpu(), &around)).transpose()?;
            let (used, place) = part.as_ref().map_or((whole, None), |(part, place)| (part, Some(*place)));
            let estimate = gpu.estimate(used, &sources, &plan.planes, &mut time)?;
            return Ok(put(estimate, camera, place.zip(*region)));
        }
        let sources: Vec<&EncodedView> = sources.iter().map(|source| features(source)).collect();
        let whole = features(reference);
        let part = around.map(|around| whole.cropped(&around)).transpose()?;
        let (used, place) = part.as_ref().map_or((whole, None), |(part, place)| (part, Some(*place)));
        let estimate = self.network.estimate(used, &sources, &plan.planes, &mut time)?;
        Ok(put(estimate, camera, place.zip(*region)))
    }
}

/// The result in a map of the whole photograph, if it is that of a part of it: where that lies, and the region that is wanted.
fn put(estimate: Estimate, camera: Pinhole, part: Option<(PixelBox, PixelBox)>) -> Estimated {
    let Some((place, region)) = part else { return (vec![estimate.map], estimate.visibility) };
    let placed_seen = |seen| placed_visibility(seen, (place, STRIDE), camera.size);
    let seen = estimate.visibility.iter().map(placed_seen).collect();
    (vec![placed(&estimate.map, camera, place, region)], seen)
}

fn features(view: &Encoded) -> &EncodedView {
    match &view.features {
        Features::VisCorr(features) => features,
        _ => unreachable!("vis-corr encodes every photograph that it is given"),
    }
}

#[cfg(feature = "gpu")]
fn features_on_gpu(view: &Encoded) -> &vamvs_gpu::EncodedView {
    match &view.features {
        Features::Gpu(features) => features,
        _ => unreachable!("vis-corr encodes every photograph that it is given"),
    }
}
