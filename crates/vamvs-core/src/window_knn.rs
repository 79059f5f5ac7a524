//! Nearest neighbours among the hypothesised points of nearby pixels.
//!
//! Section 3.3 looks for the neighbours of a point only among the points of a window of pixels around
//! its own pixel: points near each other in space are almost always near each other in the image. The
//! search is exact within the window, which is clipped at the image's border.

use rayon::prelude::*;

/// A search for the `k` nearest points within a window of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WindowKnn {
    /// Number of neighbours, the point itself included.
    pub k: usize,
    /// The window has `2 · radius + 1` pixels in each row and column.
    pub radius: usize,
    /// Spacing of the window's pixels, pixels; at least 1.
    pub dilation: usize,
}

impl WindowKnn {
    /// Writes the indices of each point's `k` nearest neighbours, nearest first; of equally near ones
    /// the lower index comes first.
    ///
    /// Hypothesis `j` of pixel `(x, y)` is `points[(y * width + x) * hypotheses + j]`. Its candidates
    /// are all hypotheses, itself included, of the window's pixels that are inside the image. With `P`
    /// points, `out` is `(P, k)`, row-major. If a window holds fewer than `k` points, the list of
    /// those found is repeated. Points that are not finite come last.
    ///
    /// # Panics
    /// If `points` or `out` do not have that many elements, or the dilation is 0.
    pub fn neighbours(
        &self,
        points: &[[f32; 3]],
        width: usize,
        height: usize,
        hypotheses: usize,
        out: &mut [i64],
    ) {
        assert_eq!(points.len(), width * height * hypotheses, "points: one per pixel and hypothesis");
        assert_eq!(out.len(), points.len() * self.k, "out: k indices per point");
        assert!(self.dilation > 0, "dilation: at least 1");
        if out.is_empty() {
            return;
        }
        let layout = Layout { points, width, height, hypotheses };
        let pixel_len = hypotheses * self.k;
        out.par_chunks_mut(width * pixel_len).enumerate().for_each_init(
            Candidates::default,
            |window, (y, row)| {
                for (x, pixel) in row.chunks_exact_mut(pixel_len).enumerate() {
                    window.gather(&layout, self, x, y);
                    for (point, nearest) in layout.pixel(x, y).iter().zip(pixel.chunks_exact_mut(self.k)) {
                        window.nearest(point, nearest);
                    }
                }
            },
        );
    }

    /// The window's pixels along one axis of `count` pixels, without those outside of the image.
    fn coordinates(&self, centre: usize, count: usize) -> impl Iterator<Item = usize> {
        let before = self.radius.min(centre / self.dilation);
        let first = centre - before * self.dilation;
        (first..count).step_by(self.dilation).take(before + 1 + self.radius)
    }
}

/// The points, addressed by pixel.
struct Layout<'a> {
    points: &'a [[f32; 3]],
    width: usize,
    height: usize,
    hypotheses: usize,
}

impl Layout<'_> {
    /// Index of a pixel's first hypothesis.
    fn index(&self, x: usize, y: usize) -> usize {
        (y * self.width + x) * self.hypotheses
    }

    /// A pixel's hypotheses.
    fn pixel(&self, x: usize, y: usize) -> &[[f32; 3]] {
        &self.points[self.index(x, y)..][..self.hypotheses]
    }
}

/// Number of groups into which the candidates are split to bound the distance of the k-th nearest.
const LANES: usize = 16;

/// The points of one window by increasing index, one array per coordinate, with scratch memory for the
/// search.
#[derive(Default)]
struct Candidates {
    index: Vec<i64>,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// The bits of the squared distances (floats ≥ 0 are ordered like their bits), then `i32::MAX` up
    /// to a multiple of [`LANES`].
    distance: Vec<i32>,
    /// Sort keys: a distance in the upper 32 bits, the candidate's position in `index` in the lower.
    keys: Vec<u64>,
}

impl Candidates {
    /// Collects the window around a pixel.
    fn gather(&mut self, layout: &Layout, window: &WindowKnn, x: usize, y: usize) {
        self.index.clear();
        for coordinates in [&mut self.x, &mut self.y, &mut self.z] {
            coordinates.clear();
        }
        for v in window.coordinates(y, layout.height) {
            for u in window.coordinates(x, layout.width) {
                for (point, index) in layout.pixel(u, v).iter().zip(layout.index(u, v)..) {
                    self.index.push(index as i64);
                    self.x.push(point[0]);
                    self.y.push(point[1]);
                    self.z.push(point[2]);
                }
            }
        }
        self.distance.resize(self.index.len().next_multiple_of(LANES), 0);
        self.keys.resize(self.index.len(), 0);
    }

    /// Writes the indices of the candidates nearest to a point.
    ///
    /// Only the candidates within a bound that at least k of them satisfy are sorted.
    fn nearest(&mut self, point: &[f32; 3], out: &mut [i64]) {
        self.measure(point);
        let bound = self.bound(out.len());
        let within = self.collect_keys(bound);
        self.keys[..within].sort_unstable();
        for (out, key) in out.iter_mut().zip(self.keys[..within].iter().cycle()) {
            *out = self.index[*key as u32 as usize];
        }
    }

    fn measure(&mut self, [px, py, pz]: &[f32; 3]) {
        let count = self.index.len();
        let (distance, rest) = self.distance.split_at_mut(count);
        let coordinates = self.x.iter().zip(&self.y).zip(&self.z);
        for (distance, ((x, y), z)) in distance.iter_mut().zip(coordinates) {
            let (dx, dy, dz) = (x - px, y - py, z - pz);
            // The sign bit is cleared, since a NaN may have it; so NaN comes after all numbers.
            *distance = (dx * dx + dy * dy + dz * dz).abs().to_bits() as i32;
        }
        rest.fill(i32::MAX);
    }

    /// A distance that at least `k` candidates do not exceed (all candidates, if there are fewer): the
    /// largest of the minima of [`LANES`] disjoint groups.
    fn bound(&self, k: usize) -> i32 {
        if k > LANES {
            return i32::MAX;
        }
        let mut least = [i32::MAX; LANES];
        for group in self.distance.chunks_exact(LANES) {
            for (least, distance) in least.iter_mut().zip(group) {
                *least = (*least).min(*distance);
            }
        }
        least.into_iter().fold(0, i32::max)
    }

    /// Writes the keys of the candidates within a bound and returns their number. The loop has no
    /// branch: each key is written, and the next one overwrites it unless it is within the bound.
    fn collect_keys(&mut self, bound: i32) -> usize {
        let mut within = 0;
        for (&distance, place) in self.distance[..self.index.len()].iter().zip(0_u64..) {
            self.keys[within] = (distance as u64) << 32 | place;
            within += usize::from(distance <= bound);
        }
        within
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZero;

    use kiddo::{ImmutableKdTree, SquaredEuclidean};
    use proptest::prelude::*;

    use super::*;

    /// The definition: all points of the window, sorted by distance, then index.
    fn brute_force(
        search: &WindowKnn,
        points: &[[f32; 3]],
        width: usize,
        height: usize,
        m: usize,
    ) -> Vec<i64> {
        let mut all = Vec::new();
        for (p, point) in points.iter().enumerate() {
            let mut found: Vec<(f32, usize)> = window(search, p, width, height, m)
                .map(|q| ((0..3).map(|i| (points[q][i] - point[i]).powi(2)).sum::<f32>().abs(), q))
                .collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            all.extend(found.iter().cycle().take(search.k).map(|&(_, q)| q as i64));
        }
        all
    }

    /// The points of the window around point `p`.
    fn window(s: &WindowKnn, p: usize, width: usize, height: usize, m: usize) -> impl Iterator<Item = usize> {
        let (px, py) = ((p / m % width) as isize, (p / m / width) as isize);
        let (r, d) = (s.radius as isize, s.dilation as isize);
        let inside =
            move |x: &isize, y: &isize| (0..width as isize).contains(x) && (0..height as isize).contains(y);
        (-r..=r)
            .flat_map(move |dy| (-r..=r).map(move |dx| (px + d * dx, py + d * dy)))
            .filter(move |(x, y)| inside(x, y))
            .flat_map(move |(x, y)| (0..m).map(move |j| (y as usize * width + x as usize) * m + j))
    }

    fn neighbours(
        search: &WindowKnn,
        points: &[[f32; 3]],
        width: usize,
        height: usize,
        m: usize,
    ) -> Vec<i64> {
        let mut out = vec![-1; points.len() * search.k];
        search.neighbours(points, width, height, m, &mut out);
        out
    }

    /// Hypotheses of a wavy depth map.
    fn wavy_points(width: usize, height: usize, m: usize) -> Vec<[f32; 3]> {
        let mut points = Vec::new();
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let depth = 4.0 + (0.7 * x as f32).sin() + 0.3 * (1.3 * (x * y) as f32).cos();
            let ray = [(x as f32 - 9.0) / 30.0, (y as f32 - 7.0) / 30.0, 1.0];
            points.extend((0..m).map(|j| ray.map(|r| r * (depth + 0.03 * j as f32))));
        }
        points
    }

    #[test]
    fn equals_brute_force_for_every_dilation_up_to_the_borders() {
        let points = wavy_points(19, 14, 5);
        for dilation in [1, 2, 4] {
            let search = WindowKnn { k: 16, radius: 2, dilation };
            assert_eq!(neighbours(&search, &points, 19, 14, 5), brute_force(&search, &points, 19, 14, 5));
        }
    }

    #[test]
    fn equals_a_kd_tree_of_the_window() {
        let (width, height, m) = (11, 9, 5);
        let points = wavy_points(width, height, m);
        let search = WindowKnn { k: 16, radius: 2, dilation: 2 };
        let found = neighbours(&search, &points, width, height, m);
        for (p, found) in found.chunks_exact(16).enumerate() {
            let candidates: Vec<usize> = window(&search, p, width, height, m).collect();
            let positions: Vec<[f32; 3]> = candidates.iter().map(|&q| points[q]).collect();
            let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&positions).unwrap();
            let query = tree.query(&points[p]).nearest_n::<SquaredEuclidean<f32>>(NonZero::new(16).unwrap());
            // Distances, because the tree does not say which of two equally near points comes first.
            let found =
                found.iter().map(|&q| (0..3).map(|i| (points[q as usize][i] - points[p][i]).powi(2)).sum());
            assert!(query.execute().iter().map(|n| n.distance).eq::<Vec<f32>>(found.collect()));
        }
    }

    #[test]
    fn ties_go_to_the_lower_index_and_the_window_does_not_wrap_around() {
        let points = [[1.0; 3]; 12];
        let found = neighbours(&WindowKnn { k: 4, radius: 1, dilation: 1 }, &points, 4, 3, 1);
        assert_eq!(found[..4], [0, 1, 4, 5], "corner (0, 0)");
        assert_eq!(found[4 * 7..][..4], [2, 3, 6, 7], "right border (3, 1)");
        assert_eq!(found[4 * 8..][..4], [4, 5, 8, 9], "corner (0, 2)");
    }

    #[test]
    fn too_few_candidates_are_repeated_in_order() {
        let points = [[0.0; 3], [5.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let found = neighbours(&WindowKnn { k: 7, radius: 2, dilation: 1 }, &points, 3, 1, 1);
        assert_eq!(found[..7], [0, 2, 1, 0, 2, 1, 0]);
        let alone = neighbours(&WindowKnn { k: 3, radius: 2, dilation: 4 }, &points, 3, 1, 1);
        assert_eq!(alone, [0, 0, 0, 1, 1, 1, 2, 2, 2]);
    }

    #[test]
    fn points_that_are_not_finite_come_last() {
        let mut points = wavy_points(5, 4, 1);
        points[7] = [-f32::NAN; 3];
        points[8] = [f32::INFINITY; 3];
        let found = neighbours(&WindowKnn { k: 16, radius: 4, dilation: 1 }, &points, 5, 4, 1);
        for (p, found) in found.chunks_exact(16).enumerate() {
            let mut distinct = found.to_vec();
            distinct.sort_unstable();
            distinct.dedup();
            assert_eq!(distinct.len(), 16, "point {p} has 16 different neighbours");
            assert!(p == 7 || p == 8 || found.iter().all(|q| ![7, 8].contains(q)));
        }
    }

    #[test]
    fn nothing_to_search_is_no_error() {
        assert!(neighbours(&WindowKnn { k: 16, radius: 2, dilation: 1 }, &[], 0, 0, 5).is_empty());
        assert!(neighbours(&WindowKnn { k: 0, radius: 2, dilation: 1 }, &[[0.0; 3]], 1, 1, 1).is_empty());
    }

    proptest! {
        #[test]
        fn equals_brute_force(
            (width, height, m) in (1_usize..9, 1_usize..9, 1_usize..6),
            (k, radius, dilation) in (1_usize..40, 0_usize..4, 1_usize..5),
            coarse in proptest::collection::vec(proptest::array::uniform3(0_u8..7), 8 * 8 * 5),
        ) {
            // Few distinct coordinates, so that there are many ties, and some NaN.
            let number = |v: u8| if v == 6 { -f32::NAN } else { f32::from(v) };
            let points: Vec<_> = coarse[..width * height * m].iter().map(|p| p.map(number)).collect();
            let search = WindowKnn { k, radius, dilation };
            prop_assert_eq!(
                neighbours(&search, &points, width, height, m),
                brute_force(&search, &points, width, height, m)
            );
        }
    }
}
