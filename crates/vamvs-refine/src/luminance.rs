//! Photographs in the matcher's formats: 8-bit luminance, either padded or packed as 2×2 neighbourhoods in one
//! word.

use rayon::prelude::*;
use vamvs_core::{Grid, Photo, Rgb, Size};

/// Width of the border of [`Padded`], pixels: the radius of the window plus one.
pub(crate) const BORDER: usize = 6;

/// The value of pixels outside of the image or the mask. It is so far from every grey value that its bilateral
/// weight is negligible.
pub(crate) const NOTHING: f32 = -1e4;

/// Rec. 709 luma of a photograph, grey values 0 to 255.
pub(crate) fn luminance(image: &Grid<Rgb>) -> Grid<u8> {
    let grey = |&[r, g, b]: &Rgb| {
        let sum = 54 * u32::from(r) + 183 * u32::from(g) + 19 * u32::from(b) + 128;
        (sum >> 8) as u8
    };
    let mut out = Grid::filled(image.size(), 0);
    out.data_mut()
        .par_iter_mut()
        .zip(image.data())
        .with_min_len(1 << 14)
        .for_each(|(to, rgb)| *to = grey(rgb));
    out
}

/// The image at half the size, each pixel the mean of four; the last row or column is dropped if their number is
/// odd.
pub(crate) fn halved(image: &Grid<u8>) -> Grid<u8> {
    let size = Size::new(image.width() / 2, image.height() / 2);
    Grid::from_fn(size, |x, y| {
        let sum = |y: usize| u16::from(image[(2 * x, y)]) + u16::from(image[(2 * x + 1, y)]);
        ((sum(2 * y) + sum(2 * y + 1) + 2) / 4) as u8
    })
}

/// The mask at half the size: a pixel is used if all of its four are.
pub(crate) fn halved_mask(mask: &Grid<bool>) -> Grid<bool> {
    let size = Size::new(mask.width() / 2, mask.height() / 2);
    Grid::from_fn(size, |x, y| (0..4).all(|i| mask[(2 * x + i % 2, 2 * y + i / 2)]))
}

/// A reference photograph's luminance with a border, [`NOTHING`] outside of the image and the mask.
pub(crate) struct Padded {
    /// The size without the border.
    pub size: Size,
    grid: Grid<f32>,
}

impl Padded {
    pub fn new(image: &Grid<u8>, mask: Option<&Grid<bool>>) -> Self {
        let size = image.size();
        let padded = Size::new(size.width + 2 * BORDER, size.height + 2 * BORDER);
        let value = |x: usize, y: usize| {
            let grey = image.get(x.wrapping_sub(BORDER), y.wrapping_sub(BORDER));
            let counts = |mask: &Grid<bool>| mask[(x - BORDER, y - BORDER)];
            grey.filter(|_| mask.is_none_or(counts)).map_or(NOTHING, |&grey| f32::from(grey))
        };
        Self { size, grid: Grid::from_fn(padded, value) }
    }

    /// The values from `(x − BORDER, y − BORDER)` on, row-major, and their row stride.
    #[inline]
    pub fn around(&self, x: usize, y: usize) -> (&[f32], usize) {
        let stride = self.grid.width();
        (&self.grid.data()[y * stride + x..], stride)
    }

    /// The grey value of a pixel, or [`NOTHING`].
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.grid[(x + BORDER, y + BORDER)]
    }
}

/// A source photograph's luminance, packed for bilinear sampling with one load per sample. The word of pixel (x,
/// y) holds, from the lowest byte, the values of (x, y), (x + 1, y), (x, y + 1) and (x + 1, y + 1); the border
/// is replicated.
pub(crate) struct Quads {
    grid: Grid<u32>,
}

impl Quads {
    /// The words of an image of at least 2×2 pixels.
    pub fn new(image: &Grid<u8>) -> Self {
        let Size { width, height } = image.size();
        let mut grid = Grid::filled(image.size(), 0);
        grid.data_mut().par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
            let (top, bottom) = (image.row(y), image.row((y + 1).min(height - 1)));
            for (x, word) in row.iter_mut().enumerate() {
                let next = (x + 1).min(width - 1);
                *word = u32::from_le_bytes([top[x], top[next], bottom[x], bottom[next]]);
            }
        });
        Self { grid }
    }

    pub fn size(&self) -> Size {
        self.grid.size()
    }

    #[inline]
    pub fn words(&self) -> &[u32] {
        self.grid.data()
    }
}

/// Luminance and mask of a photograph at 1/2^level.
pub(crate) fn at_level(photo: &Photo, level: usize) -> (Grid<u8>, Option<Grid<bool>>) {
    let (mut image, mut mask) = (luminance(&photo.image), photo.mask.clone());
    for _ in 0..level {
        image = halved(&image);
        mask = mask.as_ref().map(halved_mask);
    }
    (image, mask)
}
