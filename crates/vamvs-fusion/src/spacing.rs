//! Thins points to a least distance.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use crate::{FusedPoints, PointSpacing};

/// Lets a point pass if none that passed before is nearer than the spacing. The result depends only
/// on the order of the points. Takes some 60 bytes for each point that passes.
pub(crate) struct Thinner {
    /// The least distance, scene units.
    spacing: f64,
    /// The last point that passed in each grid cell, with the spacing as its side.
    last: HashMap<u64, u32, BuildHasherDefault<CellHasher>>,
    /// The points that passed, each with the one before it in its cell, or `u32::MAX`.
    passed: Vec<([f64; 3], u32)>,
}

impl Thinner {
    /// `footprint` is the size of a pixel on the surface, scene units.
    pub fn new(spacing: PointSpacing, footprint: f64) -> Self {
        let spacing = match spacing {
            PointSpacing::Units(units) => units,
            PointSpacing::Pixels(pixels) => pixels * footprint,
        };
        Self { spacing, last: HashMap::default(), passed: Vec::new() }
    }

    /// The points that pass.
    pub fn thinned(&mut self, points: &FusedPoints) -> FusedPoints {
        let mut thinned = FusedPoints::default();
        for (point, views) in points.iter() {
            if self.passes(point.x_in_world) {
                thinned.push(*point, views.iter().copied());
            }
        }
        thinned
    }

    fn passes(&mut self, x_in_world: [f64; 3]) -> bool {
        let cell = x_in_world.map(|c| (c / self.spacing).floor() as i64);
        let around = |i: i64| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1];
        let near = |i| self.is_near(key([0, 1, 2].map(|axis| cell[axis] + around(i)[axis])), &x_in_world);
        // The point's own cell first: it is the likeliest to hold a near one.
        if near(13) || (0..27).any(near) {
            return false;
        }
        let before = self.last.insert(key(cell), self.passed.len() as u32);
        self.passed.push((x_in_world, before.unwrap_or(u32::MAX)));
        true
    }

    /// Whether a point that passed in a cell is too near.
    fn is_near(&self, cell: u64, x: &[f64; 3]) -> bool {
        let mut next = self.last.get(&cell).copied().unwrap_or(u32::MAX);
        while let Some((other, before)) = self.passed.get(next as usize) {
            let squared: f64 = other.iter().zip(x).map(|(a, b)| (a - b).powi(2)).sum();
            if squared < self.spacing * self.spacing {
                return true;
            }
            next = *before;
        }
        false
    }
}

/// Cells that are 2²¹ cells apart share a key, which costs time but changes nothing: distances decide.
fn key(cell: [i64; 3]) -> u64 {
    cell.into_iter().fold(0, |key, c| key << 21 | c as u64 & 0x1F_FFFF)
}

/// A hash of one number.
#[derive(Default)]
struct CellHasher(u64);

impl Hasher for CellHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u64(self.0 << 8 | u64::from(byte)));
    }

    fn write_u64(&mut self, key: u64) {
        let mixed = (key ^ key >> 32).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.0 = mixed ^ mixed >> 29;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::CloudPoint;

    fn points(positions: impl IntoIterator<Item = [f64; 3]>) -> FusedPoints {
        let mut points = FusedPoints::default();
        for x_in_world in positions {
            let point = CloudPoint {
                x_in_world,
                normal: [0.0; 3],
                colour: [0; 3],
                confidence: 1.0,
                sigma: 0.0,
                views: 2,
            };
            points.push(point, [3, 7].into_iter());
        }
        points
    }

    fn distance(a: &CloudPoint, b: &CloudPoint) -> f64 {
        let squared = a.x_in_world.iter().zip(b.x_in_world).map(|(a, b)| (a - b).powi(2));
        squared.sum::<f64>().sqrt()
    }

    #[test]
    fn what_passes_is_far_apart_and_leaves_no_hole() {
        let random = |i: usize, step: f64| (i as f64 * step).fract();
        let place =
            |i: usize| [random(i, 0.819_172_5) - 0.5, random(i, 0.671_043_6) - 0.5, random(i, 0.549_700_5)];
        let (first, second) = (points((0..1500).map(place)), points((1500..3000).map(place)));
        let mut thinner = Thinner::new(PointSpacing::Pixels(2.0), 0.05);
        let mut passed = thinner.thinned(&first);
        passed.append(&thinner.thinned(&second));
        let passed = passed.points();
        assert!((300..1200).contains(&passed.len()), "{}", passed.len());
        for (i, point) in passed.iter().enumerate() {
            assert!(passed[..i].iter().all(|other| distance(point, other) >= 0.1));
        }
        for point in first.points().iter().chain(second.points()) {
            assert!(passed.iter().any(|other| distance(point, other) < 0.1), "nothing near {point:?}");
        }
    }

    #[test]
    fn points_keep_their_views() {
        let thinned =
            Thinner::new(PointSpacing::Units(0.1), 1.0).thinned(&points([[0.0; 3], [0.05; 3], [1.0; 3]]));
        let views: Vec<_> = thinned.iter().map(|(_, views)| views).collect();
        assert_eq!(views, [[3, 7], [3, 7]]);
    }
}
