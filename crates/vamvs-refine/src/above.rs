//! Which regions of a photograph reach its upper border.

use vamvs_core::{Grid, Size};

use crate::segments::{BLOCK, adjacent};

/// Blocks of 8×8 pixels that are mostly of a kind, and from which others like them lead to the upper border.
pub(crate) struct Reached {
    blocks: Size,
    is_reached: Vec<bool>,
}

impl Reached {
    /// Whether a pixel is in such a block or beside one.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        let block = y / BLOCK * self.blocks.width + x / BLOCK;
        self.is_reached[block] || adjacent(block, self.blocks).any(|beside| self.is_reached[beside])
    }
}

/// The blocks mostly of pixels of a kind that reach the upper border.
pub(crate) fn reached(of_kind: &Grid<bool>) -> Reached {
    let size = of_kind.size();
    let blocks = Size::new(size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
    let is_mostly = |block: usize| {
        let (left, top) = (block % blocks.width * BLOCK, block / blocks.width * BLOCK);
        let (right, bottom) = ((left + BLOCK).min(size.width), (top + BLOCK).min(size.height));
        let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
        2 * pixels.filter(|&(x, y)| of_kind[(x, y)]).count() > (right - left) * (bottom - top)
    };
    let mut is_open: Vec<bool> = (0..blocks.area()).map(is_mostly).collect();
    let mut is_reached = vec![false; blocks.area()];
    let mut next: Vec<usize> = (0..blocks.width).collect();
    while let Some(block) = next.pop() {
        if std::mem::take(&mut is_open[block]) {
            is_reached[block] = true;
            next.extend(adjacent(block, blocks));
        }
    }
    Reached { blocks, is_reached }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_reaches_the_upper_border_is_found_and_other_regions_are_not() {
        let size = Size::new(100, 60);
        let is_sky = |x: usize, y: usize| y < 24 && x < 48;
        let is_table = |x: usize, y: usize| y >= 16 && x >= 64;
        let open = reached(&Grid::from_fn(size, |x, y| is_sky(x, y) || is_table(x, y)));
        assert!(open.contains(0, 0) && open.contains(47, 23) && open.contains(50, 10));
        assert!(
            !open.contains(75, 30)
                && !open.contains(99, 59)
                && !open.contains(64, 16)
                && !open.contains(57, 10)
                && !open.contains(20, 50)
        );
    }
}
