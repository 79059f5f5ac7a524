//! Planar segments: connected blocks of pixels whose inverse depths are those of one plane.
//!
//! Blocks of 8×8 pixels are merged with their neighbours, the most alike first, as long as the plane of both departs from
//! that of each by no more than noise and a little relief explain (agglomerative clustering as in Feng, Taguchi and Kamat,
//! ICRA 2014, here in inverse depth, in which planes are affine, and with each pixel weighted by what its matching tells).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rayon::prelude::*;
use vamvs_core::{Grid, Size};

use crate::field::Field;
use crate::plane::Plane;
use crate::plane_fit::{PlaneFit, Sums};

/// Side of a block, pixels.
pub(crate) const BLOCK: usize = 8;

/// The share of a block's pixels that must have a depth.
const LEAST_FILLED: f64 = 0.5;

/// A block shows one surface if its pixels depart from its plane by no more than this, pixels of disparity (root mean
/// square), and noise.
const ONE_SURFACE: f64 = 0.5;

/// Errors of so many neighbouring pixels are one error: windows overlap, and planes are smoothed.
const CORRELATED: f64 = 80.0;

/// Segments are merged if the plane of both departs from that of each by less than noise does with this factor: the sum of
/// squares of three parameters that are fitted anew, at 10 % significance.
const NOISE: f64 = 4.0;

/// ... and by this, pixels of disparity.
const RELIEF: f64 = 0.08;

/// The least departure of pixels from their segment's plane, pixels of disparity.
const LEAST_RELIEF: f64 = 0.15;

/// What a pixel's matching cannot tell, pixels of disparity: interpolation and quantisation.
const LEAST_SIGMA: f32 = 0.05;

/// A plane as a prior of a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    /// Its inverse depth there, and its slopes.
    pub w: f64,
    pub gx: f64,
    pub gy: f64,
    /// The variance of the inverse depth there.
    pub variance: f64,
}

/// The planar segments of a view.
pub(crate) struct Segments {
    /// Blocks in a row and in a column.
    blocks: Size,
    /// The segment of each block; `None` where there is no one surface.
    of_block: Vec<Option<u32>>,
    planes: Vec<SegmentPlane>,
}

/// The plane of a segment.
struct SegmentPlane {
    fit: PlaneFit,
    /// Number of its pixels.
    pixels: usize,
    /// The variance of the fit at the mean of its pixels.
    uncertainty: f64,
    /// The mean square by which surfaces of the segment depart from the plane.
    relief: f64,
}

/// The variance of a pixel's inverse depth: `variance` in squared pixels of disparity, `step` one of these.
pub(crate) fn variance_of(variance: f32, step: f32) -> f64 {
    f64::from((variance + LEAST_SIGMA * LEAST_SIGMA) * step * step)
}

impl Segments {
    /// The segments of a field; `steps` holds, for each pixel, the change of inverse depth that is one pixel of disparity.
    pub fn of(field: &Field, steps: &Grid<f32>) -> Self {
        let size = field.size();
        let blocks = Size::new(size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
        let sums = |at: usize| block(field, steps, (at % blocks.width, at / blocks.width));
        let sums: Vec<Option<Sums>> = (0..blocks.area()).into_par_iter().map(sums).collect();
        let merged = Merging::new(&sums, blocks).finished();
        let mut number = vec![None; merged.nodes.len()];
        let mut planes = Vec::new();
        for (at, node) in merged.nodes.iter().enumerate() {
            if let Some(node) = node {
                number[at] = Some(planes.len() as u32);
                planes.push(SegmentPlane::of(node));
            }
        }
        let of_block = (0..blocks.area()).map(|at| number[merged.root(at)]).collect();
        Self { blocks, of_block, planes }
    }

    /// Of the segments of a pixel's block and those around it, the plane that is nearest to inverse depth `w` there.
    pub fn nearest(&self, (x, y): (usize, usize), w: f64) -> Option<Prior> {
        let place = [x as f64, y as f64];
        let (bx, by) = (x / BLOCK, y / BLOCK);
        let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let (mut best, mut least) = (None, f64::INFINITY);
        for row in around(by, self.blocks.height) {
            for column in around(bx, self.blocks.width) {
                let Some(segment) = self.of_block[row * self.blocks.width + column] else { continue };
                let plane = &self.planes[segment as usize];
                let way = (plane.fit.at(place) - w).abs();
                if way < least {
                    (best, least) = (Some(plane), way);
                }
            }
        }
        let SegmentPlane { fit, uncertainty, relief, .. } = best?;
        let variance = relief + uncertainty * fit.spread(place);
        Some(Prior { w: fit.at(place), gx: fit.gx, gy: fit.gy, variance })
    }
}

impl Segments {
    /// Blocks in a row and in a column.
    pub fn blocks(&self) -> Size {
        self.blocks
    }

    /// The segment of a block.
    pub fn of_block(&self, block: usize) -> Option<usize> {
        self.of_block[block].map(|segment| segment as usize)
    }

    /// The number of a segment's pixels.
    pub fn pixels(&self, segment: usize) -> usize {
        self.planes[segment].pixels
    }

    /// A segment's plane at a pixel.
    pub fn plane(&self, segment: usize, (x, y): (usize, usize)) -> Plane {
        let fit = &self.planes[segment].fit;
        Plane { w: fit.at([x as f64, y as f64]) as f32, gx: fit.gx as f32, gy: fit.gy as f32 }
    }
}

impl SegmentPlane {
    fn of(node: &Node) -> Self {
        let sums = &node.sums;
        let beyond_noise = (node.residual - sums.count) / sums.weight;
        let least = LEAST_RELIEF * sums.step();
        let relief = beyond_noise.max(0.0) + least * least;
        let (pixels, uncertainty) = (sums.count as usize, CORRELATED / sums.weight);
        Self { fit: sums.fit(), pixels, uncertainty, relief }
    }
}

/// The sums over the pixels of a block, if they show one surface.
fn block(field: &Field, steps: &Grid<f32>, (column, row): (usize, usize)) -> Option<Sums> {
    let size = field.size();
    let mut sums = Sums::default();
    for y in row * BLOCK..((row + 1) * BLOCK).min(size.height) {
        for x in column * BLOCK..((column + 1) * BLOCK).min(size.width) {
            let (state, step) = (field.at(x, y), steps[(x, y)]);
            if state.plane.w > 0.0 && !state.unfounded {
                let weight = 1.0 / variance_of(state.variance, step);
                sums.add([x as f64, y as f64], f64::from(state.plane.w), weight, f64::from(step));
            }
        }
    }
    if sums.count < LEAST_FILLED * (BLOCK * BLOCK) as f64 {
        return None;
    }
    let (departure, noise) = (ONE_SURFACE * sums.step(), 4.0 * sums.count);
    let is_one = sums.residual(&sums.fit()) < departure * departure * sums.weight + noise;
    is_one.then_some(sums)
}

/// A segment while segments are merged.
struct Node {
    sums: Sums,
    /// The weighted sum of the squared residuals of its own plane.
    residual: f64,
    /// Increased whenever it grows, so that pairs with its earlier state are told apart.
    version: u32,
    /// Segments beside it, some of which may have been merged with others since.
    beside: Vec<usize>,
}

impl Node {
    fn new(sums: Sums, version: u32, beside: Vec<usize>) -> Self {
        Self { residual: sums.residual(&sums.fit()), sums, version, beside }
    }

    /// By how much a plane departs from this segment's own, as a share of what is allowed.
    fn departure(&self, plane: &PlaneFit) -> f64 {
        let relief = RELIEF * self.sums.step();
        let allowed = CORRELATED * NOISE + self.sums.weight * relief * relief;
        (self.sums.residual(plane) - self.residual) / allowed
    }
}

/// Two segments that may be merged. The greatest pair is the most alike.
struct Pair {
    departure: f64,
    nodes: [usize; 2],
    versions: [u32; 2],
}

impl Ord for Pair {
    fn cmp(&self, other: &Self) -> Ordering {
        other.departure.total_cmp(&self.departure).then(other.nodes.cmp(&self.nodes))
    }
}

impl PartialOrd for Pair {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Pair {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Pair {}

/// Segments that grow together.
struct Merging {
    /// The segments, each at the place of its first block.
    nodes: Vec<Option<Node>>,
    /// For each block, itself or another one of its segment.
    parent: Vec<usize>,
    pairs: BinaryHeap<Pair>,
}

impl Merging {
    /// Begins with one segment a block.
    fn new(sums: &[Option<Sums>], blocks: Size) -> Self {
        let node = |(at, own): (usize, &Option<Sums>)| {
            let beside = adjacent(at, blocks).filter(|&other| sums[other].is_some()).collect();
            own.map(|own| Node::new(own, 0, beside))
        };
        let nodes = sums.iter().enumerate().map(node).collect();
        let mut merging = Self { nodes, parent: (0..sums.len()).collect(), pairs: BinaryHeap::new() };
        for at in 0..sums.len() {
            let later: Vec<usize> = merging.nodes[at].iter().flat_map(|node| &node.beside).copied().collect();
            later.into_iter().filter(|&other| at < other).for_each(|other| merging.propose([at, other]));
        }
        merging
    }

    /// Merges until no two segments are one plane.
    fn finished(mut self) -> Self {
        while let Some(Pair { nodes, versions, .. }) = self.pairs.pop() {
            let is_current =
                |i: usize| self.nodes[nodes[i]].as_ref().is_some_and(|node| node.version == versions[i]);
            if is_current(0) && is_current(1) {
                self.merge(nodes);
            }
        }
        self
    }

    /// The place of a block's segment.
    fn root(&self, mut at: usize) -> usize {
        while self.parent[at] != at {
            at = self.parent[at];
        }
        at
    }

    /// Notes two segments if they are one plane.
    fn propose(&mut self, nodes: [usize; 2]) {
        let [Some(a), Some(b)] = nodes.map(|node| self.nodes[node].as_ref()) else { return };
        let both = a.sums.plus(&b.sums).fit();
        let departure = a.departure(&both).max(b.departure(&both));
        if departure < 1.0 {
            self.pairs.push(Pair { departure, nodes, versions: [a.version, b.version] });
        }
    }

    fn merge(&mut self, [to, from]: [usize; 2]) {
        let (Some(a), Some(b)) = (self.nodes[to].take(), self.nodes[from].take()) else { return };
        self.parent[from] = to;
        let mut beside: Vec<usize> =
            a.beside.iter().chain(&b.beside).map(|&other| self.shortened(other)).collect();
        beside.sort_unstable();
        beside.dedup();
        beside.retain(|&other| other != to);
        self.nodes[to] = Some(Node::new(a.sums.plus(&b.sums), a.version + 1, beside.clone()));
        beside.into_iter().for_each(|other| self.propose([to, other]));
    }

    /// As [`Merging::root`]; shortens the way there.
    fn shortened(&mut self, mut at: usize) -> usize {
        while self.parent[at] != at {
            self.parent[at] = self.parent[self.parent[at]];
            at = self.parent[at];
        }
        at
    }
}

/// The blocks beside a block.
pub(crate) fn adjacent(at: usize, blocks: Size) -> impl Iterator<Item = usize> {
    let (column, row) = (at % blocks.width, at / blocks.width);
    let beside = [
        (column > 0).then(|| at - 1),
        (column + 1 < blocks.width).then(|| at + 1),
        (row > 0).then(|| at - blocks.width),
        (row + 1 < blocks.height).then(|| at + blocks.width),
    ];
    beside.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::State;

    const STEP: f32 = 0.01;

    /// Two planes that meet in an edge, and a third behind a jump; each pixel has noise of `sigma` pixels of disparity.
    fn field(sigma: f32) -> Field {
        let mut random = 1_u32;
        let noise = Grid::from_fn(Size::new(128, 64), |_, _| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) as f32 / (1 << 24) as f32 - 0.5
        });
        Field::new(Size::new(128, 64), |x, y| {
            let w = inverse_depth(x, y) + 12.0_f32.sqrt() * sigma * STEP * noise[(x, y)];
            State { variance: sigma * sigma, ..State::unjudged(Plane { w, gx: 0.0, gy: 0.0 }) }
        })
    }

    fn inverse_depth(x: usize, y: usize) -> f32 {
        let (x, y) = (x as f32, y as f32);
        match x {
            ..48.0 => 1.0 + 1e-3 * x,
            48.0..96.0 => 1.048 - 2e-3 * (x - 48.0) + 5e-4 * y,
            _ => 3.0 + 1e-3 * y,
        }
    }

    #[test]
    fn planes_are_found_and_not_mixed() {
        let field = field(0.5);
        let segments = Segments::of(&field, &Grid::filled(field.size(), STEP));
        for (x, y) in [(2, 2), (20, 50), (45, 30), (60, 10), (90, 60), (100, 3), (127, 63)] {
            let expected = f64::from(inverse_depth(x, y));
            let prior = segments.nearest((x, y), expected).unwrap();
            let off = (prior.w - expected).abs() / f64::from(STEP);
            assert!(off < 0.15, "{x} {y}: {off} pixels");
            assert!(prior.variance.sqrt() < 0.35 * f64::from(STEP), "{x} {y}");
        }
        assert!(segments.planes.len() <= 8, "{} segments", segments.planes.len());
    }

    #[test]
    fn blocks_over_a_jump_and_without_depth_belong_to_none() {
        let jump = Field::new(Size::new(16, 16), |x, _| {
            let w = if x < 4 { 1.0 } else { 2.0 };
            let plane = Plane { w: if x < 8 { w } else { 0.0 }, gx: 0.0, gy: 0.0 };
            State { variance: 0.01, ..State::unjudged(plane) }
        });
        let segments = Segments::of(&jump, &Grid::filled(jump.size(), STEP));
        assert!(segments.nearest((2, 2), 1.0).is_none() && segments.planes.is_empty());
    }
}
