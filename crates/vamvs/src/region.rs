//! Regions of an image as shares of its width and height, from the upper left corner to the lower right one: the same at any size.

use vamvs_core::Size;
use vamvs_core::roi::PixelBox;

/// A region of pixels of an image as shares.
pub(crate) fn shares(region: PixelBox, size: Size) -> [[f64; 2]; 2] {
    let share = |x: usize, y: usize| [x as f64 / size.width as f64, y as f64 / size.height as f64];
    [share(region.x0, region.y0), share(region.x1, region.y1)]
}

/// Whether the centre of a pixel of an image of a size is inside.
pub(crate) fn contains([[x0, y0], [x1, y1]]: [[f64; 2]; 2], (x, y): (usize, usize), size: Size) -> bool {
    let centre = |at: usize, side: usize| (at as f64 + 0.5) / side as f64;
    (x0..x1).contains(&centre(x, size.width)) && (y0..y1).contains(&centre(y, size.height))
}
