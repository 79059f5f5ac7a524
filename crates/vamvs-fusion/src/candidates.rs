//! Pixels of a row that are not decided yet.
//!
//! Views are asked about them one after the other, and most are soon decided. Before the next view those that are left are
//! packed into fewer strips, so that none is projected for a few pixels.

use crate::lanes::{BLOCK, LANES, any_of_block, first_lanes, set_bits};
use crate::round_trip::Strip;

/// Candidates move together if that frees at least this share of the blocks in which some are open.
const FREED: f32 = 0.25;

/// Candidates, one a lane, with values of each. Lanes that are not open may hold pixels that were moved.
pub(crate) struct Candidates<T> {
    pub strip: Strip,
    pub values: T,
    /// Those that are not decided, one bit each.
    pub open: u64,
}

/// Values of many lanes.
pub(crate) trait Lanewise {
    /// The values of a lane.
    type Lane: Copy;

    fn lane(&self, lane: usize) -> Self::Lane;

    fn set_lane(&mut self, lane: usize, values: Self::Lane);
}

impl Lanewise for () {
    type Lane = ();

    fn lane(&self, _: usize) {}

    fn set_lane(&mut self, _: usize, (): ()) {}
}

impl<T: Lanewise> Candidates<T> {
    /// The columns of some lanes, ascending.
    pub fn columns(&self, lanes: u64) -> impl Iterator<Item = usize> {
        set_bits(lanes).map(|lane| self.strip.x[lane] as usize)
    }

    fn lane(&self, lane: usize) -> (f32, f32, T::Lane) {
        (self.strip.x[lane], self.strip.inverse_depth[lane], self.values.lane(lane))
    }

    fn set_lane(&mut self, lane: usize, (x, inverse_depth, values): (f32, f32, T::Lane)) {
        (self.strip.x[lane], self.strip.inverse_depth[lane]) = (x, inverse_depth);
        self.values.set_lane(lane, values);
    }
}

/// Drops strips without an open candidate, and moves the open ones together, in their order, if that is worth it.
pub(crate) fn move_together<T: Lanewise>(all: &mut Vec<Candidates<T>>) {
    all.retain(|candidates| candidates.open != 0);
    let open_blocks = |candidates: &Candidates<T>| {
        (0..LANES / BLOCK).filter(|&number| any_of_block(candidates.open, number)).count()
    };
    let blocks: usize = all.iter().map(open_blocks).sum();
    let open: usize = all.iter().map(|candidates| candidates.open.count_ones() as usize).sum();
    if open.div_ceil(BLOCK) as f32 > (1.0 - FREED) * blocks as f32 {
        return;
    }
    let mut moved = 0;
    for number in 0..all.len() {
        for lane in set_bits(all[number].open) {
            let values = all[number].lane(lane);
            all[moved / LANES].set_lane(moved % LANES, values);
            moved += 1;
        }
    }
    all.truncate(open.div_ceil(LANES));
    for (number, candidates) in all.iter_mut().enumerate() {
        candidates.open = first_lanes((open - number * LANES).min(LANES));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_candidates_move_together_in_their_order() {
        let candidates = |first: usize, open: u64| {
            let mut strip = Strip::empty(0.5);
            for lane in 0..LANES {
                (strip.x[lane], strip.inverse_depth[lane]) =
                    ((first + lane) as f32 + 0.5, 1.0 + (first + lane) as f32);
            }
            Candidates { strip, values: (), open }
        };
        let mut all = vec![candidates(0, u64::MAX), candidates(64, u64::MAX >> 1), candidates(128, u64::MAX)];
        move_together(&mut all);
        assert_eq!(all.len(), 3, "one lane is not worth it");
        let sparse = 1 << 63 | 1 << 40 | 1;
        let mut all = vec![candidates(0, 0b1010), candidates(64, u64::MAX), candidates(128, sparse)];
        let columns: Vec<usize> = [1, 3].into_iter().chain(64..128).chain([128, 168, 191]).collect();
        move_together(&mut all);
        let found: Vec<usize> =
            all.iter().flat_map(|candidates| candidates.columns(candidates.open)).collect();
        assert_eq!((found, all.len()), (columns, 2));
        let depths = |all: &Candidates<()>| (all.strip.inverse_depth[0], all.strip.inverse_depth[2]);
        assert_eq!((depths(&all[0]), depths(&all[1]).0), ((2.0, 65.0), 127.0));
        all[0].open = 0;
        all[1].open = 0;
        move_together(&mut all);
        assert!(all.is_empty());
    }
}
