//! DTU's protocol (Jensen et al. 2014, Aanæs et al. 2016), after the benchmark's MATLAB code.
//!
//! 1. The cloud is thinned so that no two points are within 0.2 mm (`reducePts_haa.m`, [`crate::thin()`]).
//!    The reference scan is distributed already thinned like this.
//! 2. The distance is taken from each point to the nearest point of the other set (`MaxDistCP.m`), except
//!    for points outside of the blocks of 60 mm that cover the bounding box, beginning at its lower corner.
//! 3. *Accuracy* is taken over the cloud's points in the observability mask, *completeness* over the scan's
//!    points strictly above the ground plane (`PointCompareMain.m`). The points left out by these two
//!    conditions still serve as nearest neighbours.
//! 4. Mean and median are over the distances below 20 mm (`ComputeStat_web.m`). The *overall* score is the
//!    mean of both directions (Yao et al. 2018).
//!
//! MATLAB draws another random order of thinning in each run; ours is drawn from a seed.

use crate::VoxelMask;
use serde::Serialize;

use crate::nearest::nearest_distances;
use crate::stats::Spread;
use crate::{TooFine, thin};

/// The side of the blocks in which `MaxDistCP.m` looks for neighbours, mm.
const BLOCK: f64 = 60.0;

/// The protocol for one scan.
#[derive(Clone, Debug, PartialEq)]
pub struct DtuProtocol {
    /// The observability mask: `ObsMask`, `BB` and `Res` of `ObsMask{scan}_10.mat`.
    pub mask: VoxelMask,
    /// The ground plane, `P` of `Plane{scan}.mat`: points with `P · (x, y, z, 1) > 0` are above it.
    pub ground: [f64; 4],
    /// Minimum distance between points of the thinned cloud, mm; the benchmark's is 0.2. 0 means no
    /// thinning.
    pub spacing: f64,
    /// Distances of at least this are outliers, mm; the benchmark's limit is 20.
    pub max_distance: f64,
    /// The seed of the random order of thinning.
    pub seed: u64,
}

/// The scores of one scan, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DtuScores {
    /// Number of points of the cloud after thinning.
    pub thinned: usize,
    /// Distances from the cloud to the scan.
    pub accuracy: Spread,
    /// Distances from the scan to the cloud.
    pub completeness: Spread,
    /// The mean of the means of accuracy and completeness.
    pub overall: f64,
    /// The mean of the medians of accuracy and completeness.
    pub overall_median: f64,
}

impl DtuProtocol {
    /// The protocol with the benchmark's distances.
    #[must_use]
    pub fn new(mask: VoxelMask, ground: [f64; 4]) -> Self {
        Self { mask, ground, spacing: 0.2, max_distance: 20.0, seed: 0 }
    }

    /// Evaluates a cloud against the reference scan. Both must be finite and in mm.
    ///
    /// # Errors
    /// If the cloud is too large to be thinned.
    pub fn scores(&self, cloud: &[[f64; 3]], scan: &[[f64; 3]]) -> Result<DtuScores, TooFine> {
        let thinned = if self.spacing > 0.0 { thin(cloud, self.spacing, self.seed)? } else { cloud.to_vec() };
        let accuracy = self.spread(&thinned, scan, |x| self.mask.contains(x));
        let completeness = self.spread(scan, &thinned, |x| self.is_above_ground(x));
        Ok(DtuScores {
            thinned: thinned.len(),
            accuracy,
            completeness,
            overall: 0.5 * (accuracy.mean + completeness.mean),
            overall_median: 0.5 * (accuracy.median + completeness.median),
        })
    }

    /// The distances below the maximum, from the points of `from` that satisfy `counts` to the nearest
    /// points of `to`.
    fn spread(&self, from: &[[f64; 3]], to: &[[f64; 3]], counts: impl Fn(&[f64; 3]) -> bool) -> Spread {
        let from: Vec<_> = from.iter().filter(|x| counts(x) && self.is_in_blocks(x)).copied().collect();
        let near = |distance: &f64| *distance < self.max_distance;
        Spread::of(nearest_distances(&from, to).into_iter().filter(near).collect())
    }

    fn is_above_ground(&self, [x, y, z]: &[f64; 3]) -> bool {
        let [a, b, c, d] = self.ground;
        a * x + b * y + c * z + d > 0.0
    }

    fn is_in_blocks(&self, x: &[f64; 3]) -> bool {
        let VoxelMask { low, high, .. } = &self.mask;
        (0..3).all(|axis| {
            let blocks = ((high[axis] - low[axis]) / BLOCK).floor() + 1.0;
            (0.0..blocks * BLOCK).contains(&(x[axis] - low[axis]))
        })
    }
}
