//! Masks and regions of interest: the part of an image that they leave, and its depth map.

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Photo, Pinhole, Size};

/// Pixels around a region of interest that are computed too, so that its border has neighbours.
const REGION_MARGIN: usize = 32;

/// Removes the depths of masked pixels.
pub(super) fn remove_masked(map: &mut DepthMap, mask: &Grid<bool>, scale: usize) {
    let size = map.depth.size();
    let mask = covered(mask, size, scale).resized_nearest(size);
    let pixels = map.depth.data_mut().iter_mut().zip(mask.data());
    pixels.filter(|(_, counts)| !**counts).for_each(|(depth, _)| *depth = 0.0);
}

/// The part of a photograph that a depth map of `size` at 1/scale covers: sides that are no multiple of the scale
/// lose their last pixels.
pub(super) fn covered<T: Clone>(image: &Grid<T>, size: Size, scale: usize) -> Grid<T> {
    let covered = Size::new(size.width * scale, size.height * scale);
    Grid::from_fn(covered, |x, y| image[(x, y)].clone())
}

/// A region of an image of size `from`, in the image of size `to`: photographs may come smaller than
/// their cameras say.
pub(super) fn rescaled(region: PixelBox, from: Size, to: Size) -> PixelBox {
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
pub(super) fn unmasked(region: Option<PixelBox>, photo: &Photo) -> Option<PixelBox> {
    let Some(left) = photo.mask.as_ref().and_then(PixelBox::around) else { return region };
    let Size { width, height } = photo.camera.size;
    let whole = PixelBox { x0: 0, y0: 0, x1: width, y1: height };
    let region = region.unwrap_or(whole);
    let common = region.common(left).unwrap_or(region);
    (common != whole).then_some(common)
}

/// The region with a margin, inside the image.
pub(super) fn widened(region: PixelBox, size: Size) -> PixelBox {
    PixelBox {
        x0: region.x0.saturating_sub(REGION_MARGIN),
        y0: region.y0.saturating_sub(REGION_MARGIN),
        x1: (region.x1 + REGION_MARGIN).min(size.width),
        y1: (region.y1 + REGION_MARGIN).min(size.height),
    }
}

/// A depth map of the whole image with the map of a part pasted at its place, without depth outside
/// of `region`.
pub(super) fn placed(part: &DepthMap, camera: Pinhole, place: PixelBox, region: PixelBox) -> DepthMap {
    let scale = part.scale_in(&camera);
    let size = Size::new(camera.size.width / scale, camera.size.height / scale);
    let ratio = 1.0 / scale as f64;
    let inside = |x: usize, y: usize| {
        let centre = |at: usize| at * scale + scale / 2;
        (region.x0..region.x1).contains(&centre(x)) && (region.y0..region.y1).contains(&centre(y))
    };
    let paste = |values: &Grid<f32>| {
        Grid::from_fn(size, |x, y| {
            let local = |at: usize, first: usize| at.checked_sub(first / scale);
            let (x_in_part, y_in_part) = (local(x, place.x0), local(y, place.y0));
            let value = x_in_part.zip(y_in_part).and_then(|(x, y)| values.get(x, y).copied());
            value.filter(|_| inside(x, y)).unwrap_or(0.0)
        })
    };
    DepthMap {
        camera: Pinhole { size, intrinsics: camera.intrinsics.scaled(ratio, ratio) },
        cam_from_world: part.cam_from_world,
        depth: paste(&part.depth),
        confidence: paste(&part.confidence),
        coarse_confidence: part.coarse_confidence.as_ref().map(paste),
    }
}
