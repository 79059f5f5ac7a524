//! A source view as the matcher sees it.

use vamvs_core::{Grid, Photo, Pinhole, Pose};

use crate::luminance::{self, Quads};
use crate::transfer::Transfer;

/// Most source views that are used; further ones are ignored.
pub const MOST_SOURCES: usize = 16;

/// A source photograph at some resolution, with the projection from the reference view into it.
pub(crate) struct Source<'a> {
    pub quads: Quads,
    pub transfer: Transfer,
    /// How likely the source sees what a reference pixel shows, 0 to 1, at any size.
    pub visibility: Option<&'a Grid<f32>>,
}

impl<'a> Source<'a> {
    /// The source at 1/2^level of the photograph's size; the `reference` camera must have that
    /// level already.
    pub fn new(photo: &Photo, level: usize, reference: (&Pinhole, &Pose)) -> Self {
        let (image, _) = luminance::at_level(photo, level);
        let camera = reduced(&photo.camera, level);
        let transfer = Transfer::new(reference, (&camera, &photo.cam_from_world));
        Self { quads: Quads::new(&image), transfer, visibility: None }
    }

    /// The source with the network's visibility.
    pub fn with_visibility(self, visibility: Option<&'a Grid<f32>>) -> Self {
        Self { visibility, ..self }
    }
}

/// A camera at 1/2^level, as [`luminance::at_level`] reduces its photograph.
pub(crate) fn reduced(camera: &Pinhole, level: usize) -> Pinhole {
    let mut camera = *camera;
    for _ in 0..level {
        camera.size = vamvs_core::Size::new(camera.size.width / 2, camera.size.height / 2);
        camera.intrinsics = camera.intrinsics.scaled(0.5, 0.5);
    }
    camera
}
