//! Exact nearest neighbours of many points in a cloud, in parallel.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::cells::{bounds, index};

/// Bits per coordinate of a Morton code.
const BITS: u32 = 21;

/// A cloud indexed for nearest-neighbour queries.
pub struct Neighbours {
    /// `None` if the cloud has no points.
    tree: Option<ImmutableKdTree<f64, 3>>,
}

/// The nearest point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Its distance, scene units; infinite if the cloud has no points.
    pub distance: f64,
    /// Its index in the cloud; 0 if the cloud has no points.
    pub point: u32,
}

impl Neighbours {
    /// Prepares a cloud of finite points.
    #[must_use]
    pub fn new(points: &[[f64; 3]]) -> Self {
        let build = || ImmutableKdTree::new_from_slice(points).expect("a cloud has fewer than 2³² points");
        Self { tree: (!points.is_empty()).then(build) }
    }

    /// The nearest point of each of `queries`, in their order. The queries must be finite.
    ///
    /// The tree is searched in the queries' Morton order, which is several times faster than any other
    /// order: each search finds the nodes it needs in the processor's cache, where the one before has left
    /// them.
    #[must_use]
    pub fn nearest(&self, queries: &[[f64; 3]]) -> Vec<Nearest> {
        let Some(tree) = &self.tree else {
            return vec![Nearest { distance: f64::INFINITY, point: 0 }; queries.len()];
        };
        let order = order_in_space(queries);
        let ask = |&query: &u32| {
            let asked = tree.query(&queries[query as usize]);
            let found = asked.nearest_one::<SquaredEuclidean<f64>>().execute();
            Nearest { distance: found.distance.sqrt(), point: found.item }
        };
        let found: Vec<Nearest> = order.par_iter().map(ask).collect();
        let mut nearest = vec![Nearest { distance: f64::INFINITY, point: 0 }; queries.len()];
        order.iter().zip(found).for_each(|(&query, found)| nearest[query as usize] = found);
        nearest
    }

    /// The distance from each of `queries` to its nearest point; infinite if the cloud has no points.
    #[must_use]
    pub fn distances(&self, queries: &[[f64; 3]]) -> Vec<f64> {
        self.nearest(queries).into_iter().map(|nearest| nearest.distance).collect()
    }
}

/// The distance from each point of `from` to the nearest point of `to`; infinite if `to` is empty.
#[must_use]
pub fn nearest_distances(from: &[[f64; 3]], to: &[[f64; 3]]) -> Vec<f64> {
    Neighbours::new(to).distances(from)
}

/// Indices of the points in Morton order (along a Z curve) in their bounding box.
fn order_in_space(points: &[[f64; 3]]) -> Vec<u32> {
    let (low, high) = bounds(points);
    let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(f64::MIN_POSITIVE, f64::max);
    let steps = f64::from((1_u32 << BITS) - 1) / longest;
    let place = |(point, x): (usize, &[f64; 3])| {
        let [x, y, z] =
            [0, 1, 2].map(|axis| spread((((x[axis] - low[axis]) * steps) as u64).min((1 << BITS) - 1)));
        (x | y << 1 | z << 2, index(point))
    };
    let mut places: Vec<(u64, u32)> = points.par_iter().enumerate().map(place).collect();
    places.par_sort_unstable();
    places.into_iter().map(|(_, point)| point).collect()
}

/// The lowest 21 bits, with two zero bits between neighbouring ones.
fn spread(bits: u64) -> u64 {
    let mut bits = bits;
    for (shift, mask) in [
        (32, 0x001F_0000_0000_FFFF),
        (16, 0x001F_0000_FF00_00FF),
        (8, 0x100F_00F0_0F00_F00F),
        (4, 0x10C3_0C30_C30C_30C3),
        (2, 0x1249_2492_4924_9249),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

#[cfg(test)]
pub(crate) mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Random points in the unit cube.
    pub(crate) fn scattered(count: usize, seed: u64) -> Vec<[f64; 3]> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        (0..count).map(|_| [(); 3].map(|()| random.random())).collect()
    }

    fn brute_force(x: &[f64; 3], to: &[[f64; 3]]) -> f64 {
        let squared = |y: &[f64; 3]| (0..3).map(|i| (x[i] - y[i]).powi(2)).sum::<f64>();
        to.iter().map(squared).fold(f64::INFINITY, f64::min).sqrt()
    }

    #[test]
    fn distances_equal_brute_force() {
        let (from, to) = (scattered(20_000, 1), scattered(20_000, 2));
        let found = nearest_distances(&from, &to);
        from.par_iter().zip(found).for_each(|(x, found)| assert!((found - brute_force(x, &to)).abs() < 1e-9));
    }

    #[test]
    fn the_nearest_point_is_the_one_at_the_distance() {
        let (from, to) = (scattered(1000, 3), scattered(700, 4));
        for (x, nearest) in from.iter().zip(Neighbours::new(&to).nearest(&from)) {
            assert!((brute_force(x, &[to[nearest.point as usize]]) - nearest.distance).abs() < 1e-12);
        }
    }

    #[test]
    fn many_equal_points_and_equal_coordinates_are_no_trouble() {
        let to = [vec![[1.0, 2.0, 3.0]; 5000], (0..400).map(|i| [f64::from(i), 0.0, 3.0]).collect()].concat();
        let from = scattered(500, 6);
        for (x, found) in from.iter().zip(nearest_distances(&from, &to)) {
            assert!((found - brute_force(x, &to)).abs() < 1e-12);
        }
    }

    #[test]
    fn distances_are_exact_far_from_the_origin() {
        let square = |z: f64| -> Vec<[f64; 3]> {
            (0..400).map(|i| [4.5e5 + f64::from(i % 20), 5.4e6 + f64::from(i / 20), z]).collect()
        };
        for distance in nearest_distances(&square(0.25), &square(0.0)) {
            assert!((distance - 0.25).abs() < 1e-9);
        }
        assert_eq!(nearest_distances(&square(0.0)[..2], &[]), [f64::INFINITY; 2]);
    }

    #[test]
    fn neighbours_on_the_curve_are_neighbours_in_space() {
        assert_eq!(spread(0b1011), 0b001_000_001_001);
        assert_eq!(spread((1 << BITS) - 1), 0x1249_2492_4924_9249);
        let points = scattered(4096, 9);
        let order = order_in_space(&points);
        let step = |pair: &[u32]| brute_force(&points[pair[0] as usize], &[points[pair[1] as usize]]);
        let mean = order.windows(2).map(step).sum::<f64>() / 4095.0;
        assert!(mean < 0.1, "{mean}: the mean distance of random points is 0.66");
        let mut sorted = order;
        sorted.sort_unstable();
        assert!((0..4096).eq(sorted));
    }
}
