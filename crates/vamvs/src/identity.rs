//! The hash of all that makes a depth map: equal hashes, equal maps.

use std::sync::OnceLock;

use rayon::prelude::*;
use vamvs_core::{Scene, View};
use vamvs_net::EstimatorOptions;
use vamvs_refine::RefineOptions;

use crate::{Photographs, Prepared, ViewPlan};

/// Changes whenever the same inputs give other depth maps.
const PIPELINE_VERSION: u32 = 6;

/// Hashes what makes each view's depth map.
pub struct Identity<'a> {
    common: String,
    scene: &'a Scene,
    /// For each view, the hash of its photograph, mask, camera and pose, once it was asked for.
    views: Vec<OnceLock<blake3::Hash>>,
}

impl<'a> Identity<'a> {
    /// Hashes the module and how the estimator uses it. A photograph is hashed when a depth map that it makes has its
    /// turn, and only once.
    pub fn new(work: &'a Prepared) -> Self {
        let Prepared { scene, estimator, module, .. } = work;
        // Slabs and strips bound the memory and change nothing of the result.
        let coarse_stride = estimator.network().manifest().coarse_stride;
        let EstimatorOptions { iterations, completion, guide, slab_bytes: _, strip_points: _ } =
            estimator.options();
        let common =
            format!("{PIPELINE_VERSION} {module} {coarse_stride} {iterations:?} {completion:?} {guide:?}");
        Self { common, scene, views: vec![OnceLock::new(); scene.views.len()] }
    }

    /// The hash of what makes the depth map of `view` by `plan`, of photographs of the size that `photographs` have, and
    /// how it is refined, if it is.
    pub fn of(
        &self,
        view: usize,
        plan: &ViewPlan,
        photographs: &Photographs,
        refined: Option<&RefineOptions>,
    ) -> String {
        let mut hasher = blake3::Hasher::new();
        let (max_size, enlarge) = (photographs.max_size(), photographs.enlarge());
        let sized = format!("{} {max_size} {enlarge} {:?}", self.common, photographs.brightness());
        hasher.update(sized.as_bytes());
        if let Some(options) = refined {
            hasher.update(format!("{} {options:?}", photographs.full_size()).as_bytes());
        }
        hasher.update(format!("{:?} {:?} {}", plan.planes, plan.region, plan.foveated).as_bytes());
        let views: Vec<usize> = std::iter::once(view).chain(plan.sources.iter().copied()).collect();
        let hashes: Vec<blake3::Hash> = views.par_iter().map(|&view| self.hash(view, photographs)).collect();
        for hash in hashes {
            hasher.update(hash.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// A photograph that cannot be read has a hash too: its view is left out when its turn comes.
    fn hash(&self, view: usize, photographs: &Photographs) -> blake3::Hash {
        *self.views[view].get_or_init(|| hash_view(&self.scene.views[view], photographs))
    }
}

fn hash_view(view: &View, photographs: &Photographs) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{:?} {:?}", view.camera, view.cam_from_world).as_bytes());
    photographs.hash(view, &mut hasher);
    hasher.finalize()
}
