//! Pictures side by side.

use vamvs_core::{Grid, Rgb, Size};
use vamvs_io::image;

/// Pixels between pictures.
const GAP: usize = 6;

/// Pictures side by side, each resized to `size`, with a white gap between.
pub fn row(pictures: &[Grid<Rgb>], size: Size) -> Grid<Rgb> {
    let resized: Vec<_> = pictures.iter().map(|picture| image::resize(picture, size)).collect();
    let width = (size.width + GAP) * pictures.len() - GAP;
    Grid::from_fn(Size::new(width, size.height), |x, y| {
        let (picture, x) = (x / (size.width + GAP), x % (size.width + GAP));
        resized[picture].get(x, y).copied().unwrap_or([255; 3])
    })
}

/// The size of a picture of the same shape, `width` pixels wide.
pub fn of_width(size: Size, width: usize) -> Size {
    Size::new(width, (size.height * width).div_ceil(size.width))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_keep_their_order_and_are_apart() {
        let plain = |colour: Rgb| Grid::filled(Size::new(8, 6), colour);
        let joined = row(&[plain([10; 3]), plain([90; 3])], Size::new(4, 3));
        assert_eq!(joined.size(), Size::new(4 + GAP + 4, 3));
        assert_eq!([0, 3, 4, 4 + GAP].map(|x| joined[(x, 1)][0]), [10, 10, 255, 90]);
    }
}
