//! The input of depth estimation for one view: an undistorted photograph and its camera.

use crate::{Grid, Pinhole, Pose};

/// Red, green, blue, 0 to 255, sRGB-encoded.
pub type Rgb = [u8; 3];

/// An undistorted photograph with its camera and pose.
#[derive(Clone, Debug)]
pub struct Photo {
    /// The camera; its size is the image's.
    pub camera: Pinhole,
    /// The pose.
    pub cam_from_world: Pose,
    /// The image.
    pub image: Grid<Rgb>,
    /// `true` for the pixels that are used; `None` if all are.
    pub mask: Option<Grid<bool>>,
}
