//! How well a cloud agrees with points of the true surface.
//!
//! Precision and recall are those of Tanks and Temples (Knapitsch et al. 2017), the mean distances the
//! accuracy and completeness of DTU (Aanæs et al. 2016), without its cap on outliers.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use serde::Serialize;

/// Agreement of a cloud with truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// The share of the cloud's points within the threshold of a true point, 0 to 1.
    pub precision: f64,
    /// The share of true points within the threshold of a point of the cloud, 0 to 1.
    pub recall: f64,
    /// The harmonic mean of both, 0 to 1.
    pub f_score: f64,
    /// The mean distance from a point of the cloud to the nearest true one, scene units; infinite if
    /// there is none.
    pub accuracy_mean: f64,
    /// The mean distance from a true point to the nearest of the cloud, scene units; infinite if there
    /// is none.
    pub completeness_mean: f64,
}

/// Compares the positions of a cloud with true points; both in the same world, in scene units, finite.
/// An empty cloud, or no truth, scores 0.
#[must_use]
pub fn compare_clouds(cloud: &[[f64; 3]], truth: &[[f64; 3]], threshold: f64) -> Agreement {
    let (precision, accuracy_mean) = near_share_and_mean(&nearest_distances(cloud, truth), threshold);
    let (recall, completeness_mean) = near_share_and_mean(&nearest_distances(truth, cloud), threshold);
    let sum = precision + recall;
    let f_score = if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 };
    Agreement { precision, recall, f_score, accuracy_mean, completeness_mean }
}

/// The distance from each point of `from` to the nearest of `to`; infinite if `to` is empty.
#[must_use]
pub fn nearest_distances(from: &[[f64; 3]], to: &[[f64; 3]]) -> Vec<f64> {
    let tree = match ImmutableKdTree::<f64, 3>::new_from_slice(to) {
        Ok(tree) if !to.is_empty() => tree,
        _ => return vec![f64::INFINITY; from.len()],
    };
    let squared = |x: &[f64; 3]| tree.query(x).nearest_one::<SquaredEuclidean<f64>>().execute().distance;
    from.par_iter().map(|x| squared(x).sqrt()).collect()
}

fn near_share_and_mean(distances: &[f64], threshold: f64) -> (f64, f64) {
    if distances.is_empty() {
        return (0.0, f64::INFINITY);
    }
    let count = distances.len() as f64;
    let near = distances.iter().filter(|&&distance| distance <= threshold).count();
    (near as f64 / count, distances.iter().sum::<f64>() / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 20 × 20 points, 1 apart, at height z.
    fn square(z: f64) -> Vec<[f64; 3]> {
        (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), z]).collect()
    }

    /// Pseudo-random points in the unit cube.
    fn scattered(count: u64, seed: u64) -> Vec<[f64; 3]> {
        let random = |i: u64| {
            let mut h =
                (i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ seed.wrapping_mul(0xD1B5_4A32_D192_ED03);
            h ^= h >> 31;
            h = h.wrapping_mul(0xBF58_476D_1CE4_E5B9);
            ((h ^ (h >> 29)) >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..count).map(|i| [random(3 * i), random(3 * i + 1), random(3 * i + 2)]).collect()
    }

    #[test]
    fn distances_equal_brute_force() {
        let (from, to) = (scattered(300, 1), scattered(500, 2));
        for (x, found) in from.iter().zip(nearest_distances(&from, &to)) {
            let squared = |y: &[f64; 3]| (0..3).map(|i| (x[i] - y[i]).powi(2)).sum::<f64>();
            let expected = to.iter().map(squared).fold(f64::INFINITY, f64::min).sqrt();
            assert!((found - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn distances_are_exact_far_from_the_origin_and_among_equal_coordinates() {
        let far = |z: f64| square(z).iter().map(|x| [x[0] + 4.5e5, x[1] + 5.4e6, x[2]]).collect::<Vec<_>>();
        for distance in nearest_distances(&far(0.25), &far(0.0)) {
            assert!((distance - 0.25).abs() < 1e-9);
        }
    }

    #[test]
    fn a_shifted_cloud_is_all_within_or_all_without_the_threshold() {
        let (cloud, truth) = (square(0.1), square(0.0));
        let within = compare_clouds(&cloud, &truth, 0.11);
        assert_eq!((within.precision, within.recall, within.f_score), (1.0, 1.0, 1.0));
        assert!((within.accuracy_mean - 0.1).abs() < 1e-9 && (within.completeness_mean - 0.1).abs() < 1e-9);
        let without = compare_clouds(&cloud, &truth, 0.09);
        assert_eq!((without.precision, without.recall, without.f_score), (0.0, 0.0, 0.0));
    }

    #[test]
    fn outliers_cost_precision_and_holes_cost_recall() {
        let truth = square(0.0);
        let mut cloud = truth[..100].to_vec();
        cloud.extend((0..25).map(|i| [f64::from(i), 0.0, 30.0 + f64::from(i)]));
        let agreement = compare_clouds(&cloud, &truth, 0.5);
        assert_eq!(agreement.precision, 0.8);
        assert_eq!(agreement.recall, 0.25);
        assert!((agreement.f_score - 2.0 * 0.8 * 0.25 / 1.05).abs() < 1e-12);
        // Rows 5 to 19 are 1 to 15 away from row 4.
        assert!((agreement.completeness_mean - 20.0 * 120.0 / 400.0).abs() < 1e-9);
    }

    #[test]
    fn nothing_scores_nothing() {
        for (cloud, truth) in [(vec![], square(0.0)), (square(0.0), vec![]), (vec![], vec![])] {
            let agreement = compare_clouds(&cloud, &truth, 1.0);
            assert_eq!((agreement.precision, agreement.recall, agreement.f_score), (0.0, 0.0, 0.0));
            assert_eq!(agreement.accuracy_mean, f64::INFINITY);
        }
    }
}
