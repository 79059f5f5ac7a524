//! The ground truth of a sample, looked up at the positions of the network's output.

use vamvs_core::depth_map::is_valid;
use vamvs_core::{Grid, Planes, Size, Visibility};

/// Neighbouring pixels are on one surface if their depths differ by at most this, relative to the smallest.
const ONE_SURFACE: f32 = 0.02;

/// The stored ground truth of a view, and the transform from a sample's image coordinates to stored ones.
#[derive(Clone, Debug)]
pub struct GroundTruth {
    /// Depths as stored, 0 where unknown.
    pub depth: Grid<f32>,
    /// Whether pixels without depth show no surface; else what they show is unknown.
    pub is_complete: bool,
    /// For each source view of the sample, the visibility of the stored pixels in it; empty if unknown.
    pub visibility: Vec<Grid<Visibility>>,
    /// Stored image coordinates of the sample's corner (0, 0).
    pub origin: [f64; 2],
    /// Stored pixels per pixel of the sample, along x and y.
    pub step: [f64; 2],
}

impl GroundTruth {
    fn stored(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.origin[0] + x * self.step[0], self.origin[1] + y * self.step[1]]
    }

    /// The depth at image coordinates of the sample. If the four surrounding pixels are on one surface, it is
    /// interpolated between them in inverse depth, which is exact on planes; else it is that of the nearest pixel.
    /// `None` where the depth is unknown or the position is outside.
    #[must_use]
    pub fn depth_at(&self, place: [f64; 2]) -> Option<f64> {
        let [x, y] = self.stored(place).map(|v| v - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let corner = |dx: f64, dy: f64| self.at(left + dx, top + dy);
        let corners = [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)];
        let nearest = self.at(x.round(), y.round());
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return nearest.map(f64::from) };
        let (low, high) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
        if high - low > ONE_SURFACE * low {
            return nearest.map(f64::from);
        }
        let [a, b, c, d] = [a, b, c, d].map(|depth| 1.0 / f64::from(depth));
        let (s, t) = (x - left, y - top);
        Some(1.0 / ((a * (1.0 - s) + b * s) * (1.0 - t) + (c * (1.0 - s) + d * s) * t))
    }

    /// The depths at the crossings of columns `xs` and rows `ys` (image coordinates of the sample), 0 where they are unknown.
    #[must_use]
    pub fn depths(&self, xs: &[f64], ys: &[f64]) -> Grid<f32> {
        let at = |x: usize, y: usize| self.depth_at([xs[x], ys[y]]).unwrap_or(0.0) as f32;
        Grid::from_fn(Size::new(xs.len(), ys.len()), at)
    }

    fn at(&self, x: f64, y: f64) -> Option<f32> {
        let inside = x >= 0.0 && y >= 0.0;
        let depth = inside.then(|| self.depth.get(x as usize, y as usize).copied()).flatten()?;
        is_valid(depth).then_some(depth)
    }

    /// Plane coordinates at the crossings of columns `xs` and rows `ys` (image coordinates of the sample), row by row.
    /// NaN where the depth is unknown or more than half a plane distance outside the planes.
    #[must_use]
    pub fn coordinates(&self, xs: &[f64], ys: &[f64], planes: &Planes) -> Vec<f32> {
        let last = (planes.count - 1) as f64;
        let coordinate = |place| {
            let u = planes.coordinate(self.depth_at(place)?);
            (-0.5..=last + 0.5).contains(&u).then_some(u as f32)
        };
        crossings(xs, ys).map(|place| coordinate(place).unwrap_or(f32::NAN)).collect()
    }

    /// Whether a surface inside the range of the planes is seen at the same crossings: 1 or 0; NaN where that is unknown, and
    /// within half a plane distance outside of the range.
    #[must_use]
    pub fn surfaces(&self, xs: &[f64], ys: &[f64], planes: &Planes) -> Vec<f32> {
        let last = (planes.count - 1) as f64;
        let surface = |place| match self.depth_at(place).map(|depth| planes.coordinate(depth)) {
            Some(u) if (0.0..=last).contains(&u) => 1.0,
            Some(u) if !(-0.5..=last + 0.5).contains(&u) => 0.0,
            None if self.is_complete && self.is_inside(place) => 0.0,
            _ => f32::NAN,
        };
        crossings(xs, ys).map(surface).collect()
    }

    fn is_inside(&self, place: [f64; 2]) -> bool {
        let [x, y] = self.stored(place);
        x >= 0.0 && y >= 0.0 && x < self.depth.width() as f64 && y < self.depth.height() as f64
    }

    /// The visibility in source view `source` at the same crossings; `None` if it is not stored.
    #[must_use]
    pub fn seen(&self, source: usize, xs: &[f64], ys: &[f64]) -> Option<Vec<Visibility>> {
        let tile = self.visibility.get(source)?;
        let seen = |place| {
            let [x, y] = self.stored(place);
            let inside = x >= 0.0 && y >= 0.0;
            inside.then(|| tile.get(x as usize, y as usize).copied()).flatten().unwrap_or_default()
        };
        Some(crossings(xs, ys).map(seen).collect())
    }
}

fn crossings(xs: &[f64], ys: &[f64]) -> impl Iterator<Item = [f64; 2]> {
    ys.iter().flat_map(move |&y| xs.iter().map(move |&x| [x, y]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{DepthRange, Size, Spacing};

    /// The plane 1 / z = 0.2 + 0.0005 x + 0.001 y in image coordinates.
    fn plane() -> GroundTruth {
        let inverse = |x: usize, y: usize| 0.2 + 5e-4 * (x as f64 + 0.5) + 1e-3 * (y as f64 + 0.5);
        GroundTruth {
            depth: Grid::from_fn(Size::new(12, 10), |x, y| (1.0 / inverse(x, y)) as f32),
            is_complete: true,
            visibility: Vec::new(),
            origin: [2.0, 1.0],
            step: [1.0, 1.0],
        }
    }

    #[test]
    fn a_plane_is_met_exactly_between_pixels() {
        let ground_truth = GroundTruth { step: [1.5, 2.0], ..plane() };
        for place in [[0.5, 0.5], [1.0, 2.0], [3.21, 1.77]] {
            let exact = 1.0 / (0.2 + 5e-4 * (2.0 + 1.5 * place[0]) + 1e-3 * (1.0 + 2.0 * place[1]));
            assert!((ground_truth.depth_at(place).unwrap() / exact - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn an_edge_is_not_smeared_and_holes_stay() {
        let mut ground_truth = plane();
        ground_truth.depth = Grid::from_fn(Size::new(12, 10), |x, _| if x < 6 { 2.0 } else { 4.0 });
        assert_eq!(ground_truth.depth_at([3.9, 4.5]), Some(2.0));
        assert_eq!(ground_truth.depth_at([4.1, 4.5]), Some(4.0));
        ground_truth.depth.data_mut()[4 * 12 + 6] = 0.0;
        assert_eq!(ground_truth.depth_at([4.5, 3.5]), None);
        assert_eq!(ground_truth.depth_at([-3.0, 3.5]), None);
    }

    #[test]
    fn sky_and_what_lies_beyond_are_no_surfaces_and_holes_of_a_scanner_are_unknown() {
        let range = DepthRange { near: 2.0, far: 3.0 };
        let planes = Planes { range, count: 11, spacing: Spacing::Depth };
        let mut ground_truth = GroundTruth { origin: [0.0; 2], ..plane() };
        ground_truth.depth = Grid::from_fn(Size::new(12, 10), |x, _| [1.8, 2.0, 2.5, 3.04, 3.2, 0.0][x % 6]);
        let xs = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 12.5];
        let told = |surfaces: Vec<f32>| {
            surfaces
                .iter()
                .map(|s| {
                    if s.is_nan() {
                        '?'
                    } else if *s > 0.5 {
                        '1'
                    } else {
                        '0'
                    }
                })
                .collect::<String>()
        };
        assert_eq!(told(ground_truth.surfaces(&xs, &[3.5], &planes)), "011?00?");
        ground_truth.is_complete = false;
        assert_eq!(told(ground_truth.surfaces(&xs, &[3.5], &planes)), "011?0??");
    }

    #[test]
    fn depths_beyond_the_planes_do_not_count() {
        let range = DepthRange { near: 2.0, far: 3.0 };
        let planes = Planes { range, count: 11, spacing: Spacing::Depth };
        let mut ground_truth = plane();
        ground_truth.depth = Grid::from_fn(Size::new(12, 10), |x, _| [1.9, 2.04, 2.5, 3.04, 3.2][x % 5]);
        let us = ground_truth.coordinates(&[0.5, 1.5, 2.5, 3.5, 4.5], &[3.5], &planes);
        let wanted = [5.0, 10.4, f32::NAN, f32::NAN, 0.4]; // pixels 2, 3, 4, 5 ≡ 0, 6 ≡ 1
        for (u, wanted) in us.iter().zip(wanted) {
            assert!((u - wanted).abs() < 1e-4 || (u.is_nan() && wanted.is_nan()), "{us:?}");
        }
    }
}
