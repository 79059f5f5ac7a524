//! How depth maps are refined.

use serde::{Deserialize, Serialize};

/// How [`crate::refine`] and [`crate::refine_geometric`] work. Pixels of disparity are those of the source views, the
/// mean over them; nothing depends on the scene's scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct RefineOptions {
    /// How often the photograph's size is halved for the result of [`crate::refine`], 2 times at most: 1 does for a
    /// first pass.
    pub halvings: usize,
    /// How many source views, those that match best, a pixel's correlation is the mean of.
    pub views: usize,
    /// Difference of luminance at which a texel counts a quarter, grey values.
    pub colour: f32,
    /// Noise of the photographs, grey values: windows of less contrast are matched by the seed.
    pub noise: f32,
    /// How far to both sides of the seed depth is searched, pixels of disparity at the resolution that is searched
    /// first: a half or a quarter of the photograph's.
    pub search: u32,
    /// Sweeps over the image at the resolution that is searched first; at each finer one there is one more.
    pub sweeps: usize,
    /// What departing from the seed costs at most, in correlation.
    pub prior: f32,
    /// The departure from the seed at which that is reached, pixels of disparity.
    pub prior_reach: f32,
    /// By how much a source view that the network takes for occluded is handicapped, in correlation.
    pub visibility: f32,
    /// The cost of a pixel of forward-backward reprojection error, in correlation ([`crate::refine_geometric`]).
    pub geometric: f32,
    /// The largest such error that counts, pixels.
    pub geometric_reach: f32,
    /// Connected pieces of fewer pixels go.
    pub speckle: usize,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            halvings: 0,
            views: 2,
            colour: 20.0,
            noise: 1.0,
            search: 4,
            sweeps: 2,
            prior: 0.07,
            prior_reach: 4.0,
            visibility: 0.3,
            geometric: 0.1,
            geometric_reach: 3.0,
            speckle: 40,
        }
    }
}
