//! What counts as agreement.

use serde::{Deserialize, Serialize};

/// How it is decided whether other views confirm a pixel: [`FuseOptions::min_support`] or [`FuseOptions::min_views`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Consistency {
    /// Views vote: the closer a view agrees, the larger the triangulation angle and the more confident both views are, the
    /// more its vote counts.
    #[default]
    Dynamic,
    /// Views are counted: enough of them must agree within one threshold.
    Classic,
}

/// Least distance between points of the cloud.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PointSpacing {
    /// In scene units.
    Units(f64),
    /// In pixels of the depth maps: their mean size on the surface.
    Pixels(f64),
}

/// Thresholds of the filters. All of them are relative, so that they fit any scene scale.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct FuseOptions {
    /// How it is decided whether other views confirm a pixel: [`FuseOptions::min_support`] or [`FuseOptions::min_views`].
    pub consistency: Consistency,
    /// Largest distance between a pixel and its projection into a source view and back, pixels of
    /// the depth map.
    pub max_reprojection: f32,
    /// Largest difference between the depth that is projected back and the pixel's own, as a share
    /// of it. A source's depths are interpolated between pixels that differ by less than this.
    pub max_relative_depth: f32,
    /// How many views must agree on a pixel, its own included, 1 to 255.
    pub min_views: usize,
    /// Threshold of the dynamic rule on the sum of votes times the number of source views that
    /// agree. A vote is at most 1: that of a view that agrees exactly and sees the point at a large
    /// angle to the pixel's own ray, if both have full confidence.
    pub min_support: f32,
    /// Weight in the dynamic rule of votes against a pixel, by views that see through its point to
    /// a surface clearly behind it; 0 for none.
    pub contradiction: f32,
    /// The least confidence of the final depth, 0 to 1.
    pub min_confidence: f32,
    /// The least confidence of the coarse stage where a map has one, 0 to 1.
    pub min_coarse_confidence: f32,
    /// Points whose standard deviation along the ray is larger are left out, scene units; those of unknown standard deviation
    /// stay. `None` for no limit.
    pub max_sigma: Option<f64>,
    /// Least distance between points; `None` for as dense as the view that sees a place in most
    /// detail.
    pub point_spacing: Option<PointSpacing>,
}

/// What a distance in pixels may be.
const PIXELS: &str = "a positive number of pixels";

/// A threshold outside of its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("fusion option {name} must be {expected}, got {found}")]
pub struct OptionsError {
    /// The option.
    pub name: &'static str,
    /// What it may be.
    pub expected: &'static str,
    /// What it is.
    pub found: f64,
}

impl Default for FuseOptions {
    fn default() -> Self {
        Self {
            consistency: Consistency::Dynamic,
            max_reprojection: 1.0,
            max_relative_depth: 0.01,
            min_views: 2,
            min_support: 0.4,
            contradiction: 0.25,
            min_confidence: 0.15,
            min_coarse_confidence: 0.2,
            max_sigma: None,
            point_spacing: None,
        }
    }
}

impl FuseOptions {
    /// One fixed rule: three views agree within a pixel and 1 % of the depth.
    #[must_use]
    pub fn classic() -> Self {
        Self { consistency: Consistency::Classic, min_views: 3, ..Self::default() }
    }

    /// The paper's values for DTU (section 4.2.2): confidences above 0.1 and, in the coarse stage, 0.2,
    /// at least 3 views, and fusibile's threshold of 0.12 on the discrepancy.
    ///
    /// Fusibile compares disparities f·b/d in pixels. A pixel at depth d that is projected to the
    /// source view and back at depth d′ ends about f·b·|1/d − 1/d′| pixels away, which is the same,
    /// so 0.12 is the bound on the reprojection error. Fusibile has no bound on the depth itself;
    /// at DTU's baselines 0.12 pixels are about 0.05 % of the depth, so the 1 % here never decides.
    #[must_use]
    pub fn dtu() -> Self {
        Self { max_reprojection: 0.12, min_confidence: 0.1, ..Self::classic() }
    }

    /// Checks that each threshold is in its range.
    ///
    /// # Errors
    /// With the first threshold that is not.
    pub fn validate(&self) -> Result<(), OptionsError> {
        let positive = |v: f32| v > 0.0 && v.is_finite();
        let share = |v: f32| (0.0..=1.0).contains(&v);
        let views = self.min_views as f64;
        let check = |ok: bool, name, expected, found| {
            if ok { Ok(()) } else { Err(OptionsError { name, expected, found }) }
        };
        let (reprojection, depth) = (self.max_reprojection, self.max_relative_depth);
        let (fine, coarse) = (self.min_confidence, self.min_coarse_confidence);
        check(positive(reprojection), "max-reprojection", PIXELS, reprojection.into())?;
        check(positive(depth) && depth < 1.0, "max-relative-depth", "between 0 and 1", depth.into())?;
        check((1.0..=255.0).contains(&views), "min-views", "from 1 to 255", views)?;
        check(positive(self.min_support), "min-support", "a positive number", self.min_support.into())?;
        let against = self.contradiction;
        check(against >= 0.0 && against.is_finite(), "contradiction", "0 or more", against.into())?;
        check(share(fine), "min-confidence", "from 0 to 1", fine.into())?;
        check(share(coarse), "min-coarse-confidence", "from 0 to 1", coarse.into())?;
        if let Some(sigma) = self.max_sigma {
            check(sigma > 0.0 && sigma.is_finite(), "max-sigma", "a positive distance", sigma)?;
        }
        let Some(PointSpacing::Units(spacing) | PointSpacing::Pixels(spacing)) = self.point_spacing else {
            return Ok(());
        };
        check(spacing > 0.0 && spacing.is_finite(), "point-spacing", "a positive distance", spacing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_and_nonsense_is_named() {
        assert_eq!(FuseOptions::default().validate(), Ok(()));
        assert_eq!(FuseOptions::classic().validate(), Ok(()));
        assert_eq!(FuseOptions::dtu().validate(), Ok(()));
        let spaced = |spacing| FuseOptions { point_spacing: Some(spacing), ..FuseOptions::default() };
        assert_eq!(spaced(PointSpacing::Pixels(2.0)).validate(), Ok(()));
        let wrong = [
            (FuseOptions { max_reprojection: f32::NAN, ..FuseOptions::default() }, "max-reprojection"),
            (FuseOptions { max_relative_depth: 0.0, ..FuseOptions::default() }, "max-relative-depth"),
            (FuseOptions { min_views: 0, ..FuseOptions::default() }, "min-views"),
            (FuseOptions { min_views: 256, ..FuseOptions::default() }, "min-views"),
            (FuseOptions { min_confidence: -0.1, ..FuseOptions::default() }, "min-confidence"),
            (FuseOptions { min_coarse_confidence: 1.1, ..FuseOptions::default() }, "min-coarse-confidence"),
            (FuseOptions { min_support: 0.0, ..FuseOptions::default() }, "min-support"),
            (FuseOptions { contradiction: -1.0, ..FuseOptions::default() }, "contradiction"),
            (FuseOptions { max_sigma: Some(0.0), ..FuseOptions::default() }, "max-sigma"),
            (spaced(PointSpacing::Units(0.0)), "point-spacing"),
            (spaced(PointSpacing::Pixels(f64::INFINITY)), "point-spacing"),
        ];
        for (options, name) in wrong {
            assert_eq!(options.validate().unwrap_err().name, name);
        }
    }
}
