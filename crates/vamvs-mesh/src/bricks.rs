//! Where the volume is, and how fine: an octree whose leaves are bricks of 8×8×8 cells.
//!
//! Coordinates are whole numbers of the finest cells. A brick at level l has cells 2^l finest cells wide. Bricks that touch,
//! be it at a corner, differ by one level at most.

use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashSet};

use crate::outline::{Outline, SeenPlace};

/// Cells along an edge of a brick, as a power of two.
pub(crate) const BRICK_BITS: u32 = 3;

/// Cells along an edge of a brick.
pub(crate) const BRICK: i32 = 1 << BRICK_BITS;

/// Cells to each side of a surface that are in bricks.
const BAND: f64 = 2.5;

/// Levels finer and coarser than that of a typical pixel.
const MOST_LEVELS: i32 = 7;

/// Finest bricks along an axis of the volume, as a power of two: three axes fit into one number.
const AXIS_BITS: u32 = 20;

/// A point of the grid: whole numbers of the finest cells.
pub(crate) type Place = Vector3<i32>;

/// A brick: the place of its lowest corner, and its level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Brick {
    pub low: Place,
    pub level: u32,
}

impl Brick {
    /// The brick at a level that contains a finest cell.
    pub fn around(cell: Place, level: u32) -> Self {
        Self { low: cell.map(|x| x >> (level + BRICK_BITS) << (level + BRICK_BITS)), level }
    }

    /// The width of a cell.
    pub fn cell(self) -> i32 {
        1 << self.level
    }

    /// The width of the brick.
    pub fn width(self) -> i32 {
        BRICK << self.level
    }

    fn parent(self) -> Self {
        Self::around(self.low, self.level + 1)
    }

    fn children(self) -> impl Iterator<Item = Self> {
        let half = self.width() / 2;
        let at = move |part: i32| self.low + Vector3::new(part & 1, part >> 1 & 1, part >> 2) * half;
        (0..8).map(move |part| Self { low: at(part), level: self.level - 1 })
    }

    fn contains(self, cell: &Place) -> bool {
        (0..3).all(|axis| (self.low[axis]..self.low[axis] + self.width()).contains(&cell[axis]))
    }

    /// The places of the brick along a curve through all finest bricks, on which those of a larger brick are together.
    fn code(self) -> u64 {
        let spread = |x: i32| {
            let x = u64::from(x as u32 >> BRICK_BITS);
            (0..AXIS_BITS).fold(0, |code, bit| code | (x >> bit & 1) << (3 * bit))
        };
        spread(self.low.x) | spread(self.low.y) << 1 | spread(self.low.z) << 2
    }
}

/// The bricks of a volume.
pub(crate) struct Bricks {
    /// The world's place of the grid's origin.
    pub origin: Vector3<f64>,
    /// The width of the finest cells, scene units.
    pub unit: f64,
    /// The bricks along a curve, so that those that are near each other mostly have near numbers.
    pub all: Vec<Brick>,
    codes: Vec<u64>,
    /// Whether a finer brick has a face or an edge in common with each.
    has_finer_beside: Vec<bool>,
}

impl Bricks {
    /// Bricks around the places that views see, with cells of so many sizes of the finest pixel that sees a place.
    pub fn around(outlines: &[Outline], cell: f64) -> Self {
        let Some(pixel) = median(outlines.iter().flat_map(Outline::pixel_sizes).collect()) else {
            return Self::new(Vector3::zeros(), 1.0, Vec::new());
        };
        let typical = cell * f64::from(pixel);
        let level =
            |pixel: f64| ((cell * pixel / typical).log2().round() as i32).clamp(-MOST_LEVELS, MOST_LEVELS);
        let Bounds { low, high, finest: pixel } = Bounds::of(outlines);
        let finest = level(pixel);
        let fitting = (high - low).max() / f64::from(BRICK << (AXIS_BITS - 2));
        let unit = (typical * f64::from(finest).exp2()).max(fitting);
        // A margin for the band and for coarse bricks.
        let margin = unit * f64::from(BRICK << (2 * MOST_LEVELS));
        let origin = low - Vector3::repeat(margin.min(unit * f64::from(BRICK << (AXIS_BITS - 2))));
        let touched = |(place, pixel): SeenPlace| {
            let level = (level(pixel) - finest).max(0) as u32;
            let band = BAND * unit * f64::from(1 << level);
            let corner = move |part: u8| {
                let sign = |axis: u8| if part >> axis & 1 == 1 { band } else { -band };
                let at = (place - origin + Vector3::new(sign(0), sign(1), sign(2))) / unit;
                Brick::around(at.map(|x| x.floor() as i32), level)
            };
            (0..8).map(corner)
        };
        let of_view = |outline: &Outline| outline.places().flat_map(touched).collect::<HashSet<_>>();
        let touched = outlines.par_iter().map(of_view);
        let touched =
            touched.reduce(HashSet::new, |a, b| if a.len() > b.len() { joined(a, b) } else { joined(b, a) });
        Self::new(origin, unit, graded(touched))
    }

    fn new(origin: Vector3<f64>, unit: f64, leaves: Vec<Brick>) -> Self {
        let mut all: Vec<(u64, Brick)> = leaves.into_iter().map(|brick| (brick.code(), brick)).collect();
        all.par_sort_unstable_by_key(|&(code, _)| code);
        let (codes, all) = all.into_iter().unzip();
        let bricks = Self { origin, unit, all, codes, has_finer_beside: Vec::new() };
        let has_finer = |brick: &Brick| {
            let mut cells = touching(*brick);
            brick.level > 0
                && cells
                    .any(|cell| bricks.find(&cell).is_some_and(|found| bricks.all[found].level < brick.level))
        };
        let has_finer_beside = bricks.all.par_iter().map(has_finer).collect();
        Self { has_finer_beside, ..bricks }
    }

    /// Whether a finer brick has a face or an edge in common with a brick.
    pub fn has_finer_beside(&self, brick: usize) -> bool {
        self.has_finer_beside[brick]
    }

    /// The number of the brick that contains a finest cell.
    pub fn find(&self, cell: &Place) -> Option<usize> {
        let code = Brick::around(*cell, 0).code();
        let number = self.codes.partition_point(|&other| other <= code).checked_sub(1)?;
        self.all[number].contains(cell).then_some(number)
    }

    /// A ball around a brick, in the world: its middle and its radius.
    pub fn ball(&self, brick: usize) -> (Vector3<f64>, f64) {
        let brick = self.all[brick];
        let half = f64::from(brick.width()) / 2.0;
        let middle = brick.low.cast::<f64>() + Vector3::repeat(half);
        (self.x_in_world(&middle), half * 3.0_f64.sqrt() * self.unit)
    }

    /// The world's place of a point of the grid.
    pub fn x_in_world(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.origin + place * self.unit
    }
}

/// The corners of a box around all places, and the size of the finest pixel.
#[derive(Clone, Copy)]
struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
    finest: f64,
}

impl Bounds {
    fn of(outlines: &[Outline]) -> Self {
        let none = || {
            let infinite = Vector3::repeat(f64::INFINITY);
            Self { low: infinite, high: -infinite, finest: f64::INFINITY }
        };
        let of_view = |outline: &Outline| {
            let places =
                outline.places().map(|(place, pixel)| Self { low: place, high: place, finest: pixel });
            places.fold(none(), Self::with)
        };
        outlines.par_iter().map(of_view).reduce(none, Self::with)
    }

    fn with(self, other: Self) -> Self {
        Self {
            low: self.low.inf(&other.low),
            high: self.high.sup(&other.high),
            finest: self.finest.min(other.finest),
        }
    }
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

fn joined(mut all: HashSet<Brick>, more: HashSet<Brick>) -> HashSet<Brick> {
    all.extend(more);
    all
}

/// Disjoint bricks that cover the given ones, as fine as the finest of them, of which those that touch differ by one level
/// at most.
fn graded(touched: HashSet<Brick>) -> Vec<Brick> {
    let coarsest = touched.iter().map(|brick| brick.level).max().unwrap_or(0);
    let mut leaves: Vec<HashSet<Brick>> = vec![HashSet::new(); coarsest as usize + 1];
    touched.into_iter().for_each(|brick| _ = leaves[brick.level as usize].insert(brick));
    // What contains finer bricks is divided.
    let mut divided: Vec<HashSet<Brick>> = vec![HashSet::new(); leaves.len()];
    for level in 1..leaves.len() {
        let below = leaves[level - 1].iter().chain(&divided[level - 1]).map(|brick| brick.parent());
        divided[level] = below.collect();
    }
    for level in (1..leaves.len()).rev() {
        let parents: Vec<Brick> = leaves[level].intersection(&divided[level]).copied().collect();
        for parent in parents {
            leaves[level].remove(&parent);
            leaves[level - 1].extend(parent.children());
        }
    }
    balance(&mut leaves);
    leaves.into_iter().flatten().collect()
}

/// Divides bricks until those that touch differ by one level at most.
fn balance(leaves: &mut [HashSet<Brick>]) {
    for level in 0..leaves.len().saturating_sub(2) {
        let around: BTreeSet<[i32; 3]> =
            leaves[level].iter().flat_map(|&brick| neighbours_of(brick)).map(Into::into).collect();
        for place in around {
            for coarse in (level + 2..leaves.len()).rev() {
                let brick = Brick::around(place.into(), coarse as u32);
                if leaves[coarse].remove(&brick) {
                    leaves[coarse - 1].extend(brick.children());
                }
            }
        }
    }
}

/// The finest cells at the low corners of the 26 places of a brick's size around it.
fn neighbours_of(brick: Brick) -> impl Iterator<Item = Place> {
    let offset = |number: i32| Vector3::new(number % 3 - 1, number / 3 % 3 - 1, number / 9 - 1);
    (0..27).filter(|&number| number != 13).map(move |number| brick.low + offset(number) * brick.width())
}

/// A finest cell in each of the places of half a brick's size that have a face or an edge in common with a brick.
fn touching(brick: Brick) -> impl Iterator<Item = Place> {
    let half = brick.width() / 2;
    let along = move |number: i32| [-1, 0, half, 2 * half][number as usize];
    let is_outside = |number: i32| number == 0 || number == 3;
    let cells = (0..64).map(|number| [number % 4, number / 4 % 4, number / 16]);
    let touches = move |numbers: &[i32; 3]| {
        let outside = numbers.iter().filter(|&&number| is_outside(number)).count();
        outside == 1 || outside == 2
    };
    cells.filter(touches).map(move |numbers| brick.low + Vector3::from(numbers.map(along)))
}

#[cfg(test)]
impl Bricks {
    /// All bricks of a level in a cube around the world's origin, but finer where `is_fine` holds of a brick's middle.
    pub fn cube(unit: f64, half: i32, level: u32, is_fine: impl Fn(Vector3<f64>) -> bool) -> Self {
        let offset = 1 << 16;
        let range = (-half..half).map(|x| x * (BRICK << level) + offset);
        let mut touched = HashSet::new();
        for x in range.clone() {
            for y in range.clone() {
                for z in range.clone() {
                    let brick = Brick::around(Vector3::new(x, y, z), level);
                    touched.insert(brick);
                    let middle = |brick: Brick| {
                        (brick.low.cast::<f64>()
                            + Vector3::repeat(f64::from(brick.width()) / 2.0 - f64::from(offset)))
                            * unit
                    };
                    if level > 0 && is_fine(middle(brick)) {
                        touched.extend(brick.children().filter(|&child| is_fine(middle(child))));
                    }
                }
            }
        }
        Self::new(Vector3::repeat(-f64::from(offset) * unit), unit, graded(touched))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bricks_are_disjoint_cover_what_was_touched_and_are_graded() {
        let brick = |x: i32, y: i32, level: u32| Brick::around(Vector3::new(x, y, 4096), level);
        let touched: HashSet<Brick> = [
            brick(4096, 4096, 0),
            brick(4300, 4096, 4),
            brick(4200, 4000, 3),
            brick(4120, 4096, 1),
            brick(5000, 4096, 5),
        ]
        .into();
        let leaves = graded(touched.clone());
        let bricks = Bricks::new(Vector3::zeros(), 1.0, leaves);
        for (number, brick) in bricks.all.iter().enumerate() {
            assert_eq!(bricks.find(&brick.low), Some(number));
            assert_eq!(bricks.find(&(brick.low + Vector3::repeat(brick.width() - 1))), Some(number));
            for place in neighbours_of(*brick) {
                let Some(other) = bricks.find(&place) else { continue };
                assert!(
                    bricks.all[other].level <= brick.level + 1,
                    "{brick:?} beside {:?}",
                    bricks.all[other]
                );
            }
        }
        for brick in touched {
            let (step, width) = (brick.cell() as usize, brick.width());
            for x in (0..width).step_by(step) {
                let cell = brick.low + Vector3::new(x, width - 1, x);
                let found = bricks.find(&cell).expect("what was touched is covered");
                assert!(bricks.all[found].level <= brick.level);
            }
        }
    }
}
