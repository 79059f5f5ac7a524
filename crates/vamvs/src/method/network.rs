//! Depth by a network.

use std::path::Path;

use vamvs_core::MonotoneMap;
use vamvs_net::device::device_name;
use vamvs_net::tch::no_grad;
use vamvs_net::{Device, EncodedView, Estimator, EstimatorOptions, Manifest, Profile, Stage, open_device};

use super::part::{placed, placed_visibility, widened};
use super::{Clock, Estimated, Features, Task};
use crate::fit::MethodMemory;
use crate::method::Encoded;
use crate::output::ConfidenceKind;
use crate::{DepthOptions, MemoryLimit, VamvsError, weights};

/// A network and how it is run.
pub struct NetworkMethod {
    /// The network, and the iterations that are run.
    pub estimator: Estimator,
    /// The hash of its module.
    module: blake3::Hash,
}

impl NetworkMethod {
    /// The network with as many iterations as the options ask for.
    pub(super) fn new(
        weights: Option<&Path>,
        device: Option<&str>,
        depth: &DepthOptions,
    ) -> Result<Self, VamvsError> {
        let device = open_device(device.unwrap_or("auto"))?;
        let mut network = weights::load(weights, device)?;
        if let Some(coarse_stride) = depth.coarse_stride {
            network.set_coarse_stride(coarse_stride)?;
        }
        let mut options = EstimatorOptions::of(&network);
        let available = options.iterations.len();
        if let Some(wanted) = depth.iterations.filter(|&wanted| wanted > available) {
            let name = &network.manifest().name;
            return Err(VamvsError::Request(format!(
                "{wanted} iterations are asked for, but the network {name} has {available} (--iterations)"
            )));
        }
        let Manifest { name, aggregation, .. } = network.manifest();
        if depth.visibility && !aggregation.weighs_views() {
            return Err(VamvsError::Request(format!(
                "the network {name} predicts no visibility (--visibility): use vis-corr, or a network of the aggregation vis-var"
            )));
        }
        if depth.visibility && depth.fovea {
            let problem = "foveated depth maps (--fovea) are made without visibility (--visibility)";
            return Err(VamvsError::Request(problem.to_owned()));
        }
        if depth.fovea && available == 0 {
            return Err(VamvsError::Request(format!(
                "the network {name} has no flow iterations, so nothing is finer in a fovea (--fovea): use vis-max (--weights)"
            )));
        }
        options.iterations.truncate(depth.iterations.unwrap_or(usize::MAX));
        let module = blake3::hash(&weights::bytes(weights)?);
        Ok(Self { estimator: Estimator::new(network, options)?, module })
    }

    pub(super) fn name(&self) -> String {
        let name = &self.estimator.network().manifest().name;
        format!("network {name} on {}", device_name(self.device()))
    }

    pub(super) fn device(&self) -> Device {
        self.estimator.network().device()
    }

    pub(super) fn is_light(&self) -> bool {
        self.estimator.network().manifest().aggregation.correlates()
    }

    pub(super) fn is_cascade(&self) -> bool {
        self.estimator.network().manifest().cascade.is_some()
    }

    pub(super) fn plane_step(&self) -> f64 {
        self.estimator.network().manifest().plane_step
    }

    /// The module's hash, the options of the estimator, and whether a GPU runs it, whose sums are other ones. Slabs and strips limit the memory and do not change the
    /// result.
    pub(super) fn identity(&self) -> String {
        let coarse_stride = self.estimator.network().manifest().coarse_stride;
        let EstimatorOptions { iterations, completion, guide, slab_bytes: _, strip_points: _ } =
            self.estimator.options();
        let gpu = if self.device() == Device::Cpu { "" } else { " on a GPU" };
        format!("{} {coarse_stride} {iterations:?} {completion:?} {guide:?}{gpu}", self.module)
    }

    pub(super) fn confidence(&self) -> ConfidenceKind {
        let calibrated = |map: &MonotoneMap| ConfidenceKind::Calibrated(map.clone());
        self.estimator.calibration().map_or(ConfidenceKind::Probability, calibrated)
    }

    pub(super) fn refined_calibration(&self) -> Option<&MonotoneMap> {
        self.estimator.network().manifest().refined_calibration.as_ref()
    }

    pub(super) fn memory(&self, limit: MemoryLimit) -> MethodMemory {
        MethodMemory::of_device(self.device(), limit)
    }

    pub(super) fn use_smaller_pieces(&mut self, factor: usize) {
        let pieces = self.estimator.options_mut();
        pieces.slab_bytes /= factor;
        pieces.strip_points /= factor;
    }

    pub(super) fn profile(&self) -> Profile {
        Profile::on(self.device())
    }

    pub(super) fn encode(
        &self,
        photo: &vamvs_core::Photo,
        clock: &mut Clock,
    ) -> Result<Features, VamvsError> {
        let encode = || no_grad(|| self.estimator.encode(photo));
        Ok(Features::Network(Box::new(clock.profile.time(Stage::Encode, encode)?)))
    }

    pub(super) fn estimate(&self, task: &Task<'_>, clock: &mut Clock) -> Result<Estimated, VamvsError> {
        let Task { reference, sources, plan, region } = task;
        let (estimator, planes, profile) = (&self.estimator, &plan.planes, &mut clock.profile);
        let sources: Vec<&EncodedView> = sources.iter().map(|source| features(source)).collect();
        let camera = reference.photo.camera;
        Ok(match *region {
            region if plan.foveated => {
                let reference = features(reference);
                let maps = estimator.estimate_foveated(reference, &sources, planes, region, profile)?;
                (maps, Vec::new())
            }
            None => {
                let (map, seen) = estimator.estimate_seen(features(reference), &sources, planes, profile)?;
                (vec![map], seen)
            }
            Some(region) => {
                let (part, place) = features(reference).cropped(&widened(region, camera.size))?;
                let (map, seen) = estimator.estimate_seen(&part, &sources, planes, profile)?;
                let place_and_scale = (place, part.coarse_scale());
                let placed_seen = |seen| placed_visibility(seen, place_and_scale, camera.size);
                let seen = seen.iter().map(placed_seen).collect();
                (vec![placed(&map, camera, place, region)], seen)
            }
        })
    }
}

fn features(view: &Encoded) -> &EncodedView {
    match &view.features {
        Features::Network(features) => features,
        _ => unreachable!("a network encodes every photograph that it is given"),
    }
}
