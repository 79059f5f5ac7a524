//! The hash of all inputs of a depth map: equal hashes mean equal maps.

use std::sync::OnceLock;

use rayon::prelude::*;
use vamvs_core::Scene;
use vamvs_refine::RefineOptions;

use crate::output::PhotographRecord;
use crate::{OutputFolder, Photographs, Prepared, ViewPlan};

/// Increased whenever a change gives other depth maps for the same inputs.
const PIPELINE_VERSION: u32 = 17;

/// Hashes the inputs of each view's depth map.
pub struct Identity<'a> {
    common: String,
    scene: &'a Scene,
    /// For each view, the hash of its photograph and mask, and their stamp before they were read, once it was needed.
    views: Vec<OnceLock<(blake3::Hash, Option<String>)>>,
    /// Folders whose records may know these hashes, and the views' names there.
    folders: [OutputFolder; 2],
    names: Vec<String>,
}

impl<'a> Identity<'a> {
    /// Hashes what decides the method's depth maps. Each photograph is hashed once, when a
    /// depth map first needs it, and not at all if a record in `folders` has its hash and the file has not changed since.
    pub fn new(work: &'a Prepared, folders: [OutputFolder; 2], names: Vec<String>) -> Self {
        let Prepared { scene, method, .. } = work;
        let common = format!("{PIPELINE_VERSION} {}", method.identity());
        Self { common, scene, views: vec![OnceLock::new(); scene.views.len()], folders, names }
    }

    /// The hash of the inputs of all depth maps, without the contents of the photographs.
    pub fn of_settings(&self, work: &Prepared) -> String {
        let Prepared { scene, photographs, plan, options, .. } = work;
        let sizes = (photographs.max_size(), photographs.full_size(), photographs.enlarge());
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{} {sizes:?} {:?}", self.common, photographs.tones()).as_bytes());
        let steps = (options.refine, options.geometric, options.visibility);
        hasher.update(format!("{steps:?}").as_bytes());
        for (view, plan) in scene.views.iter().zip(&plan.views) {
            hasher.update(format!("{view:?} {plan:?}").as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// The hash of the inputs of the depth map of `view`: its plan, photographs at the size of
    /// `photographs`, and the refinement's options if it is refined.
    pub fn of(
        &self,
        view: usize,
        plan: &ViewPlan,
        photographs: &Photographs,
        refined: Option<&RefineOptions>,
    ) -> String {
        let mut hasher = blake3::Hasher::new();
        let (max_size, enlarge) = (photographs.max_size(), photographs.enlarge());
        let sized = format!("{} {max_size} {enlarge:?} {:?}", self.common, photographs.tones());
        hasher.update(sized.as_bytes());
        if let Some(options) = refined {
            hasher.update(format!("{} {options:?}", photographs.full_size()).as_bytes());
        }
        hasher.update(format!("{:?} {:?} {}", plan.planes, plan.region, plan.foveated).as_bytes());
        let views: Vec<usize> = std::iter::once(view).chain(plan.sources.iter().copied()).collect();
        let hashes: Vec<blake3::Hash> =
            views.par_iter().map(|&view| self.content(view, photographs).0).collect();
        for (&view, hash) in views.iter().zip(hashes) {
            let view = &self.scene.views[view];
            hasher.update(format!("{:?} {:?}", view.camera, view.cam_from_world).as_bytes());
            hasher.update(hash.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// What records say of the photograph of a view; `None` if it is not a file.
    pub fn photograph(&self, view: usize, photographs: &Photographs) -> Option<PhotographRecord> {
        let (hash, stamp) = self.content(view, photographs);
        Some(PhotographRecord { stamp: stamp.clone()?, hash: hash.to_hex().to_string() })
    }

    /// A photograph that cannot be read has a hash too: its view is left out later.
    fn content(&self, view: usize, photographs: &Photographs) -> &(blake3::Hash, Option<String>) {
        self.views[view].get_or_init(|| {
            let scene_view = &self.scene.views[view];
            let stamp = photographs.stamp(scene_view);
            let recorded = stamp.as_ref().and_then(|stamp| self.recorded(view, stamp));
            let hash = recorded.unwrap_or_else(|| {
                let mut hasher = blake3::Hasher::new();
                photographs.hash(scene_view, &mut hasher);
                hasher.finalize()
            });
            (hash, stamp)
        })
    }

    /// The hash in a record of a view, if its photograph has this stamp.
    fn recorded(&self, view: usize, stamp: &str) -> Option<blake3::Hash> {
        self.folders.iter().find_map(|folder| {
            let photograph = folder.saved(&self.names[view])?.photograph?;
            (photograph.stamp == stamp).then(|| photograph.hash.parse().ok()).flatten()
        })
    }
}
