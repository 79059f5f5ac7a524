//! Masks and regions of interest: the part of an image that they leave.

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Photo, Size};

/// Removes the depths of masked pixels.
pub fn remove_masked(map: &mut DepthMap, mask: &Grid<bool>, scale: usize) {
    let size = map.depth.size();
    let mask = covered(mask, size, scale).resized_nearest(size);
    let pixels = map.depth.data_mut().iter_mut().zip(mask.data());
    pixels.filter(|(_, counts)| !**counts).for_each(|(depth, _)| *depth = 0.0);
}

/// The part of a photograph that a depth map of `size` at 1/scale covers: sides that are no multiple of the scale
/// lose their last pixels.
pub fn covered<T: Clone>(image: &Grid<T>, size: Size, scale: usize) -> Grid<T> {
    image.cropped(PixelBox { x0: 0, y0: 0, x1: size.width * scale, y1: size.height * scale })
}

/// A region of an image of size `from`, in the image of size `to`: photographs may come smaller than
/// their cameras say.
pub fn rescaled(region: PixelBox, from: Size, to: Size) -> PixelBox {
    let low = |at: usize, from: usize, to: usize| at * to / from;
    let high = |at: usize, from: usize, to: usize| (at * to).div_ceil(from);
    PixelBox {
        x0: low(region.x0, from.width, to.width),
        y0: low(region.y0, from.height, to.height),
        x1: high(region.x1, from.width, to.width),
        y1: high(region.y1, from.height, to.height),
    }
}

/// The part of the region, or of the whole photograph, around its unmasked pixels; `None` for the
/// whole photograph.
pub fn unmasked(region: Option<PixelBox>, photo: &Photo) -> Option<PixelBox> {
    let Some(left) = photo.mask.as_ref().and_then(PixelBox::around) else { return region };
    let Size { width, height } = photo.camera.size;
    let whole = PixelBox { x0: 0, y0: 0, x1: width, y1: height };
    let region = region.unwrap_or(whole);
    let common = region.common(left).unwrap_or(region);
    (common != whole).then_some(common)
}
