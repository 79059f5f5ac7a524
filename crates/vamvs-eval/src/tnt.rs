//! The protocol of Tanks and Temples (Knapitsch et al. 2017, section 4), after the benchmark's toolbox
//! (`python_toolbox/evaluation`).
//!
//! 1. The cloud is brought into the frame of the ground truth by a given alignment, which the toolbox finds from
//!    camera positions. [`TntProtocol::refined`] refines it by ICP between the two clouds (`run.py`).
//! 2. Cloud and ground truth are cropped to the scene's volume and thinned to the means of voxels of τ / 2
//!    (`EvaluateHisto`).
//! 3. *Precision* is the share of the cloud's points that are nearer than τ to the ground truth, *recall* the share
//!    of the ground truth's points that are nearer than τ to the cloud.

use serde::Serialize;
use vamvs_core::Similarity;

use crate::CropVolume;

use crate::cloud::{Agreement, CloudDistances};
use crate::icp::{Icp, transformed};
use crate::{TooFine, voxel_means};

/// Number of points to which the last refinement subsamples larger clouds, approximately (`MAX_POINT_NUMBER`).
const MANY: usize = 4_000_000;

/// Most steps of one ICP refinement. The toolbox passes its limit of 20 as Open3D's error criterion instead of the
/// number of steps. So Open3D's default of 30 steps applies, and the toolbox stops as soon as the share of points
/// with a partner settles. We go on until the distances to the partners settle, too.
const STEPS: usize = 30;

/// The protocol for one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct TntProtocol {
    /// The scene's threshold τ, units of the ground truth.
    pub tau: f64,
    /// The volume, in the frame of the ground truth, that is evaluated; `None` for all.
    pub crop: Option<CropVolume>,
    /// The alignment of the cloud with the ground truth.
    pub ground_truth_from_cloud: Similarity,
}

/// The scores of one scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TntScores {
    /// Number of points of the cloud after cropping and thinning.
    pub cloud_points: usize,
    /// Number of points of the ground truth after cropping and thinning.
    pub ground_truth_points: usize,
    /// Precision, recall and F-score at τ.
    #[serde(flatten)]
    pub agreement: Agreement,
    /// The alignment that was used.
    pub ground_truth_from_cloud: Similarity,
}

impl TntProtocol {
    /// The protocol with its alignment refined by ICP between cloud and ground truth, in the toolbox's three steps
    /// from coarse to fine.
    ///
    /// # Errors
    /// If a cloud is too large to be thinned.
    pub fn refined(mut self, cloud: &[[f64; 3]], ground_truth: &[[f64; 3]]) -> Result<Self, TooFine> {
        let cut_truth = self.cut(ground_truth.to_vec());
        for (voxel, radius) in [(1.0, 80.0), (0.5, 20.0)] {
            let source =
                voxel_means(&self.cut(transformed(cloud, &self.ground_truth_from_cloud)), voxel * self.tau)?;
            let target = voxel_means(&cut_truth, voxel * self.tau)?;
            self.align(&source, &target, radius * self.tau);
        }
        let source = some(self.cut(transformed(cloud, &self.ground_truth_from_cloud)));
        self.align(&source, &some(cut_truth), 2.0 * self.tau);
        Ok(self)
    }

    /// Evaluates a cloud against the ground truth. All points must be finite.
    ///
    /// # Errors
    /// If a cloud is too large to be thinned.
    pub fn scores(&self, cloud: &[[f64; 3]], ground_truth: &[[f64; 3]]) -> Result<TntScores, TooFine> {
        let thinned = |cloud| voxel_means(&self.cut(cloud), 0.5 * self.tau);
        let cloud = thinned(transformed(cloud, &self.ground_truth_from_cloud))?;
        let ground_truth = thinned(ground_truth.to_vec())?;
        Ok(TntScores {
            cloud_points: cloud.len(),
            ground_truth_points: ground_truth.len(),
            agreement: CloudDistances::between(&cloud, &ground_truth).agreement(self.tau),
            ground_truth_from_cloud: self.ground_truth_from_cloud,
        })
    }

    fn cut(&self, mut cloud: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        if let Some(volume) = &self.crop {
            cloud.retain(|x| volume.contains(x));
        }
        cloud
    }

    /// Refines the alignment. `source` is already in the frame of the ground truth, by the alignment so far; `radius`
    /// is the largest distance of a pair.
    fn align(&mut self, source: &[[f64; 3]], target: &[[f64; 3]], radius: f64) {
        let better = Icp { radius, steps: STEPS }.refined(source, target, &Similarity::identity());
        self.ground_truth_from_cloud = better.compose(&self.ground_truth_from_cloud);
    }
}

/// Every k-th point of the cloud, with k chosen so that about [`MANY`] remain.
fn some(cloud: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let step = (cloud.len() as f64 / MANY as f64).round().max(1.0) as usize;
    cloud.into_iter().step_by(step).collect()
}
