//! Pictures side by side and one below the other.

use vamvs_core::{Grid, Rgb, Size};
use vamvs_io::image;

/// Pixels between pictures.
const GAP: usize = 6;

/// Pictures side by side, each resized to `size`, with a white gap between.
#[must_use]
pub fn row(pictures: &[Grid<Rgb>], size: Size) -> Grid<Rgb> {
    let resized: Vec<_> = pictures.iter().map(|picture| image::resize(picture, size)).collect();
    let width = (size.width + GAP) * pictures.len() - GAP;
    Grid::from_fn(Size::new(width, size.height), |x, y| {
        let (picture, x) = (x / (size.width + GAP), x % (size.width + GAP));
        resized[picture].get(x, y).copied().unwrap_or([255; 3])
    })
}

/// Pictures one below the other, with a white gap between, and white to the right of narrower ones.
#[must_use]
pub fn column(pictures: &[Grid<Rgb>]) -> Grid<Rgb> {
    let width = pictures.iter().map(Grid::width).max().unwrap_or(0);
    let mut pixels = Vec::new();
    for (index, picture) in pictures.iter().enumerate() {
        let gap = if index == 0 { 0 } else { GAP };
        pixels.resize(pixels.len() + gap * width, [255; 3]);
        for y in 0..picture.height() {
            pixels.extend_from_slice(picture.row(y));
            pixels.resize(pixels.len() + width - picture.width(), [255; 3]);
        }
    }
    Grid::from_vec(Size::new(width, pixels.len() / width.max(1)), pixels)
}

/// The size of a picture of the same shape, `width` pixels wide.
#[must_use]
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

    #[test]
    fn columns_are_as_wide_as_their_widest_picture() {
        let plain = |width, colour: Rgb| Grid::filled(Size::new(width, 2), colour);
        let joined = column(&[plain(2, [10; 3]), plain(3, [90; 3])]);
        assert_eq!(joined.size(), Size::new(3, 2 + GAP + 2));
        assert_eq!([(0, 1), (2, 1), (0, 2), (2, 2 + GAP)].map(|at| joined[at][0]), [10, 255, 255, 90]);
        assert_eq!(column(&[]).size(), Size::new(0, 0));
    }
}
