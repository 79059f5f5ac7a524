//! A photograph with its features.

use vamvs_core::roi::PixelBox;
use vamvs_core::{Photo, Pinhole, Pose, Size};

use crate::CorrError;
use crate::map::Map;
use crate::pyramid::{self, BLOCK, Pyramid, STRIDE};
use crate::sweep::Placed;

/// Least side of a photograph, pixels.
const LEAST_SIDE: usize = 32;

/// A photograph with its features: as it is, and at half its size.
#[derive(Clone, Debug)]
pub struct EncodedView {
    camera: Pinhole,
    cam_from_world: Pose,
    /// The photograph's size with its padding.
    padded: Size,
    fine: Map,
    coarse: Map,
}

impl EncodedView {
    pub(crate) fn new(pyramid: &Pyramid, photo: &Photo) -> Result<Self, CorrError> {
        check_size(photo.camera.size)?;
        let image = pyramid::image(&photo.image);
        let half = image.halved();
        let sides = [1, half.height / STRIDE, half.width / STRIDE];
        let coarse = pyramid.features(&half.padded([1, BLOCK, BLOCK])).sized(sides).into_owned();
        let padded = Size::new(image.width, image.height);
        let (camera, cam_from_world) = (photo.camera, photo.cam_from_world);
        Ok(Self { camera, cam_from_world, padded, fine: pyramid.features(&image), coarse })
    }

    pub(crate) fn camera(&self) -> &Pinhole {
        &self.camera
    }

    pub(crate) fn cam_from_world(&self) -> Pose {
        self.cam_from_world
    }

    /// The features at a stride of 4 pixels.
    pub(crate) fn fine(&self) -> &Map {
        &self.fine
    }

    /// The features of the photograph at half its size, at a stride of 8 of its pixels.
    pub(crate) fn coarse(&self) -> &Map {
        &self.coarse
    }

    pub(crate) fn at_full(&self) -> Placed<'_> {
        self.placed(&self.fine)
    }

    pub(crate) fn at_half(&self) -> Placed<'_> {
        self.placed(&self.coarse)
    }

    fn placed<'a>(&'a self, features: &'a Map) -> Placed<'a> {
        let Self { camera, cam_from_world, padded, .. } = *self;
        Placed { features, camera, cam_from_world, padded }
    }

    /// The memory of the features, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        (self.fine.values.len() + self.coarse.values.len()) * size_of::<f32>()
    }

    /// The part of the view inside `region`, extended outwards to multiples of 8 pixels, and the box of that part, both in pixels of
    /// the photograph.
    ///
    /// # Errors
    /// If the region is empty or outside of the image.
    pub fn cropped(&self, region: &PixelBox) -> Result<(Self, PixelBox), CorrError> {
        let outer = whole_blocks(region, (self.padded, self.camera.size))?;
        let padded = Size::new(outer.x1 - outer.x0, outer.y1 - outer.y0);
        let part = |map: &Map, stride: usize| {
            map.part((outer.x0 / stride, outer.y0 / stride), (padded.width / stride, padded.height / stride))
        };
        let Size { width, height } = self.camera.size;
        let camera =
            self.camera.cropped(PixelBox { x1: outer.x1.min(width), y1: outer.y1.min(height), ..outer });
        let (fine, coarse) = (part(&self.fine, STRIDE), part(&self.coarse, 2 * STRIDE));
        Ok((Self { camera, cam_from_world: self.cam_from_world, padded, fine, coarse }, outer))
    }
}

/// The region extended outwards to multiples of 8 pixels, of a photograph with a size with its padding and one without.
///
/// # Errors
/// If it is empty or outside of the photograph.
pub fn whole_blocks(region: &PixelBox, (padded, size): (Size, Size)) -> Result<PixelBox, CorrError> {
    let outer = PixelBox {
        x0: region.x0 / BLOCK * BLOCK,
        y0: region.y0 / BLOCK * BLOCK,
        x1: region.x1.next_multiple_of(BLOCK).min(padded.width),
        y1: region.y1.next_multiple_of(BLOCK).min(padded.height),
    };
    if outer.x0 >= outer.x1 || outer.y0 >= outer.y1 {
        let problem = format!("the region {region:?} is empty or outside the {size} image");
        return Err(CorrError::Request(problem));
    }
    Ok(outer)
}

/// Checks that a photograph is not too small for the network.
///
/// # Errors
/// If a side is smaller than 32 pixels.
pub fn check_size(size: Size) -> Result<(), CorrError> {
    if size.width < LEAST_SIDE || size.height < LEAST_SIDE {
        let problem = format!("a photograph of {size} pixels is too small: expected at least 32×32");
        return Err(CorrError::Request(problem));
    }
    Ok(())
}
