//! Options of the refinement.

use serde::{Deserialize, Serialize};

use crate::RefineError;

/// Options of [`crate::refine`] and [`crate::refine_geometric`]. A pixel of disparity is a shift of one pixel in the
/// source views, on average over them, so nothing depends on the scene's scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct RefineOptions {
    /// How often the size of the photograph is halved for the result of [`crate::refine`], at most twice. Once is
    /// enough for a first pass.
    pub halvings: usize,
    /// The correlation of a pixel is the mean over this many source views, those that match best.
    pub views: usize,
    /// Difference of luminance at which a texel has a quarter of its weight, grey values.
    pub colour: f32,
    /// Noise of the photographs, grey values. Where a window has less contrast than that, the seed decides.
    pub noise: f32,
    /// Depth is searched this far to both sides of the seed, in pixels of disparity at the first resolution: a half
    /// or a quarter of the photograph's.
    pub search: u32,
    /// Depth stays between the nearest and the farthest surface that the seed has around a pixel, and this far
    /// beyond, pixels of disparity at the resolution at hand, a quarter of that at the first, coarsest one
    /// ([`crate::refine`]). Infinite: everywhere, for a seed that may have missed the surface.
    pub beyond: f32,
    /// Number of sweeps over the image at the first resolution; each finer one has one sweep.
    pub sweeps: usize,
    /// The largest cost of departing from the seed, in correlation.
    pub prior: f32,
    /// The departure from the seed at which the cost is largest, pixels of disparity.
    pub prior_reach: f32,
    /// The handicap, in correlation, of a source view that the network considers occluded, when the best views are
    /// chosen.
    pub visibility: f32,
    /// The cost per pixel of forward-backward reprojection error, in correlation ([`crate::refine_geometric`]).
    pub geometric: f32,
    /// The limit of that error, pixels: larger errors cost no more.
    pub geometric_reach: f32,
    /// Connected pieces of fewer pixels are speckles: they get the seed's planes back.
    pub speckle: usize,
    /// Side of a tile, pixels, a multiple of 4. Photographs with more than four times the pixels of a tile are refined
    /// tile by tile, so that memory does not grow with their size.
    pub tile: usize,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            halvings: 0,
            views: 2,
            colour: 20.0,
            noise: 1.0,
            search: 4,
            beyond: f32::INFINITY,
            sweeps: 2,
            prior: 0.07,
            prior_reach: 4.0,
            visibility: 0.3,
            geometric: 0.1,
            geometric_reach: 3.0,
            speckle: 40,
            tile: 1024,
        }
    }
}

impl RefineOptions {
    /// Checks the values.
    ///
    /// # Errors
    /// If one is out of its range.
    pub fn validate(&self) -> Result<(), RefineError> {
        let positive = |value: f32| value > 0.0 && value.is_finite();
        let at_least_0 = |value: f32| value >= 0.0 && value.is_finite();
        let option = |is_valid, name, expected, found: &dyn std::fmt::Display| match is_valid {
            true => Ok(()),
            false => Err(RefineError::Option { name, expected, found: found.to_string() }),
        };
        option(self.halvings <= 2, "halvings", "at most 2", &self.halvings)?;
        option(self.views >= 1, "views", "at least 1", &self.views)?;
        option(self.beyond >= 0.0, "beyond", "at least 0, or infinite", &self.beyond)?;
        let sides = 64..=1 << 20;
        let is_side = sides.contains(&self.tile) && self.tile.is_multiple_of(4);
        option(is_side, "tile", "a multiple of 4 from 64 to 1048576 pixels", &self.tile)?;
        for (name, value) in [
            ("colour", self.colour),
            ("noise", self.noise),
            ("prior-reach", self.prior_reach),
            ("geometric-reach", self.geometric_reach),
        ] {
            option(positive(value), name, "above 0 and finite", &value)?;
        }
        for (name, value) in
            [("prior", self.prior), ("visibility", self.visibility), ("geometric", self.geometric)]
        {
            option(at_least_0(value), name, "at least 0 and finite", &value)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_named() {
        let valid = RefineOptions::default();
        assert_eq!(valid.validate(), Ok(()));
        let wrong = [
            (RefineOptions { halvings: 3, ..valid }, "halvings must be at most 2, got 3"),
            (RefineOptions { views: 0, ..valid }, "views must be at least 1, got 0"),
            (RefineOptions { colour: 0.0, ..valid }, "colour must be above 0"),
            (RefineOptions { beyond: f32::NAN, ..valid }, "beyond must be at least 0"),
            (RefineOptions { tile: usize::MAX, ..valid }, "tile must be a multiple of 4"),
            (RefineOptions { prior: -0.1, ..valid }, "prior must be at least 0"),
        ];
        for (options, expected) in wrong {
            let error = options.validate().unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
