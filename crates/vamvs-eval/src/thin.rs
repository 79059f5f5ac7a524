//! Thinning a cloud to a minimum distance between points, as DTU's benchmark does.
//!
//! `reducePts_haa.m` visits the points in random order; a point that is still there removes all others
//! within the distance. So the result depends on the order alone: a point stays if and only if no earlier
//! point within the distance stays. This is computed in parallel, in rounds over all points, sorted by
//! cells of space; few rounds are needed (Blelloch, Fineman & Shun 2012).

use std::ops::Range;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::cells::{self, TooFine};

/// Number of points that a task handles in a round.
const CHUNK: usize = 1 << 14;

/// The decision about a point.
const OPEN: u8 = 0;
const KEPT: u8 = 1;
const REMOVED: u8 = 2;

/// The points that remain, in their original order. No two of them are within `distance` of each other (a
/// distance of exactly that counts as within). Points are visited in a random order drawn from `seed`; the
/// result depends on nothing else.
///
/// # Errors
/// If the distance is too small for the cloud's extent.
pub fn thin(points: &[[f64; 3]], distance: f64, seed: u64) -> Result<Vec<[f64; 3]>, TooFine> {
    let sites = sites(points, distance, seed)?;
    let decisions = decisions(&sites, distance * distance);
    let mut kept: Vec<u32> = sites
        .iter()
        .zip(&decisions)
        .filter(|(_, decision)| decision.load(Relaxed) == KEPT)
        .map(|(s, _)| s.point)
        .collect();
    kept.par_sort_unstable();
    Ok(kept.into_iter().map(|point| points[point as usize]).collect())
}

/// A point with its cell and rank.
struct Site {
    x: [f64; 3],
    /// The cell's numbers along z, y, x; the side of a cell is the distance.
    cell: [i32; 3],
    /// The point's position in the order of visits.
    rank: u32,
    point: u32,
}

fn sites(points: &[[f64; 3]], distance: f64, seed: u64) -> Result<Vec<Site>, TooFine> {
    let mut order: Vec<u32> = (0..cells::index(points.len())).collect();
    order.shuffle(&mut Pcg64::seed_from_u64(seed));
    let mut ranks = vec![0; points.len()];
    (0..).zip(order).for_each(|(rank, point)| ranks[point as usize] = rank);
    let entries = cells::sorted(points, distance, 0.0)?;
    let site = |entry: &cells::Entry| {
        let point = entry.point as usize;
        Site { x: points[point], cell: entry.cell, rank: ranks[point], point: entry.point }
    };
    Ok(entries.par_iter().map(site).collect())
}

/// Decides all points. Decisions are final, so tasks may see decisions that others make in the same round.
fn decisions(sites: &[Site], squared_distance: f64) -> Vec<AtomicU8> {
    let decisions: Vec<AtomicU8> = sites.iter().map(|_| AtomicU8::new(OPEN)).collect();
    let chunks: Vec<Range<usize>> =
        (0..sites.len()).step_by(CHUNK).map(|from| from..(from + CHUNK).min(sites.len())).collect();
    let round = |chunk: &Range<usize>| Sweep::new(sites, &decisions, squared_distance).decide(chunk.clone());
    while chunks.par_iter().map(round).sum::<usize>() > 0 {}
    decisions
}

/// A walk over the sites in order. For each of the nine rows of cells around a site, it remembers where the
/// previous site's neighbours began (a finger).
struct Sweep<'a> {
    sites: &'a [Site],
    decisions: &'a [AtomicU8],
    squared_distance: f64,
    fingers: [usize; 9],
}

impl<'a> Sweep<'a> {
    fn new(sites: &'a [Site], decisions: &'a [AtomicU8], squared_distance: f64) -> Self {
        Self { sites, decisions, squared_distance, fingers: [0; 9] }
    }

    /// Decides what can be decided in a range of sites; returns how many remain open.
    fn decide(&mut self, range: Range<usize>) -> usize {
        let mut open = 0;
        for at in range {
            if self.decisions[at].load(Relaxed) == OPEN {
                let decision = self.decision(at);
                self.decisions[at].store(decision, Relaxed);
                open += usize::from(decision == OPEN);
            }
        }
        open
    }

    fn decision(&mut self, at: usize) -> u8 {
        let site = &self.sites[at];
        let mut decision = KEPT;
        for row in 0..9 {
            for other in self.row(row, site.cell) {
                let before = self.sites[other].rank < site.rank;
                if before && squared(&site.x, &self.sites[other].x) <= self.squared_distance {
                    match self.decisions[other].load(Relaxed) {
                        KEPT => return REMOVED,
                        OPEN => decision = OPEN,
                        _ => {}
                    }
                }
            }
        }
        decision
    }

    /// The sites in the three cells, along x, around a cell in one of the nine rows.
    fn row(&mut self, row: usize, [z, y, x]: [i32; 3]) -> impl Iterator<Item = usize> + use<'a> {
        let (z, y) = (z + row as i32 / 3 - 1, y + row as i32 % 3 - 1);
        let first = gallop(self.sites, self.fingers[row], |site| site.cell < [z, y, x - 1]);
        self.fingers[row] = first;
        let sites = self.sites;
        (first..sites.len()).take_while(move |&at| sites[at].cell <= [z, y, x + 1])
    }
}

/// The first position from `start` on where `before` no longer holds. The search takes steps of doubling
/// length, since the position is usually near.
fn gallop(sites: &[Site], start: usize, before: impl Fn(&Site) -> bool) -> usize {
    let (mut low, mut step) = (start, 1);
    while low + step <= sites.len() && before(&sites[low + step - 1]) {
        low += step;
        step *= 2;
    }
    let high = (low + step).min(sites.len());
    low + sites[low..high].partition_point(before)
}

fn squared(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nearest::tests::scattered;

    /// `reducePts_haa.m`, one point after the other.
    fn one_by_one(points: &[[f64; 3]], distance: f64, seed: u64) -> Vec<[f64; 3]> {
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.shuffle(&mut Pcg64::seed_from_u64(seed));
        let mut there = vec![true; points.len()];
        for &id in &order {
            if there[id] {
                for other in 0..points.len() {
                    there[other] &= squared(&points[id], &points[other]) > distance * distance;
                }
                there[id] = true;
            }
        }
        (0..points.len()).filter(|&i| there[i]).map(|i| points[i]).collect()
    }

    #[test]
    fn what_remains_is_what_the_benchmarks_loop_leaves() {
        let points = scattered(4000, 5);
        for distance in [0.01, 0.05, 0.2, 2.0] {
            let thinned = thin(&points, distance, 7).unwrap();
            // `thin` shuffles 32-bit indices; the order does not depend on the indices' type.
            assert_eq!(thinned, one_by_one(&points, distance, 7), "distance {distance}");
        }
    }

    #[test]
    fn a_lattice_at_exactly_the_distance_is_thinned_and_a_wider_one_is_not() {
        let line =
            |step: f64| -> Vec<[f64; 3]> { (0..100).map(|i| [f64::from(i) * step, 0.0, 0.0]).collect() };
        let thinned = thin(&line(0.25), 0.25, 1).unwrap();
        assert!((34..=50).contains(&thinned.len()), "{}", thinned.len());
        assert!(thinned.windows(2).all(|pair| (0.5..=0.75).contains(&(pair[1][0] - pair[0][0]))));
        assert_eq!(thin(&line(0.251), 0.25, 1).unwrap().len(), 100);
    }

    #[test]
    fn equal_points_leave_one_and_seeds_give_other_choices() {
        assert_eq!(thin(&[[1.0, 2.0, 3.0]; 50], 0.2, 0).unwrap(), [[1.0, 2.0, 3.0]]);
        assert!(thin(&[], 0.2, 0).unwrap().is_empty());
        let points = scattered(2000, 3);
        assert_ne!(thin(&points, 0.1, 0).unwrap(), thin(&points, 0.1, 1).unwrap());
    }
}
