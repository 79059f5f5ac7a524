//! A sweep over the image: planes of neighbours are tried, and the best is polished.

use crate::field::{Colour, Field, State};
use crate::matcher::{Matcher, Pixel};
use crate::plane::Plane;

/// Where planes come from, for each of four directions; all places are of the other colour.
const DIRECTIONS: [[(i32, i32); 4]; 4] = [
    [(1, 0), (2, 1), (2, -1), (5, 0)],
    [(-1, 0), (-2, 1), (-2, -1), (-5, 0)],
    [(0, 1), (1, 2), (-1, 2), (0, 5)],
    [(0, -1), (1, -2), (-1, -2), (0, -5)],
];

/// Planes that differ by less, in pixels of disparity over the window, are the same.
const SAME: f32 = 0.03;

/// The radius of the window, pixels.
const RADIUS: f32 = 5.0;

/// How a sweep goes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sweep {
    /// The first trial step of depth, pixels of disparity.
    pub depth: f32,
    /// The first trial step of slopes, pixels of disparity a pixel.
    pub slope: f32,
}

/// Improves all planes, first of the one, then of the other colour. `prior` is what was known of a pixel before.
pub(crate) fn sweep(
    field: &mut Field,
    matcher: &Matcher,
    prior: impl Fn(usize, usize) -> f32 + Sync,
    how: Sweep,
) {
    for colour in 0..2 {
        field.update(colour, |other, x, y, state| {
            if state.plane.w <= 0.0 {
                return;
            }
            if let Some(pixel) = matcher.pixel(x, y, state.plane.w, prior(x, y)) {
                propagate(&pixel, other, (x, y), state);
                from_sources(&pixel, matcher.sources.len(), state);
                polish(&pixel, state, how);
            }
        });
    }
}

/// Takes the plane of a neighbour where it is better.
fn propagate(pixel: &Pixel, other: Colour, place: (usize, usize), state: &mut State) {
    let mut tried = [state.plane; DIRECTIONS.len() + 1];
    for (number, direction) in DIRECTIONS.iter().enumerate() {
        let neighbours = direction.iter().filter_map(|&offset| Some((other.beside(place, offset)?, offset)));
        let best = neighbours.min_by(|a, b| a.0.energy.total_cmp(&b.0.energy));
        let Some((neighbour, (dx, dy))) = best else { continue };
        let plane = neighbour.plane.seen_from(-dx as f32, -dy as f32);
        if !tried[..=number].iter().any(|other| same(&plane, other, pixel.step)) {
            consider(pixel, plane, state);
        }
        tried[number + 1] = plane;
    }
}

/// Takes the depth that the source views' own depth maps have there where it is better.
fn from_sources(pixel: &Pixel, count: usize, state: &mut State) {
    for source in 0..count {
        let Some(seen) = pixel.seen_by(source, &state.plane) else { continue };
        let plane = Plane { w: seen.w, ..state.plane };
        if !same(&plane, &state.plane, pixel.step) {
            consider(pixel, plane, state);
        }
    }
}

fn same(a: &Plane, b: &Plane, step: f32) -> bool {
    let over_window = (a.w - b.w).abs() + RADIUS * ((a.gx - b.gx).abs() + (a.gy - b.gy).abs());
    over_window < SAME * step
}

/// Takes the plane if its energy is lower, and tells its energy.
#[inline]
pub(crate) fn consider(pixel: &Pixel, plane: Plane, state: &mut State) -> f32 {
    let energy = pixel.energy(&plane);
    if energy < state.energy {
        *state = State { plane, energy };
    }
    energy
}

/// Moves depth, then both slopes, to the least of the parabola through three energies.
pub(crate) fn polish(pixel: &Pixel, state: &mut State, how: Sweep) {
    let (depth, slope) = (how.depth * pixel.step, how.slope * pixel.step);
    for direction in [
        Plane { w: depth, gx: 0.0, gy: 0.0 },
        Plane { w: 0.0, gx: slope, gy: 0.0 },
        Plane { w: 0.0, gx: 0.0, gy: slope },
    ] {
        descend(pixel, state, &direction);
    }
}

/// Moves a plane along one direction.
fn descend(pixel: &Pixel, state: &mut State, direction: &Plane) {
    let State { plane: origin, energy: centre } = *state;
    let along = |t: f32| Plane {
        w: origin.w + t * direction.w,
        gx: origin.gx + t * direction.gx,
        gy: origin.gy + t * direction.gy,
    };
    let before = consider(pixel, along(-1.0), state);
    let after = consider(pixel, along(1.0), state);
    let bend = before - 2.0 * centre + after;
    let least = 0.5 * (before - after) / bend;
    if bend > 0.0 && least.abs() < 2.0 && least.abs() > 0.02 {
        consider(pixel, along(least), state);
    }
}
