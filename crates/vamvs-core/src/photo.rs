//! The input of depth estimation for one view: an undistorted photograph and its camera.

use crate::roi::PixelBox;
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

impl Photo {
    /// A part of the photograph.
    #[must_use]
    pub fn cropped(&self, part: PixelBox) -> Self {
        Self {
            camera: self.camera.cropped(part),
            cam_from_world: self.cam_from_world,
            image: self.image.cropped(part),
            mask: self.mask.as_ref().map(|mask| mask.cropped(part)),
        }
    }
}
