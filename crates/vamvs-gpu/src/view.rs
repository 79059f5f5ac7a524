//! A photograph with its features, in the device's memory.

use vamvs_core::roi::PixelBox;
use vamvs_core::{Photo, Pinhole, Pose, Size};
use vamvs_corr::layers::{BLOCK, STRIDE};

use crate::layer::part;
use crate::map::Map;
use crate::recorder::Recorder;
use crate::{Gpu, GpuError};

/// A photograph with its features: as it is, and at half its size.
pub struct EncodedView {
    pub(crate) camera: Pinhole,
    pub(crate) cam_from_world: Pose,
    /// The photograph's size with its padding.
    pub(crate) padded: Size,
    pub(crate) fine: Map,
    pub(crate) coarse: Map,
}

impl EncodedView {
    pub(crate) fn new(photo: &Photo, padded: Size, [fine, coarse]: [Map; 2]) -> Self {
        Self { camera: photo.camera, cam_from_world: photo.cam_from_world, padded, fine, coarse }
    }

    /// The device's memory that the features take, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        (self.fine.buffer.size() + self.coarse.buffer.size()) as usize
    }

    /// The part of the view inside `region`, extended outwards to multiples of 8 pixels, and the box of that part, both in pixels of
    /// the photograph.
    ///
    /// # Errors
    /// If the region is empty or outside of the image, or the device fails.
    pub fn cropped(&self, gpu: &Gpu, region: &PixelBox) -> Result<(Self, PixelBox), GpuError> {
        let outer = vamvs_corr::view::whole_blocks(region, (self.padded, self.camera.size))?;
        let padded = Size::new(outer.x1 - outer.x0, outer.y1 - outer.y0);
        let Size { width, height } = self.camera.size;
        let camera =
            self.camera.cropped(PixelBox { x1: outer.x1.min(width), y1: outer.y1.min(height), ..outer });
        let maps = gpu.checked(|| {
            let mut recorder = Recorder::new(gpu);
            let mut of = |map: &Map, stride: usize| {
                let sides = [1, padded.height / stride, padded.width / stride];
                part(&mut recorder, map, (outer.x0 / stride, outer.y0 / stride), sides)
            };
            let maps = [of(&self.fine, STRIDE)?, of(&self.coarse, BLOCK)?];
            recorder.submit();
            Ok(maps)
        })?;
        let [fine, coarse] = maps;
        Ok((Self { camera, cam_from_world: self.cam_from_world, padded, fine, coarse }, outer))
    }
}
