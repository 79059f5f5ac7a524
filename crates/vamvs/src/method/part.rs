//! A network's depth map of a part of an image.

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Pinhole, Size};

/// Pixels around a region of interest that are computed too, so that its border has neighbours.
const REGION_MARGIN: usize = 64;

/// The region with a margin, inside the image.
pub fn widened(region: PixelBox, size: Size) -> PixelBox {
    PixelBox {
        x0: region.x0.saturating_sub(REGION_MARGIN),
        y0: region.y0.saturating_sub(REGION_MARGIN),
        x1: (region.x1 + REGION_MARGIN).min(size.width),
        y1: (region.y1 + REGION_MARGIN).min(size.height),
    }
}

/// A depth map of the whole image with the map of a part pasted at its place, without depth outside
/// of `region`.
pub fn placed(part: &DepthMap, camera: Pinhole, place: PixelBox, region: PixelBox) -> DepthMap {
    let scale = part.scale_in(&camera);
    let size = Size::new(camera.size.width / scale, camera.size.height / scale);
    let ratio = 1.0 / scale as f64;
    let inside = |x: usize, y: usize| {
        let centre = |at: usize| at * scale + scale / 2;
        (region.x0..region.x1).contains(&centre(x)) && (region.y0..region.y1).contains(&centre(y))
    };
    let paste = |values: &Grid<f32>| {
        Grid::from_fn(size, |x, y| if inside(x, y) { at_place(values, (place, scale), (x, y)) } else { 0.0 })
    };
    DepthMap {
        camera: Pinhole { size, intrinsics: camera.intrinsics.scaled(ratio, ratio) },
        cam_from_world: part.cam_from_world,
        depth: paste(&part.depth),
        confidence: paste(&part.confidence),
        coarse_confidence: part.coarse_confidence.as_ref().map(paste),
    }
}

/// A visibility map of the whole image, of size `whole` and with a pixel for each `scale` × `scale` of its pixels, with
/// that of a part at its place; 0 elsewhere.
pub fn placed_visibility(part: &Grid<f32>, (place, scale): (PixelBox, usize), whole: Size) -> Grid<f32> {
    let size = Size::new(whole.width / scale, whole.height / scale);
    Grid::from_fn(size, |x, y| at_place(part, (place, scale), (x, y)))
}

/// The value at `(x, y)` of a raster of the whole image, of which `values` are the part at `place`; 0 elsewhere. The
/// image, whose pixels `place` is in, is `scale` times as large as the raster.
fn at_place(values: &Grid<f32>, (place, scale): (PixelBox, usize), (x, y): (usize, usize)) -> f32 {
    let local = |at: usize, first: usize| at.checked_sub(first / scale);
    let inside = local(x, place.x0).zip(local(y, place.y0));
    inside.and_then(|(x, y)| values.get(x, y).copied()).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_visibility_of_a_part_has_its_place_whatever_the_padding() {
        // A photograph of 500 pixels is padded to 504, and a part that reaches its right edge with it.
        let place = PixelBox { x0: 96, y0: 64, x1: 504, y1: 384 };
        let part = Grid::from_fn(Size::new((500 - 96) / 4, (375 - 64) / 4), |x, y| (1 + x + 1000 * y) as f32);
        let whole = placed_visibility(&part, (place, 4), Size::new(500, 375));
        assert_eq!(whole.size(), Size::new(125, 93));
        assert_eq!(whole[(124, 92)], part[(100, 76)]);
        assert_eq!((whole[(24, 16)], whole[(23, 16)], whole[(24, 15)]), (1.0, 0.0, 0.0));
    }
}
