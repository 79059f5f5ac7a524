//! Errors of a cloud against a ground-truth cloud, in both directions.
//!
//! Distances from the cloud to the ground truth measure its *accuracy*, those from the ground truth to the cloud
//! its *completeness* (Seitz et al. 2006). Precision, recall and F-score at a threshold are those of Tanks and
//! Temples (Knapitsch et al. 2017, section 4).

use serde::Serialize;

use crate::nearest::nearest_distances;
use crate::stats::Spread;

/// The distances between a cloud and the ground truth, scene units.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudDistances {
    /// From each point of the cloud to the nearest ground-truth point; infinite if there is none.
    pub to_ground_truth: Vec<f64>,
    /// From each ground-truth point to the nearest point of the cloud; infinite if there is none.
    pub to_cloud: Vec<f64>,
}

/// Errors of a cloud against ground truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CloudErrors {
    /// Distances from the cloud to the ground truth, scene units.
    pub accuracy: Spread,
    /// Distances from the ground truth to the cloud, scene units.
    pub completeness: Spread,
    /// Precision, recall and F-score at each threshold.
    pub agreement: Vec<Agreement>,
}

/// Precision, recall and F-score at a threshold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// The threshold, scene units.
    pub threshold: f64,
    /// The share of the cloud's points that are nearer than the threshold to a ground-truth point, 0 to 1.
    pub precision: f64,
    /// The share of ground-truth points that are nearer than the threshold to a point of the cloud, 0 to 1.
    pub recall: f64,
    /// The harmonic mean of precision and recall, 0 to 1.
    pub f_score: f64,
}

/// Compares a cloud with a ground-truth cloud. Both must be finite and in the same frame; distances are in scene
/// units.
#[must_use]
pub fn compare_clouds(cloud: &[[f64; 3]], ground_truth: &[[f64; 3]], thresholds: &[f64]) -> CloudErrors {
    CloudDistances::between(cloud, ground_truth).errors(thresholds)
}

impl CloudDistances {
    /// The distances between a cloud and a ground-truth cloud, both ways.
    #[must_use]
    pub fn between(cloud: &[[f64; 3]], ground_truth: &[[f64; 3]]) -> Self {
        Self {
            to_ground_truth: nearest_distances(cloud, ground_truth),
            to_cloud: nearest_distances(ground_truth, cloud),
        }
    }

    /// The errors that the distances amount to.
    #[must_use]
    pub fn errors(&self, thresholds: &[f64]) -> CloudErrors {
        CloudErrors {
            accuracy: Spread::of(self.to_ground_truth.clone()),
            completeness: Spread::of(self.to_cloud.clone()),
            agreement: thresholds.iter().map(|&threshold| self.agreement(threshold)).collect(),
        }
    }

    /// Precision, recall and F-score at one threshold; all are 0 for an empty cloud or empty ground truth.
    #[must_use]
    pub fn agreement(&self, threshold: f64) -> Agreement {
        let (precision, recall) =
            (near_share(&self.to_ground_truth, threshold), near_share(&self.to_cloud, threshold));
        let sum = precision + recall;
        let f_score = if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 };
        Agreement { threshold, precision, recall, f_score }
    }
}

fn near_share(distances: &[f64], threshold: f64) -> f64 {
    let near = distances.iter().filter(|&&distance| distance < threshold).count();
    near as f64 / distances.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 20 × 20 points, 1 apart, at height z.
    fn square(z: f64) -> Vec<[f64; 3]> {
        (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), z]).collect()
    }

    #[test]
    fn a_shifted_cloud_is_all_within_or_all_without_the_threshold() {
        let errors = compare_clouds(&square(0.125), &square(0.0), &[0.13, 0.125, 0.09]);
        let scores: Vec<_> = errors.agreement.iter().map(|a| (a.precision, a.recall, a.f_score)).collect();
        assert_eq!(scores, [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]);
        assert_eq!(errors.accuracy, Spread { count: 400, mean: 0.125, median: 0.125 });
        assert_eq!(errors.completeness, errors.accuracy);
    }

    #[test]
    fn outliers_cost_precision_and_holes_cost_recall() {
        let ground_truth = square(0.0);
        let mut cloud = ground_truth[..100].to_vec();
        cloud.extend((0..25).map(|i| [f64::from(i), 0.0, 30.0 + f64::from(i)]));
        let errors = compare_clouds(&cloud, &ground_truth, &[0.5]);
        let agreement = errors.agreement[0];
        assert_eq!((agreement.precision, agreement.recall), (0.8, 0.25));
        assert!((agreement.f_score - 2.0 * 0.8 * 0.25 / 1.05).abs() < 1e-12);
        // The cloud holds rows 0 to 4. Rows 5 to 19 are 1 to 15 away from row 4.
        assert!((errors.completeness.mean - 20.0 * 120.0 / 400.0).abs() < 1e-9);
        // Rows 0 to 4 have distance 0, each further row has one more: half of the rows are beyond row 9.
        assert_eq!(errors.completeness.median, 5.5);
    }

    #[test]
    fn nothing_scores_nothing() {
        for (cloud, ground_truth) in [(vec![], square(0.0)), (square(0.0), vec![]), (vec![], vec![])] {
            let errors = compare_clouds(&cloud, &ground_truth, &[1.0]);
            let agreement = errors.agreement[0];
            assert_eq!((agreement.precision, agreement.recall, agreement.f_score), (0.0, 0.0, 0.0));
            assert!(!errors.accuracy.mean.is_finite() || !errors.completeness.mean.is_finite());
        }
    }
}
