//! Planes of large segments grow over the blocks beside them.
//!
//! Where a seed is wrong on a textureless surface, each pixel finds something that matches as well by chance, and no
//! neighbour's plane wins pixel by pixel. Over a block the right plane does: it matches at least as well as all of these
//! different planes together.

use rayon::prelude::*;
use vamvs_core::Grid;

use crate::energy::Judged;
use crate::field::{Field, State};
use crate::matcher::Matcher;
use crate::plane::Plane;
use crate::segments::{BLOCK, Segments, adjacent};

/// Segments of fewer pixels do not grow.
const LEAST_PIXELS: usize = 1500;

/// A segment grows over blocks of segments of at most this share of its pixels.
const SMALLER: f64 = 0.5;

/// The energy of a plane behind a camera, or outside of all source views.
const WORST: f32 = 1.5;

/// By how much a plane may match worse than the planes that a block has, which were chosen among many.
const MARGIN: f32 = 0.06;

/// Planes that differ by less than this in a block, pixels of disparity, are the same surface, about which matching decides.
const OTHER: f32 = 0.6;

/// By how much it may match worse at a pixel that takes it.
const PIXEL_MARGIN: f32 = 0.2;

/// Columns and rows of a block's pixels on which planes are compared.
const SAMPLES: usize = 4;

/// Most rounds; in each, a segment grows by one block to all sides.
const ROUNDS: usize = 48;

/// Lets the planes of large segments replace those of the blocks beside them that they match at least as well.
pub(crate) fn grow(field: &mut Field, matcher: &Matcher, steps: &Grid<f32>) {
    let segments = Segments::of(field, steps);
    let blocks = segments.blocks();
    let mut owner: Vec<Option<usize>> = (0..blocks.area()).map(|block| segments.of_block(block)).collect();
    let mut front: Vec<usize> = (0..blocks.area()).collect();
    for _ in 0..ROUNDS {
        let taken: Vec<(usize, usize)> = front
            .par_iter()
            .filter_map(|&block| Some((block, taker(field, (matcher, steps), &segments, &owner, block)?)))
            .collect();
        if taken.is_empty() {
            break;
        }
        for &(block, segment) in &taken {
            owner[block] = Some(segment);
        }
        take(field, matcher, &segments, &taken);
        front = taken.iter().flat_map(|&(block, _)| adjacent(block, blocks)).collect();
        front.sort_unstable();
        front.dedup();
    }
}

/// The segment beside a block whose plane should replace those of the block.
fn taker(
    field: &Field,
    (matcher, steps): (&Matcher, &Grid<f32>),
    segments: &Segments,
    owner: &[Option<usize>],
    block: usize,
) -> Option<usize> {
    let own = owner[block];
    let own_pixels = own.map_or(0, |own| segments.pixels(own));
    let mut beside: Vec<usize> =
        adjacent(block, segments.blocks()).filter_map(|block| owner[block]).collect();
    beside.sort_unstable();
    beside.dedup();
    beside.retain(|&segment| {
        let pixels = segments.pixels(segment);
        Some(segment) != own && pixels >= LEAST_PIXELS && own_pixels as f64 <= SMALLER * pixels as f64
    });
    if beside.is_empty() {
        return None;
    }
    let places = samples(field, segments, block);
    let mean = |plane: &dyn Fn((usize, usize)) -> Plane| {
        let sum: f32 = places.iter().map(|&place| judged(matcher, place, &plane(place)).energy).sum();
        sum / places.len() as f32
    };
    let departs = |segment: &usize| {
        let departure = |&(x, y): &(usize, usize)| {
            (segments.plane(*segment, (x, y)).w - field.at(x, y).plane.w).abs() / steps[(x, y)]
        };
        places.iter().map(departure).sum::<f32>() > OTHER * places.len() as f32
    };
    beside.retain(departs);
    if beside.is_empty() {
        return None;
    }
    let current = mean(&|(x, y)| field.at(x, y).plane) + MARGIN;
    let energies = beside.into_iter().map(|segment| (mean(&|place| segments.plane(segment, place)), segment));
    let best = energies.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 < current.min(WORST)).then_some(best.1)
}

/// Pixels of a block whose depths are founded, on a grid.
fn samples(field: &Field, segments: &Segments, block: usize) -> Vec<(usize, usize)> {
    let (column, row) = (block % segments.blocks().width, block / segments.blocks().width);
    let step = BLOCK / SAMPLES;
    let at = |first: usize, number: usize| first * BLOCK + number * step + step / 2;
    let places =
        (0..SAMPLES * SAMPLES).map(|number| (at(column, number % SAMPLES), at(row, number / SAMPLES)));
    let size = field.size();
    let counts = |state: &State| state.plane.w > 0.0 && !state.unfounded;
    places.filter(|&(x, y)| x < size.width && y < size.height && counts(field.at(x, y))).collect()
}

/// How well a plane matches at a pixel, whatever its seed.
fn judged(matcher: &Matcher, (x, y): (usize, usize), plane: &Plane) -> Judged {
    let is_inside = plane.w > 0.0 && matcher.is_inside(x, y, plane);
    let pixel = is_inside.then(|| matcher.pixel(x, y, plane.w, 0.0)).flatten();
    let judged = pixel.map(|pixel| pixel.energy(plane, None));
    let judged = judged.unwrap_or(Judged { energy: WORST, correlation: 0.0, best: 0 });
    Judged { energy: judged.energy.min(WORST), ..judged }
}

/// Gives blocks the planes of segments, pixel by pixel where they do not match much worse.
fn take(field: &mut Field, matcher: &Matcher, segments: &Segments, taken: &[(usize, usize)]) {
    let blocks = segments.blocks();
    let mut of_block = vec![None; blocks.area()];
    taken.iter().for_each(|&(block, segment)| of_block[block] = Some(segment));
    for colour in 0..2 {
        field.update(colour, |_, x, y, state| {
            let Some(segment) = of_block[y / BLOCK * blocks.width + x / BLOCK] else { return };
            if state.plane.w <= 0.0 || state.unfounded {
                return;
            }
            let plane = segments.plane(segment, (x, y));
            let (new, old) = (judged(matcher, (x, y), &plane), judged(matcher, (x, y), &state.plane));
            if new.best != 0 && new.energy < old.energy + PIXEL_MARGIN {
                *state = State { settled: true, ..State::new(plane, new) };
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Problem, RefineOptions, solve};
    use nalgebra::Vector3;
    use vamvs_core::{Intrinsics, Photo, Pinhole, Pose, Size};

    const SIZE: Size = Size::new(120, 96);
    const FOCAL: f64 = 100.0;
    const DEPTH: f64 = 4.0;

    /// A camera at (x, 0, 0) that looks along z at a textured wall.
    fn photo(x: f64) -> Photo {
        let intrinsics = Intrinsics { fx: FOCAL, fy: FOCAL, cx: 60.0, cy: 48.0 };
        let image = Grid::from_fn(SIZE, |column, row| {
            let a = x + (column as f64 + 0.5 - 60.0) * DEPTH / FOCAL;
            let b = (row as f64 + 0.5 - 48.0) * DEPTH / FOCAL;
            let wave = (9.0 * a).sin() + (7.0 * b + 3.0 * a).cos() + 0.7 * (23.0 * a + 11.0 * b).sin();
            [(128.0 + 40.0 * wave) as u8; 3]
        });
        let cam_from_world = Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() };
        Photo { camera: Pinhole { size: SIZE, intrinsics }, cam_from_world, image, mask: None }
    }

    fn is_patch(x: usize, y: usize) -> bool {
        (40..72).contains(&x) && (32..56).contains(&y)
    }

    /// The planes after growing, as pixels of disparity from the wall, of a field that is so many pixels off in a patch and
    /// around it.
    fn grown(patch: f32, around: f32) -> impl Fn(usize, usize) -> f32 {
        let (reference, sources) = (photo(0.0), [photo(0.3), photo(-0.3)]);
        let (options, sources) = (RefineOptions::default(), [&sources[0], &sources[1]]);
        let problem = Problem {
            reference: &reference,
            sources: &sources,
            visibility: &[],
            options: &options,
            device: None,
        };
        let matcher = solve::matcher(&problem, 0);
        let (wall, step) = (1.0 / DEPTH as f32, matcher.step(60, 48, 1.0 / DEPTH as f32));
        let mut field = Field::new(SIZE, |x, y| {
            let off = if is_patch(x, y) { patch } else { around };
            let w = wall + off * step;
            State { variance: 0.04, ..State::unjudged(Plane { w, gx: 0.0, gy: 0.0 }) }
        });
        grow(&mut field, &matcher, &Grid::filled(SIZE, step));
        move |x, y| (field.at(x, y).plane.w - wall) / step
    }

    #[test]
    fn a_wall_grows_over_a_patch_that_is_wrong_and_no_wrong_wall_over_one_that_is_right() {
        let off = grown(3.0, 0.0);
        for (x, y) in [(42, 34), (56, 44), (70, 54), (20, 20)] {
            assert!(off(x, y).abs() < 0.1, "{x} {y}: {}", off(x, y));
        }
        let off = grown(0.0, 3.0);
        for (x, y) in [(42, 34), (56, 44), (70, 54)] {
            assert!(off(x, y).abs() < 0.1, "{x} {y}: {}", off(x, y));
        }
    }
}
