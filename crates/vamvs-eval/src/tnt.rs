//! The protocol of Tanks and Temples (Knapitsch et al. 2017, section 4), after the benchmark's toolbox
//! (`python_toolbox/evaluation`).
//!
//! 1. The cloud is brought into the frame of the ground truth by a given alignment, which the toolbox finds
//!    from camera positions, and which [`TntProtocol::refined`] improves on the clouds themselves (`run.py`).
//! 2. Cloud and ground truth are cut by the scene's volume and thinned to the means of voxels of τ / 2
//!    (`EvaluateHisto`).
//! 3. *Precision* is the share of the cloud's points nearer than τ to the ground truth, *recall* that of the ground truth's
//!    points nearer than τ to the cloud.

use serde::Serialize;
use vamvs_core::Similarity;

use crate::CropVolume;

use crate::cloud::{Agreement, CloudDistances};
use crate::icp::{Icp, transformed};
use crate::{TooFine, voxel_means};

/// Points above which the last refinement takes every so many-th only (`MAX_POINT_NUMBER`).
const MANY: usize = 4_000_000;

/// Most steps of a refinement. The toolbox asks for 20, but hands the number to Open3D in the place of a limit
/// of errors, so that Open3D's own 30 hold, and that it ends as soon as the share of points with a partner
/// settles; ours goes on until their distances settle too.
const STEPS: usize = 30;

/// What a scene is measured by.
#[derive(Clone, Debug, PartialEq)]
pub struct TntProtocol {
    /// The scene's threshold τ, units of the ground truth.
    pub tau: f64,
    /// The part of the ground truth's frame that counts; `None` for all.
    pub crop: Option<CropVolume>,
    /// The alignment.
    pub ground_truth_from_cloud: Similarity,
}

/// A scene's measures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TntScores {
    /// Points of the cloud after cutting and thinning.
    pub cloud_points: usize,
    /// Points of the ground truth after cutting and thinning.
    pub ground_truth_points: usize,
    /// Precision, recall and F-score at τ.
    #[serde(flatten)]
    pub agreement: Agreement,
    /// The alignment that was used.
    pub ground_truth_from_cloud: Similarity,
}

impl TntProtocol {
    /// The protocol with its alignment improved on the clouds in the toolbox's three steps, coarse to fine.
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

    /// Measures a cloud against the ground truth; both finite.
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

    /// `source` is in the ground truth's frame already, by the alignment so far.
    fn align(&mut self, source: &[[f64; 3]], target: &[[f64; 3]], radius: f64) {
        let better = Icp { radius, steps: STEPS }.refined(source, target, &Similarity::identity());
        self.ground_truth_from_cloud = better.compose(&self.ground_truth_from_cloud);
    }
}

/// At most about so many points as [`MANY`], evenly from the whole.
fn some(cloud: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let step = (cloud.len() as f64 / MANY as f64).round().max(1.0) as usize;
    cloud.into_iter().step_by(step).collect()
}
