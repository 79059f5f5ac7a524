//! A row-major raster of values.

use std::ops::{Index, IndexMut};

use serde::{Deserialize, Serialize};

use crate::roi::PixelBox;

/// The size of a raster in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Size {
    /// Pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

impl Size {
    /// A size of `width` × `height` pixels.
    #[must_use]
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    /// Number of pixels.
    #[must_use]
    pub const fn area(self) -> usize {
        self.width * self.height
    }

    /// The longer side, pixels.
    #[must_use]
    pub fn longer_side(self) -> usize {
        self.width.max(self.height)
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}×{}", self.width, self.height)
    }
}

/// A row-major raster: the value of pixel `(x, y)` is at `y * width + x`.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    size: Size,
    data: Vec<T>,
}

impl<T> Grid<T> {
    /// Wraps row-major `data`.
    ///
    /// # Panics
    /// If `data` does not hold exactly one value per pixel.
    #[must_use]
    pub fn from_vec(size: Size, data: Vec<T>) -> Self {
        assert_eq!(data.len(), size.area(), "a {size} grid needs one value per pixel");
        Self { size, data }
    }

    /// Fills each pixel with `value(x, y)`.
    #[must_use]
    pub fn from_fn(size: Size, mut value: impl FnMut(usize, usize) -> T) -> Self {
        let mut data = Vec::with_capacity(size.area());
        for y in 0..size.height {
            data.extend((0..size.width).map(|x| value(x, y)));
        }
        Self { size, data }
    }

    /// The raster's size.
    #[must_use]
    pub const fn size(&self) -> Size {
        self.size
    }

    /// Pixels in a row.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.size.width
    }

    /// Number of rows.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.size.height
    }

    /// All values, row after row.
    #[must_use]
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// All values, row after row.
    #[must_use]
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The values without the size.
    #[must_use]
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// Row `y`.
    #[must_use]
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.size.width..][..self.size.width]
    }

    /// Row `y`.
    #[must_use]
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.size.width..][..self.size.width]
    }

    /// The value at `(x, y)`; `None` outside of the raster.
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> Option<&T> {
        (x < self.size.width && y < self.size.height).then(|| &self.data[y * self.size.width + x])
    }

    /// A raster of the same size with `f` of each value.
    #[must_use]
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Grid<U> {
        Grid { size: self.size, data: self.data.iter().map(f).collect() }
    }
}

impl<T: Clone> Grid<T> {
    /// A raster filled with `value`.
    #[must_use]
    pub fn filled(size: Size, value: T) -> Self {
        Self { size, data: vec![value; size.area()] }
    }

    /// A part of the raster.
    #[must_use]
    pub fn cropped(&self, part: PixelBox) -> Self {
        let rows = (part.y0..part.y1).flat_map(|y| self.row(y)[part.x0..part.x1].iter().cloned());
        Self { size: part.size(), data: rows.collect() }
    }

    /// The raster resized to `size` by nearest-neighbour sampling at the new pixels' centres.
    #[must_use]
    pub fn resized_nearest(&self, size: Size) -> Self {
        let column: Vec<usize> =
            (0..size.width).map(|x| (2 * x + 1) * self.size.width / (2 * size.width)).collect();
        let mut data = Vec::with_capacity(size.area());
        for y in 0..size.height {
            let row = self.row((2 * y + 1) * self.size.height / (2 * size.height));
            data.extend(column.iter().map(|&x| row[x].clone()));
        }
        Self { size, data }
    }
}

/// The pixel `(x, y)`. Panics outside of the raster; see [`Grid::get`].
impl<T> Index<(usize, usize)> for Grid<T> {
    type Output = T;

    #[inline]
    fn index(&self, (x, y): (usize, usize)) -> &T {
        assert!(x < self.size.width, "column {x} of a {} grid", self.size);
        &self.data[y * self.size.width + x]
    }
}

impl<T> IndexMut<(usize, usize)> for Grid<T> {
    #[inline]
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        assert!(x < self.size.width, "column {x} of a {} grid", self.size);
        &mut self.data[y * self.size.width + x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_contiguous_and_indexed_x_then_y() {
        let grid = Grid::from_fn(Size::new(3, 2), |x, y| 10 * y + x);
        assert_eq!(grid.data(), [0, 1, 2, 10, 11, 12]);
        assert_eq!(grid.row(1), [10, 11, 12]);
        assert_eq!(grid[(2, 1)], 12);
        assert_eq!(grid.get(3, 0), None);
        assert_eq!(grid.get(0, 2), None);
    }

    #[test]
    fn nearest_doubling_repeats_and_halving_keeps_every_other() {
        let grid = Grid::from_fn(Size::new(2, 2), |x, y| 2 * y + x);
        let double = grid.resized_nearest(Size::new(4, 4));
        assert_eq!(double.row(1), [0, 0, 1, 1]);
        assert_eq!(double.row(2), [2, 2, 3, 3]);
        assert_eq!(double.resized_nearest(Size::new(2, 2)), grid);
    }
}
