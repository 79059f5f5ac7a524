//! Iterative closest point (Besl & McKay 1992) with scale: aligns a cloud with another.

use nalgebra::Vector3;
use vamvs_core::Similarity;

use crate::nearest::{Nearest, Neighbours};

/// ICP stops when the share of points with a partner, and the root mean square of the partners' distances in
/// units of the radius, change by less than this from step to step.
const SETTLED: f64 = 1e-6;

/// Settings of the alignment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Icp {
    /// Largest distance between a point and its partner, target units.
    pub radius: f64,
    /// Most steps.
    pub steps: usize,
}

impl Icp {
    /// Refines `target_from_source` step by step. In a step, each transformed source point takes the nearest
    /// target point as its partner, and the transform becomes the least-squares fit to these pairs. If no
    /// point has a partner, or all partners are the same point, the transform stays as it is.
    #[must_use]
    pub fn refined(
        &self,
        source: &[[f64; 3]],
        target: &[[f64; 3]],
        target_from_source: &Similarity,
    ) -> Similarity {
        let neighbours = Neighbours::new(target);
        let mut transform = *target_from_source;
        let mut before = (f64::INFINITY, f64::INFINITY);
        for _ in 0..self.steps {
            let pairs = self.pairs(source, (target, &neighbours), &transform);
            let now = (pairs.len() as f64 / source.len() as f64, rms(&pairs, &transform) / self.radius);
            if (now.0 - before.0).abs() < SETTLED && (now.1 - before.1).abs() < SETTLED {
                break;
            }
            before = now;
            let Some(better) = Similarity::fit(&pairs) else { break };
            transform = better;
        }
        transform
    }

    /// The source points that have a partner, with their partners.
    fn pairs(
        &self,
        source: &[[f64; 3]],
        (target, neighbours): (&[[f64; 3]], &Neighbours),
        target_from_source: &Similarity,
    ) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let nearest = neighbours.nearest(&transformed(source, target_from_source));
        let pair = |(x, nearest): (&[f64; 3], Nearest)| {
            let partner = || (Vector3::from(*x), Vector3::from(target[nearest.point as usize]));
            (nearest.distance < self.radius).then(partner)
        };
        source.iter().zip(nearest).filter_map(pair).collect()
    }
}

/// The root mean square distance of pairs.
fn rms(pairs: &[(Vector3<f64>, Vector3<f64>)], target_from_source: &Similarity) -> f64 {
    let squared = pairs.iter().map(|(src, dst)| (target_from_source.transform(src) - dst).norm_squared());
    (squared.sum::<f64>() / pairs.len() as f64).sqrt()
}

/// The points of a cloud after a transform.
#[must_use]
pub fn transformed(cloud: &[[f64; 3]], transform: &Similarity) -> Vec<[f64; 3]> {
    cloud.iter().map(|x| transform.transform(&Vector3::from(*x)).into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// A bumpy surface, no part of which looks like another.
    fn surface() -> Vec<[f64; 3]> {
        let point = |i: u32| {
            let (x, y) = (f64::from(i % 60) / 10.0, f64::from(i / 60) / 10.0);
            [x, y, (1.3 * x).sin() * (0.9 * y).cos() + 0.05 * x * y]
        };
        (0..3600).map(point).collect()
    }

    #[test]
    fn a_cloud_that_was_turned_shifted_and_scaled_comes_back() {
        let target = surface();
        let moved = Similarity {
            scale: 1.03,
            rotation: Rotation3::from_euler_angles(0.02, -0.03, 0.04).into_inner(),
            translation: Vector3::new(0.1, -0.05, 0.08),
        };
        let source = transformed(&target, &moved);
        let icp = Icp { radius: 1.0, steps: 200 };
        let target_from_source = icp.refined(&source, &target, &Similarity::identity());
        let errors = transformed(&source, &target_from_source);
        let worst = errors.iter().zip(&target).map(|(a, b)| (Vector3::from(*a) - Vector3::from(*b)).norm());
        assert!(worst.fold(0.0, f64::max) < 1e-6);
        assert!((target_from_source.scale * 1.03 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn points_without_partners_change_nothing() {
        let start = Similarity { translation: Vector3::new(100.0, 0.0, 0.0), ..Similarity::identity() };
        let icp = Icp { radius: 0.5, steps: 5 };
        assert_eq!(icp.refined(&surface(), &surface(), &start), start);
        assert_eq!(icp.refined(&[], &[], &start), start);
    }
}
