//! A view's estimated depth.

use crate::roi::PixelBox;
use crate::{Grid, Pinhole, Pose};

/// Depth and confidence of each pixel of a view, with the camera they belong to.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// The camera at the depth map's size.
    pub camera: Pinhole,
    /// The pose.
    pub cam_from_world: Pose,
    /// Depth z in scene units; 0 where there is none.
    pub depth: Grid<f32>,
    /// Confidence of the final depth in [0, 1].
    pub confidence: Grid<f32>,
    /// Confidence of the coarse stage in [0, 1], at the same size; `None` if the estimator gives none.
    pub coarse_confidence: Option<Grid<f32>>,
}

impl DepthMap {
    /// A part of the map.
    #[must_use]
    pub fn cropped(&self, part: PixelBox) -> Self {
        Self {
            camera: self.camera.cropped(part),
            cam_from_world: self.cam_from_world,
            depth: self.depth.cropped(part),
            confidence: self.confidence.cropped(part),
            coarse_confidence: self.coarse_confidence.as_ref().map(|confidence| confidence.cropped(part)),
        }
    }

    /// The ratio of the photograph's size to the map's, as a whole number. It is computed from the focal lengths,
    /// because the sizes are rounded.
    #[must_use]
    pub fn scale_in(&self, photograph: &Pinhole) -> usize {
        (photograph.intrinsics.fx / self.camera.intrinsics.fx).round() as usize
    }
}

/// Whether a depth value is valid: finite and positive.
#[must_use]
pub fn is_valid(depth: f32) -> bool {
    depth.is_finite() && depth > 0.0
}
