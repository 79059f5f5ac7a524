//! The confidence of a refined depth: how likely it is right.

/// Correlation above which confidence depends on the photographs alone; below, the seed's confidence is mixed
/// in.
const MATCHED: f32 = 0.5;

/// The share of the seed's confidence that remains if the photographs do not match.
pub(crate) const UNMATCHED: f32 = 0.5;

/// Standard deviation of luminance at which the texture term is half its maximum, grey values.
const TEXTURE: f32 = 4.0;

/// Distance from the seed at which the distance term is half its maximum, pixels of disparity.
const MOVED: f32 = 2.0;

/// Features that separate inliers from outliers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Features {
    /// Mean correlation of the source views that match best, −1 to 1, before planes are smoothed; 0 without texture.
    pub correlation: f32,
    /// Standard deviation of luminance in the window, grey values.
    pub texture: f32,
    /// Distance to the seed, pixels of disparity; −1 where the seed had no depth.
    pub moved: f32,
    /// How likely the depth was right before this refinement, from the seed's confidence; 0 where the seed had no
    /// depth.
    pub seed: f32,
    /// Share of the source views whose own depth maps have the same surface, to one pixel of reprojection error; −1
    /// before [`crate::refine_geometric`].
    pub geometric: f32,
}

/// The likelihood that a depth is right to 1 %: a logistic function of the features, fitted to four views of two
/// rendered scenes. Without correlation it is the seed's confidence.
pub(crate) fn of(features: &Features) -> f32 {
    let matched = (features.correlation / MATCHED).clamp(0.0, 1.0);
    matched * likelihood(features) + (1.0 - matched) * features.seed
}

fn likelihood(features: &Features) -> f32 {
    let Features { correlation, texture, moved, geometric, .. } = *features;
    let near = if moved < 0.0 { 0.0 } else { 1.0 / (1.0 + (moved / MOVED).powi(2)) };
    let known = if geometric < 0.0 { 0.0 } else { 3.0 * (geometric - 0.5) };
    let contrast = texture / (texture + TEXTURE);
    let sum = -0.1 + 4.8 * correlation + 1.7 * near - 3.7 * contrast + known;
    1.0 / (1.0 + (-sum).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Features =
        Features { correlation: 0.95, texture: 15.0, moved: 0.5, seed: 0.35, geometric: -1.0 };

    #[test]
    fn confidence_falls_with_everything_that_speaks_against_a_depth() {
        let good = of(&GOOD);
        assert!(good > 0.9 && good <= 1.0);
        assert!(of(&Features { correlation: 0.4, ..GOOD }) < 0.7 * good);
        assert!(of(&Features { moved: 20.0, ..GOOD }) < good);
        assert!(of(&Features { geometric: 0.0, ..GOOD }) < of(&Features { geometric: 1.0, ..GOOD }));
        let textureless = Features { correlation: 0.0, texture: 0.0, ..GOOD };
        assert!((of(&textureless) - 0.35).abs() < 1e-6);
        assert_eq!(of(&Features { seed: 0.0, moved: -1.0, ..textureless }), 0.0);
    }
}
