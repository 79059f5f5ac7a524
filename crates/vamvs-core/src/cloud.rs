//! A dense cloud of coloured, oriented points.

use serde::{Deserialize, Serialize};

use crate::Rgb;

/// One point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CloudPoint {
    /// Position in the world.
    pub x_in_world: [f64; 3],
    /// Unit normal in the world, towards the cameras that saw the point.
    pub normal: [f32; 3],
    /// Colour.
    pub colour: Rgb,
    /// Confidence in [0, 1].
    pub confidence: f32,
    /// Standard deviation of its position along the ray from the camera that its depth is of, scene units; 0 if it is not
    /// known.
    pub sigma: f32,
    /// Number of views that agree on the point.
    pub views: u8,
}

/// A dense cloud.
pub type Cloud = Vec<CloudPoint>;
