//! Points in few bytes, for pages that hold their cloud.

use std::ops::Range;

use vamvs_core::{CloudPoint, Mesh};

use crate::viewpoint::quantile;

/// Largest number of points that are packed.
const MOST: usize = 300_000;

/// The share of points at either end of each axis that may be outliers.
const OUTLIERS: f64 = 0.005;

/// Steps of a coordinate within the box.
const STEPS: f64 = 65_535.0;

/// Bytes of a point.
pub(crate) const POINT_BYTES: usize = 14;

/// An even sample of a cloud, in 14 bytes a point.
///
/// A point is its position in the box in 65535 steps a side (three `u16`, low byte first), red,
/// green, blue, its normal times 127 (three `i8`), its confidence times 255, and its number of
/// views.
#[derive(Clone, Debug)]
pub struct PackedCloud {
    /// The corner of the box with the smallest coordinates, world.
    pub low: [f64; 3],
    /// The box's sides, world, all positive.
    pub extent: [f64; 3],
    /// The points, one after the other.
    pub bytes: Vec<u8>,
    /// The packed points before packing.
    pub points: Vec<CloudPoint>,
    /// Number of points of the whole cloud.
    pub total: usize,
    /// Share of the points that lie too far outside to be shown.
    pub outside: f64,
}

impl PackedCloud {
    /// Packs points `taken` from a cloud of `total`. Outliers are left out: points farther from the
    /// box around all but the outermost percent than its longest side.
    #[must_use]
    pub fn new(total: usize, taken: &[CloudPoint]) -> Self {
        let ranges = ranges(taken);
        let inside = |point: &CloudPoint| (0..3).all(|axis| ranges[axis].contains(&point.x_in_world[axis]));
        let points: Vec<CloudPoint> = taken.iter().copied().filter(inside).collect();
        let outside = (taken.len() - points.len()) as f64 / taken.len().max(1) as f64;
        let (low, extent) = bounds(&points);
        let bytes = points.iter().flat_map(|point| packed(point, &low, &extent)).collect();
        Self { low, extent, bytes, points, total, outside }
    }

    /// The vertices of a mesh as points of the cloud, and its triangles but those with a vertex outside of the box.
    pub(crate) fn packed_mesh(&self, mesh: &Mesh) -> (Vec<u8>, Vec<[u32; 3]>) {
        let place = |vertex: u32| -> [f64; 3] { mesh.x_in_world(vertex).into() };
        let is_inside = |vertex: u32| {
            let x = place(vertex);
            (0..3).all(|axis| (0.0..=self.extent[axis]).contains(&(x[axis] - self.low[axis])))
        };
        let point = |vertex: u32| CloudPoint {
            x_in_world: place(vertex),
            normal: mesh.normals[vertex as usize],
            colour: mesh.colours[vertex as usize],
            confidence: 0.0,
            sigma: 0.0,
            views: 0,
        };
        let vertices = 0..mesh.positions.len() as u32;
        let bytes = vertices.flat_map(|vertex| packed(&point(vertex), &self.low, &self.extent)).collect();
        let shown = |triangle: &&[u32; 3]| triangle.iter().all(|&vertex| is_inside(vertex));
        (bytes, mesh.triangles.iter().filter(shown).copied().collect())
    }

    /// The middle of the box, world.
    #[must_use]
    pub fn centre(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.low[axis] + 0.5 * self.extent[axis])
    }
}

/// Ascending indices of the points to take from a cloud of `total`: at most 300 000, evenly.
#[must_use]
pub fn sample_indices(total: usize) -> Vec<usize> {
    evenly(total, MOST).collect()
}

/// At most `most` indices below `count`, one from each of as many equal parts, at a pseudorandom
/// place in it: taking every n-th pixel of an image would leave stripes.
fn evenly(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let kept = count.min(most);
    (0..kept).map(move |part| {
        let ends = |part: usize| (part as u128 * count as u128 / kept as u128) as usize;
        let (begin, end) = (ends(part), ends(part + 1));
        begin + scattered(part) % (end - begin)
    })
}

/// A pseudorandom number (the finaliser of SplitMix64).
fn scattered(number: usize) -> usize {
    let mut z = (number as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 8) as usize
}

/// The ranges of points that are not outliers: between the quantiles of each axis, and beyond them
/// by the largest distance between two quantiles.
fn ranges(points: &[CloudPoint]) -> [Range<f64>; 3] {
    let inner = [0, 1, 2].map(|axis| {
        let mut values: Vec<f64> = points.iter().map(|point| point.x_in_world[axis]).collect();
        (quantile(&mut values, OUTLIERS), quantile(&mut values, 1.0 - OUTLIERS))
    });
    let margin = inner.iter().map(|(low, high)| high - low).fold(f64::MIN_POSITIVE, f64::max);
    inner.map(|(low, high)| low - margin..high + margin.max(f64::EPSILON * high.abs()))
}

/// The box around points; flat sides get some thickness.
fn bounds(points: &[CloudPoint]) -> ([f64; 3], [f64; 3]) {
    let values = |axis: usize| points.iter().map(move |point| point.x_in_world[axis]);
    let low = [0, 1, 2].map(|axis| values(axis).reduce(f64::min).unwrap_or(0.0));
    let high = [0, 1, 2].map(|axis| values(axis).reduce(f64::max).unwrap_or(0.0));
    let sides = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let largest = sides.iter().copied().fold(0.0, f64::max);
    let least = if largest > 0.0 { 1e-6 * largest } else { 1.0 };
    (low, sides.map(|side| side.max(least)))
}

fn packed(point: &CloudPoint, low: &[f64; 3], extent: &[f64; 3]) -> [u8; POINT_BYTES] {
    let mut bytes = [0; POINT_BYTES];
    for axis in 0..3 {
        let place = (point.x_in_world[axis] - low[axis]) / extent[axis];
        let step = (STEPS * place).round() as u16;
        bytes[2 * axis..2 * axis + 2].copy_from_slice(&step.to_le_bytes());
        bytes[9 + axis] = (127.0 * point.normal[axis]).round() as i8 as u8;
    }
    bytes[6..9].copy_from_slice(&point.colour);
    bytes[12] = (255.0 * point.confidence).round() as u8;
    bytes[13] = point.views;
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a curve in space.
    fn cloud(count: usize, at: [f64; 3]) -> Vec<CloudPoint> {
        let point = |i: usize| {
            let t = i as f64 / count as f64;
            CloudPoint {
                x_in_world: [at[0] + t, at[1] + 0.3 * (9.0 * t).sin(), at[2] + t * t],
                normal: [0.6, -0.8 * (t as f32), -1.0],
                colour: [i as u8, 2, 255],
                confidence: t as f32,
                sigma: 0.0,
                views: (i % 200) as u8,
            }
        };
        (0..count).map(point).collect()
    }

    #[test]
    fn unpacked_points_are_the_points_within_half_a_step() {
        let cloud = cloud(5000, [4e5, -7e6, 12.0]);
        let packed = PackedCloud::new(cloud.len(), &cloud);
        assert_eq!((packed.points.len(), packed.total, packed.outside), (5000, 5000, 0.0));
        assert_eq!(packed.bytes.len(), 5000 * POINT_BYTES);
        for (bytes, point) in packed.bytes.chunks(POINT_BYTES).zip(&cloud) {
            for axis in 0..3 {
                let step = u16::from_le_bytes([bytes[2 * axis], bytes[2 * axis + 1]]);
                let place = packed.low[axis] + f64::from(step) / STEPS * packed.extent[axis];
                let off = (place - point.x_in_world[axis]).abs();
                assert!(off <= 0.5001 * packed.extent[axis] / STEPS + 1e-9, "{off}");
                let normal = f32::from(bytes[9 + axis] as i8) / 127.0;
                assert!((normal - point.normal[axis]).abs() <= 0.5001 / 127.0);
            }
            assert_eq!(bytes[6..9], point.colour);
            assert!((f32::from(bytes[12]) / 255.0 - point.confidence).abs() <= 0.5001 / 255.0);
            assert_eq!(bytes[13], point.views);
        }
    }

    #[test]
    fn a_large_cloud_is_thinned_evenly() {
        let indices: Vec<usize> = evenly(1_000_003, 1000).collect();
        assert_eq!(indices.len(), 1000);
        for (part, &index) in indices.iter().enumerate() {
            let ends = [part, part + 1].map(|part| part * 1_000_003 / 1000);
            assert!((ends[0]..ends[1]).contains(&index), "one from each part");
        }
        let steps: std::collections::BTreeSet<_> = indices.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(steps.len() > 500, "no stripes");
        assert!(evenly(5, 1000).eq(0..5) && evenly(0, 9).next().is_none());
    }

    #[test]
    fn outliers_neither_count_nor_make_the_rest_coarse() {
        let mut all = cloud(2000, [0.0; 3]);
        all.extend(cloud(4, [1e6, 0.0, 0.0]));
        let packed = PackedCloud::new(all.len(), &all);
        assert_eq!(packed.points.len(), 2000);
        assert!((packed.outside - 4.0 / 2004.0).abs() < 1e-12);
        assert!(packed.extent.iter().all(|side| *side < 1.5));
    }

    #[test]
    fn flat_and_empty_clouds_have_a_box() {
        let flat: Vec<_> =
            cloud(100, [3.0; 3]).into_iter().map(|p| CloudPoint { x_in_world: [3.0; 3], ..p }).collect();
        for cloud in [&flat[..], &[]] {
            let packed = PackedCloud::new(cloud.len(), cloud);
            assert_eq!(packed.points.len(), cloud.len());
            assert!(packed.extent.iter().all(|side| *side > 0.0));
        }
    }
}
