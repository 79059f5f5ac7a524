//! What a user can set, with defaults that work.

use serde::{Deserialize, Serialize};
use vamvs_core::{DepthRange, Roi, Spacing};
use vamvs_fusion::FuseOptions;

use crate::{MemoryLimit, VamvsError};

/// The least that the longer side of photographs may be reduced to, pixels.
pub(crate) const MIN_SIZE: usize = 64;

/// How depth maps are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct DepthOptions {
    /// Longer side to which larger photographs are reduced, pixels: the size of refined depth maps.
    pub max_size: usize,
    /// Longer side to which the network sees larger photographs reduced, pixels. vis-corr sees smaller ones as they are and
    /// enlarged to it, at most twice; of both depth maps the one that it is surer of is refined.
    pub network_size: usize,
    /// Whether depth maps are refined to the size of their photographs, or stay at that of the network's last
    /// iteration.
    pub refine: bool,
    /// Whether refined depth maps are refined once more with those of the source views.
    pub geometric: bool,
    /// Smaller photographs are enlarged by up to this factor, 1 to 8, but not beyond `max_size`.
    pub enlarge: f64,
    /// Pixels all of whose channels are darker, grey values, count as masked: a black backdrop. 0: none.
    pub min_brightness: u8,
    /// Pixels all of whose channels are brighter, grey values, count as masked: a white backdrop. 255: none.
    pub max_brightness: u8,
    /// How photographs of 16 bits become 8.
    pub stretch: Stretching,
    /// Stride of the coarse depth map, pixels of a photograph: 8 or 4; what is thinner than the stride is lost. By
    /// default the network's own.
    #[serde(alias = "cells")]
    pub coarse_stride: Option<usize>,
    /// Views compared for a depth map at most, the reference included, at least 2; see
    /// [`vamvs_core::view_selection::compared`].
    pub views: usize,
    /// Number of planes; by default from the cameras, see [`vamvs_core::Planes::for_views`].
    pub planes: Option<usize>,
    /// Largest number of planes chosen by default.
    pub max_planes: usize,
    /// The quantity in which planes are evenly spaced; by default inverse depth if the range is
    /// wide.
    pub spacing: Option<Spacing>,
    /// One depth range for all views, scene units; by default each view's own.
    pub depth_range: Option<DepthRange>,
    /// Number of the network's flow iterations that are run; later ones are finer. By default all.
    pub iterations: Option<usize>,
    /// Depth only inside this box of the world.
    pub roi: Option<Roi>,
    /// Depth outside of the box too, but coarsely: all flow iterations inside of it, fewer around, the coarse
    /// map elsewhere (section 4.5).
    pub fovea: bool,
    /// Whether the visibility of each view's pixels in its source views, as the network predicts it, is written beside the
    /// depth maps: `visibility/NAME.png`.
    pub visibility: bool,
    /// Limit of resident memory. A depth map that would exceed it is made in smaller pieces, then
    /// from smaller photographs; features are kept for later views as far as it allows.
    pub max_memory: MemoryLimit,
}

impl Default for DepthOptions {
    fn default() -> Self {
        Self {
            max_size: 2000,
            network_size: 1536,
            refine: true,
            geometric: true,
            enlarge: 1.0,
            min_brightness: 0,
            max_brightness: 255,
            stretch: Stretching::Auto,
            coarse_stride: None,
            views: 5,
            planes: None,
            max_planes: 192,
            spacing: None,
            depth_range: None,
            iterations: None,
            roi: None,
            fovea: false,
            visibility: false,
            max_memory: MemoryLimit::default(),
        }
    }
}

/// How photographs of 16 bits become 8.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stretching {
    /// All alike, between the values that nearly all of the scene's photographs lie between, if these are less than half of
    /// what 16 bits can hold.
    #[default]
    Auto,
    /// Their upper 8 bits.
    None,
    /// From 0 at `low` to 255 at `high`.
    Between {
        /// The value that becomes 0.
        low: u16,
        /// The value that becomes 255.
        high: u16,
    },
}

/// How depth maps become a cloud.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct FusionOptions {
    /// The filters.
    pub filter: FuseOptions,
    /// Whether the filters' least confidences are the network's probabilities, as in the paper, whatever the depth maps'
    /// confidence was calibrated to. Refined depth maps have no such probability.
    pub network_confidence: bool,
    /// Number of source views that a view is checked against.
    pub neighbours: usize,
    /// Points only inside this box of the world.
    pub roi: Option<Roi>,
    /// Limit of resident memory.
    pub max_memory: MemoryLimit,
}

impl FusionOptions {
    /// Checks the values.
    ///
    /// # Errors
    /// If one is out of its range.
    pub fn validate(&self) -> Result<(), VamvsError> {
        self.filter.validate().map_err(vamvs_fusion::FuseError::from)?;
        if self.neighbours == 0 {
            let problem = "neighbours must be at least 1: points are confirmed by other views (--neighbours)";
            return Err(VamvsError::Request(problem.to_owned()));
        }
        Ok(())
    }
}

impl Default for FusionOptions {
    fn default() -> Self {
        Self {
            filter: FuseOptions::default(),
            network_confidence: false,
            neighbours: 10,
            roi: None,
            max_memory: MemoryLimit::default(),
        }
    }
}
