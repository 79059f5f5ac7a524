//! The hash of all that makes a depth map: equal hashes, equal maps.

use std::path::Path;

use vamvs_core::{Scene, View};
use vamvs_io::IoError;
use vamvs_net::EstimatorOptions;

use crate::{Photographs, VamvsError, ViewPlan};

/// Changes whenever the same inputs give other depth maps.
const PIPELINE_VERSION: u32 = 2;

/// Hashes what makes each view's depth map.
pub struct Identity {
    common: String,
    /// For each view, the hash of its photograph, mask, camera and pose.
    views: Vec<blake3::Hash>,
}

impl Identity {
    /// Hashes the module, the options and every photograph.
    pub fn new(
        module: &[u8],
        options: &EstimatorOptions,
        scene: &Scene,
        photographs: &Photographs,
    ) -> Result<Self, VamvsError> {
        use rayon::prelude::*;
        // Slabs and strips bound the memory and change nothing of the result.
        let common = format!("{PIPELINE_VERSION} {} {:?}", blake3::hash(module), options.iterations);
        let views =
            scene.views.par_iter().map(|view| hash_view(view, photographs)).collect::<Result<_, _>>()?;
        Ok(Self { common, views })
    }

    /// The hash of what makes the depth map of `view` by `plan`, of photographs reduced to `max_size` pixels.
    pub fn of(&self, view: usize, plan: &ViewPlan, max_size: usize) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{} {max_size}", self.common).as_bytes());
        hasher.update(format!("{:?} {:?} {}", plan.planes, plan.region, plan.foveated).as_bytes());
        for view in std::iter::once(view).chain(plan.sources.iter().copied()) {
            hasher.update(self.views[view].as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }
}

fn hash_view(view: &View, photographs: &Photographs) -> Result<blake3::Hash, VamvsError> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{:?} {:?}", view.camera, view.cam_from_world).as_bytes());
    hash_file(&mut hasher, &photographs.path(view))?;
    if let Some(mask) = photographs.mask_path(view) {
        hash_file(&mut hasher, &mask)?;
    }
    Ok(hasher.finalize())
}

fn hash_file(hasher: &mut blake3::Hasher, path: &Path) -> Result<(), VamvsError> {
    let failed = |source| IoError::System { action: "read", path: path.to_owned(), source };
    let file = std::fs::File::open(path).map_err(failed)?;
    hasher.update_reader(file).map_err(failed)?;
    Ok(())
}
