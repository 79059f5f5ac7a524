//! The fronto-parallel planes of a sweep, and the coordinate along them.
//!
//! A surface's place along a viewing ray is told in *planes*: coordinate u = 0 is the nearest plane,
//! `count − 1` the farthest, and one unit is one plane distance (the paper's d). Hypotheses, flow and
//! losses live in this coordinate, so that they mean the same for every scene scale and for both
//! spacings.

use serde::{Deserialize, Serialize};

use crate::DepthRange;

/// What is uniform between the planes of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spacing {
    /// Equal steps of depth (section 3.1).
    Depth,
    /// Equal steps of inverse depth: equal steps of disparity, for wide ranges.
    InverseDepth,
}

/// The planes of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Planes {
    /// Depths of the first and the last plane.
    pub range: DepthRange,
    /// Number of planes, at least 2.
    pub count: usize,
    /// What is uniform between them.
    pub spacing: Spacing,
}

impl Planes {
    /// Depth at plane coordinate `u`, which may lie a little outside of `[0, count − 1]`.
    #[must_use]
    pub fn depth(&self, u: f64) -> f64 {
        let t = u / (self.count - 1) as f64;
        let DepthRange { near, far } = self.range;
        match self.spacing {
            Spacing::Depth => near + t * (far - near),
            Spacing::InverseDepth => 1.0 / (1.0 / near + t * (1.0 / far - 1.0 / near)),
        }
    }

    /// Plane coordinate of a depth: the inverse of [`Planes::depth`].
    #[must_use]
    pub fn coordinate(&self, depth: f64) -> f64 {
        let DepthRange { near, far } = self.range;
        let t = match self.spacing {
            Spacing::Depth => (depth - near) / (far - near),
            Spacing::InverseDepth => (1.0 / depth - 1.0 / near) / (1.0 / far - 1.0 / near),
        };
        t * (self.count - 1) as f64
    }

    /// The depths of all planes, nearest first.
    #[must_use]
    pub fn depths(&self) -> Vec<f64> {
        (0..self.count).map(|i| self.depth(i as f64)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_spacings_begin_near_end_far_and_invert() {
        for spacing in [Spacing::Depth, Spacing::InverseDepth] {
            let planes = Planes { range: DepthRange { near: 2.0, far: 10.0 }, count: 17, spacing };
            let depths = planes.depths();
            assert!((depths[0] - 2.0).abs() < 1e-12 && (depths[16] - 10.0).abs() < 1e-12);
            assert!(depths.windows(2).all(|pair| pair[0] < pair[1]));
            for u in [-0.5, 0.0, 3.25, 16.0] {
                assert!((planes.coordinate(planes.depth(u)) - u).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn the_middle_is_the_arithmetic_or_the_harmonic_mean() {
        let range = DepthRange { near: 2.0, far: 6.0 };
        assert!((Planes { range, count: 3, spacing: Spacing::Depth }.depth(1.0) - 4.0).abs() < 1e-12);
        assert!((Planes { range, count: 3, spacing: Spacing::InverseDepth }.depth(1.0) - 3.0).abs() < 1e-12);
    }
}
