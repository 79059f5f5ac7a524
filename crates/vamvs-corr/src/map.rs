//! Images and volumes of features.

use std::borrow::Cow;
use std::mem::MaybeUninit;

use rayon::prelude::*;

use crate::wide::{add, relu};

/// A volume of features, or an image, which has one plane. The channels of a position are contiguous, then those of its row,
/// its plane, the volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Planes; one of an image.
    pub planes: usize,
    /// Rows.
    pub height: usize,
    /// Pixels of a row.
    pub width: usize,
    /// Values of a pixel.
    pub channels: usize,
    /// (planes, height, width, channels)
    pub values: Vec<f32>,
}

/// A row of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Its plane.
    pub z: usize,
    /// Its place in the plane.
    pub y: usize,
}

impl Map {
    /// A map of these sides [planes, height, width] and channels, of zeros.
    pub fn new([planes, height, width]: [usize; 3], channels: usize) -> Self {
        Self { planes, height, width, channels, values: vec![0.0; planes * height * width * channels] }
    }

    /// An image of these values.
    pub fn image((width, height, channels): (usize, usize, usize), values: Vec<f32>) -> Self {
        assert_eq!(
            values.len(),
            width * height * channels,
            "an image has a value for each channel of its pixels"
        );
        Self { planes: 1, height, width, channels, values }
    }

    /// Planes, height and width.
    pub fn sides(&self) -> [usize; 3] {
        [self.planes, self.height, self.width]
    }

    /// The values of a row.
    pub fn row(&self, Row { z, y }: Row) -> &[f32] {
        let length = self.width * self.channels;
        &self.values[(z * self.height + y) * length..][..length]
    }

    /// The values of a row of an image.
    pub fn line(&self, y: usize) -> &[f32] {
        self.row(Row { z: 0, y })
    }

    /// Makes a map row by row, in parallel, from rows of zeros.
    pub fn by_rows(sides: [usize; 3], channels: usize, make: impl Fn(Row, &mut [f32]) + Sync) -> Self {
        Self::by_rows_with(sides, channels, || (), |(), row, values| make(row, values))
    }

    /// As [`Map::by_rows`], with scratch memory for each thread.
    pub fn by_rows_with<S>(
        sides: [usize; 3],
        channels: usize,
        scratch: impl Fn() -> S + Sync + Send,
        make: impl Fn(&mut S, Row, &mut [f32]) + Sync,
    ) -> Self {
        Self::filled(sides, channels, |rows| {
            let rows = rows.par_chunks_exact_mut(sides[2] * channels).enumerate();
            rows.for_each_init(scratch, |scratch, (at, row)| {
                make(scratch, Row { z: at / sides[1], y: at % sides[1] }, zeroed(row));
            });
        })
    }

    /// Makes a map in parallel, row `y` of all planes at once, from rows of zeros.
    pub fn through_planes(
        sides: [usize; 3],
        channels: usize,
        make: impl Fn(usize, &mut [&mut [f32]]) + Sync,
    ) -> Self {
        Self::filled(sides, channels, |all| {
            let mut rows: Vec<Vec<_>> = (0..sides[1]).map(|_| Vec::with_capacity(sides[0])).collect();
            for (at, row) in all.chunks_exact_mut(sides[2] * channels).enumerate() {
                rows[at % sides[1]].push(row);
            }
            rows.into_par_iter().enumerate().for_each(|(y, planes)| {
                make(y, &mut planes.into_iter().map(zeroed).collect::<Vec<_>>());
            });
        })
    }

    /// A map whose values `fill` writes, all of them. Memory is not set to zero before, because one thread alone would do that.
    fn filled(
        [planes, height, width]: [usize; 3],
        channels: usize,
        fill: impl FnOnce(&mut [MaybeUninit<f32>]),
    ) -> Self {
        let count = planes * height * width * channels;
        let mut values = Vec::with_capacity(count);
        fill(&mut values.spare_capacity_mut()[..count]);
        // SAFETY: both callers pass every row to `zeroed`: `chunks_exact_mut` by a divisor of the length leaves nothing out.
        unsafe { values.set_len(count) };
        Self { planes, height, width, channels, values }
    }

    /// The map with each side extended to a multiple of `of` [planes, height, width] by repeating its last values.
    pub fn padded(&self, of: [usize; 3]) -> Cow<'_, Self> {
        let sides: [usize; 3] = std::array::from_fn(|axis| self.sides()[axis].next_multiple_of(of[axis]));
        self.sized(sides)
    }

    /// The first part of these sides; where they are larger, the last values are repeated.
    pub fn sized(&self, sides: [usize; 3]) -> Cow<'_, Self> {
        if sides == self.sides() {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self::by_rows(sides, self.channels, |Row { z, y }, to| {
            let from = self.row(Row { z: z.min(self.planes - 1), y: y.min(self.height - 1) });
            let shared = to.len().min(from.len());
            to[..shared].copy_from_slice(&from[..shared]);
            let last = &from[from.len() - self.channels..];
            to[shared..].chunks_exact_mut(self.channels).for_each(|pixel| pixel.copy_from_slice(last));
        }))
    }

    /// A part of an image.
    pub fn part(&self, (x, y): (usize, usize), (width, height): (usize, usize)) -> Self {
        Self::by_rows([1, height, width], self.channels, |row, to| {
            to.copy_from_slice(&self.line(y + row.y)[x * self.channels..][..width * self.channels]);
        })
    }

    /// An image of half the size: each pixel is the mean of four. An odd last row or column is left out.
    pub fn halved(&self) -> Self {
        let c = self.channels;
        Self::by_rows([1, self.height / 2, self.width / 2], c, |Row { y, .. }, to| {
            let (above, below) = (self.line(2 * y), self.line(2 * y + 1));
            for (x, to) in to.chunks_exact_mut(c).enumerate() {
                for (channel, to) in to.iter_mut().enumerate() {
                    let (left, right) = (2 * x * c + channel, (2 * x + 1) * c + channel);
                    *to = 0.25 * (above[left] + above[right] + below[left] + below[right]);
                }
            }
        })
    }

    /// An image of twice the size by bilinear interpolation between pixel centres, cut to `width` × `height`, plus `others`.
    pub fn enlarged_onto(&self, others: &Self, then_relu: bool) -> Self {
        let c = self.channels;
        Self::by_rows(others.sides(), c, |Row { y, .. }, to| {
            self.enlarged_row(y, to);
            add(to, others.line(y));
            if then_relu {
                relu(to);
            }
        })
    }

    /// An image enlarged bilinearly to these sides, at most twice its own.
    pub fn enlarged(&self, sides: [usize; 3]) -> Self {
        Self::by_rows(sides, self.channels, |Row { y, .. }, to| self.enlarged_row(y, to))
    }

    /// Row `y` of the image at twice its size.
    fn enlarged_row(&self, y: usize, to: &mut [f32]) {
        let c = self.channels;
        let neighbour = |at: usize, last: usize| {
            if at.is_multiple_of(2) { (at / 2).saturating_sub(1) } else { (at / 2 + 1).min(last) }
        };
        let (near, far) = (self.line(y / 2), self.line(neighbour(y, self.height - 1)));
        for (x, to) in to.chunks_exact_mut(c).enumerate() {
            let (a, b) = (x / 2 * c, neighbour(x, self.width - 1) * c);
            for channel in 0..c {
                let of = |row: &[f32]| 0.75 * row[a + channel] + 0.25 * row[b + channel];
                to[channel] = 0.75 * of(near) + 0.25 * of(far);
            }
        }
    }
}

/// Writes zeros.
fn zeroed(row: &mut [MaybeUninit<f32>]) -> &mut [f32] {
    row.fill(MaybeUninit::new(0.0));
    // SAFETY: every value has just been written, and a written `MaybeUninit` is laid out as its value.
    unsafe { &mut *(std::ptr::from_mut(row) as *mut [f32]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: usize, height: usize) -> Map {
        let values = (0..width * height).flat_map(|i| [i as f32, -(i as f32)]).collect();
        Map::image((width, height, 2), values)
    }

    #[test]
    fn enlarged_and_halved_keep_the_centres() {
        let map = ramp(6, 5);
        let twice = map.enlarged([1, 10, 12]);
        let back = twice.halved();
        // Inside, interpolation of a plane is exact.
        for y in 1..4 {
            for x in 1..5 {
                let at = (y * 6 + x) * 2;
                assert!((back.values[at] - map.values[at]).abs() < 1e-4, "({x}, {y})");
            }
        }
        assert_eq!(twice.line(0)[0], map.values[0], "the border is repeated");
    }

    #[test]
    fn padding_repeats_the_last_values() {
        let small = ramp(3, 2);
        let map = small.padded([2, 4, 4]);
        assert_eq!(map.sides(), [2, 4, 4]);
        assert_eq!(map.row(Row { z: 1, y: 3 }), map.row(Row { z: 0, y: 1 }));
        assert_eq!(map.line(1)[4..], [5.0, -5.0, 5.0, -5.0]);
        assert_eq!(*map.sized([1, 2, 3]), small);
    }

    #[test]
    fn rows_through_all_planes_are_those_of_the_planes() {
        let value = |z: usize, y: usize, at: usize| (100 * z + 10 * y + at) as f32;
        let by_rows = Map::by_rows([3, 4, 2], 2, |Row { z, y }, to| {
            to.iter_mut().enumerate().for_each(|(at, to)| *to += value(z, y, at));
        });
        let through = Map::through_planes([3, 4, 2], 2, |y, planes| {
            for (z, to) in planes.iter_mut().enumerate() {
                to.iter_mut().enumerate().for_each(|(at, to)| *to += value(z, y, at));
            }
        });
        assert_eq!(by_rows, through);
        assert_eq!(by_rows.row(Row { z: 2, y: 3 }), [230.0, 231.0, 232.0, 233.0]);
    }

    #[test]
    fn a_part_is_where_it_was() {
        assert_eq!(ramp(4, 3).part((1, 2), (2, 1)).values, [9.0, -9.0, 10.0, -10.0]);
    }
}
