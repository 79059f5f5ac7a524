//! One bit a pixel.

use serde::{Deserialize, Serialize};
use vamvs_core::Size;

/// A raster of bits; each row begins with a new word, so that rows can be written in parallel.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct BitGrid {
    words_per_row: usize,
    words: Vec<u64>,
}

impl BitGrid {
    /// All bits 0.
    pub fn zeros(size: Size) -> Self {
        let words_per_row = size.width.div_ceil(64);
        Self { words_per_row, words: vec![0; words_per_row * size.height] }
    }

    /// Whether the bit of `(x, y)` is 1.
    pub fn get(&self, x: usize, y: usize) -> bool {
        self.words[y * self.words_per_row + x / 64] >> (x % 64) & 1 == 1
    }

    /// Whether the bit of the pixel at index `place` of a raster of this width is 1.
    pub fn at(&self, place: usize, width: usize) -> bool {
        let (place, width) = (place as u32, width as u32);
        let y = place / width;
        self.get((place - y * width) as usize, y as usize)
    }

    /// The words of row `y`.
    pub fn row(&self, y: usize) -> &[u64] {
        &self.words[y * self.words_per_row..(y + 1) * self.words_per_row]
    }

    /// Bytes held in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.words[..])
    }

    /// The words of each row; bit x is bit x mod 64 of word x / 64.
    pub fn rows_mut(&mut self) -> rayon::slice::ChunksMut<'_, u64> {
        rayon::slice::ParallelSliceMut::par_chunks_mut(&mut self.words[..], self.words_per_row.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn bits_are_set_one_by_one() {
        let mut bits = BitGrid::zeros(Size::new(130, 3));
        bits.rows_mut().enumerate().for_each(|(y, row)| row[y] |= 2);
        for y in 0..3 {
            for x in 0..130 {
                assert_eq!(bits.get(x, y), x == 64 * y + 1);
            }
        }
    }
}
