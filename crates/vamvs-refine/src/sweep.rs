//! A sweep over the image: each pixel tries the planes of its neighbours and refines the best one.

use nalgebra::{Matrix3, Vector3};

use crate::energy::Judged;
use crate::field::{Colour, Field, State};
use crate::matcher::{Matcher, Pixel};
use crate::plane::Plane;
use crate::source::MOST_SOURCES;

/// The neighbours that propagate their planes, by direction. All of them have the other colour of the checkerboard.
const DIRECTIONS: [[(i32, i32); 4]; 4] = [
    [(1, 0), (2, 1), (2, -1), (5, 0)],
    [(-1, 0), (-2, 1), (-2, -1), (-5, 0)],
    [(0, 1), (1, 2), (-1, 2), (0, 5)],
    [(0, -1), (1, -2), (-1, -2), (0, -5)],
];

/// A neighbour's plane is tried if it differs from the pixel's own by more than this over the window, pixels of disparity.
/// Nearer ones would be the same surface with other noise.
const OTHER: f32 = 3.0;

/// A source view's depth is tried if it is farther from the pixel's own than this, and from those that were tried, pixels of
/// disparity.
const DISTINCT: f32 = 0.3;

/// The radius of the window, pixels.
const RADIUS: f32 = 5.0;

/// A Gauss–Newton step that is shorter than this over the window, pixels of disparity, is taken without evaluating its
/// energy, and settles the plane.
const SHORT: f32 = 0.1;

/// The longest Gauss–Newton step: of depth, in pixels of disparity, and of the slopes, in pixels of disparity per
/// pixel.
const LONGEST: [f32; 2] = [1.0, 0.2];

/// Damping of depth and of the slopes, relative to the squared noise: it shortens the steps where there is little
/// texture.
const DAMPING: [f32; 2] = [0.1, 4.0];

/// Improves all planes, those of one colour after those of the other. `prior` gives a pixel's prior inverse depth, 0
/// for none. Planes that have settled are left alone unless another plane replaces them.
pub(crate) fn sweep(field: &mut Field, matcher: &Matcher, prior: impl Fn(usize, usize) -> f32 + Sync) {
    for colour in 0..2 {
        field.update(colour, |other, x, y, state| {
            if state.plane.w <= 0.0 {
                return;
            }
            if let Some(pixel) = matcher.pixel(x, y, state.plane.w, prior(x, y)) {
                improve(&pixel, other, (x, y), 2, state);
            }
        });
    }
}

/// Begins with the planes that `own` gives and those that `beside` tries, and sweeps once, with one Gauss–Newton step.
/// The pixel's own plane is also the prior.
///
/// The second colour begins first. The first one then begins and is swept in one visit, and most of its pixels see the
/// same surface as their neighbours, in the same source views.
pub(crate) fn sweep_from(
    matcher: &Matcher,
    own: impl Fn(usize, usize) -> Plane + Sync,
    beside: impl Fn(&Pixel, (usize, usize), &mut State) + Sync,
) -> Field {
    let pixel = |x: usize, y: usize| {
        let plane = own(x, y);
        if plane.w > 0.0 { Some((matcher.pixel(x, y, plane.w, plane.w)?, plane)) } else { None }
    };
    let mut field = Field::empty(matcher.image.size);
    field.update(1, |_, x, y, state| {
        if let Some((pixel, plane)) = pixel(x, y) {
            *state = State::new(plane, pixel.energy(&plane, None));
            beside(&pixel, (x, y), state);
        }
    });
    field.update(0, |other, x, y, state| {
        if let Some((pixel, plane)) = pixel(x, y) {
            let judged = match matched_best(other, (x, y)) {
                Some(neighbour) => pixel.energy_like(&plane, neighbour),
                None => pixel.energy(&plane, None),
            };
            *state = State::new(plane, judged);
            beside(&pixel, (x, y), state);
            improve(&pixel, other, (x, y), 1, state);
        }
    });
    field.update(1, |other, x, y, state| {
        if let Some((pixel, _)) = pixel(x, y) {
            improve(&pixel, other, (x, y), 1, state);
        }
    });
    field
}

/// The energy of the adjacent pixel that matches best.
fn matched_best(other: Colour, place: (usize, usize)) -> Option<Judged> {
    let neighbours =
        [(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().filter_map(|offset| other.neighbour(place, offset));
    let best = neighbours.min_by(|a, b| a.energy.total_cmp(&b.energy))?;
    (best.best != 0).then(|| best.judged())
}

/// One turn of a pixel, with at most this many Gauss–Newton steps.
fn improve(pixel: &Pixel, other: Colour, place: (usize, usize), steps: usize, state: &mut State) {
    propagate(pixel, other, place, state);
    from_sources(pixel, pixel.matcher.groups.len(), state);
    for _ in 0..steps {
        descend(pixel, state, pixel.matcher.options.noise);
    }
}

/// Takes the plane of a neighbour if its energy is lower. Of each direction, the neighbour with the lowest energy proposes
/// its plane; of those planes that are not the pixel's own, the one with the lowest energy is tried. More planes would fit
/// the noise of textureless windows more often than they would find a surface.
fn propagate(pixel: &Pixel, other: Colour, place: (usize, usize), state: &mut State) {
    let (mut least, mut proposed) = (f32::INFINITY, None);
    for direction in &DIRECTIONS {
        let neighbours =
            direction.iter().filter_map(|&offset| Some((other.neighbour(place, offset)?, offset)));
        let Some((neighbour, (dx, dy))) = neighbours.min_by(|a, b| a.0.energy.total_cmp(&b.0.energy)) else {
            continue;
        };
        let plane = neighbour.plane.seen_from(-dx as f32, -dy as f32);
        if neighbour.energy < least && !same(&plane, &state.plane, pixel.step) {
            (least, proposed) = (neighbour.energy, Some(plane));
        }
    }
    if let Some(plane) = proposed {
        consider(pixel, plane, state);
    }
}

/// Takes the depth of a source view's own depth map if its energy is lower. Of source views that have the same depth,
/// one proposes it.
fn from_sources(pixel: &Pixel, groups: usize, state: &mut State) {
    let (mut tried, mut most) = ([0.0; MOST_SOURCES], 0);
    for group in 0..groups {
        let Some(seen) = pixel.seen(group, &state.plane) else { return };
        let found = seen.w.to_array().into_iter().zip(seen.way.to_array());
        for (w, _) in found.filter(|(_, way)| way.is_finite()) {
            let near = |other: f32| (w - other).abs() < DISTINCT * pixel.step;
            if near(state.plane.w) || tried[..most].iter().any(|&w| near(w)) {
                continue;
            }
            tried[most] = w;
            most += 1;
            consider(pixel, Plane { w, ..state.plane }, state);
        }
    }
}

/// Whether two planes may be the same surface, up to noise.
fn same(a: &Plane, b: &Plane, step: f32) -> bool {
    let over_window = (a.w - b.w).abs() + RADIUS * ((a.gx - b.gx).abs() + (a.gy - b.gy).abs());
    over_window < OTHER * step
}

/// Takes the plane if its energy is lower.
#[inline]
pub(crate) fn consider(pixel: &Pixel, plane: Plane, state: &mut State) {
    let rival = (state.best != 0).then(|| state.judged());
    let judged = pixel.energy(&plane, rival);
    if judged.energy < state.energy {
        *state = State::new(plane, judged);
    }
}

/// A Gauss–Newton step, taken if it lowers the energy in the views that have matched best.
fn descend(pixel: &Pixel, state: &mut State, noise: f32) {
    if state.settled {
        return;
    }
    let (matrix, vector) = pixel.normal(&state.plane, state.best);
    let floor = noise * noise;
    let damping = Vector3::new(DAMPING[0], DAMPING[1], DAMPING[1]) * floor;
    let Some(inverse) = (matrix + Matrix3::from_diagonal(&damping)).try_inverse() else { return };
    let step = inverse * vector;
    let limit = |step: f32, most: f32| step.clamp(-most, most) * pixel.step;
    let plane = Plane {
        w: state.plane.w + limit(step.x, LONGEST[0]),
        gx: state.plane.gx + limit(step.y, LONGEST[1]),
        gy: state.plane.gy + limit(step.z, LONGEST[1]),
    };
    let length = step.x.abs() + RADIUS * (step.y.abs() + step.z.abs());
    if length < SHORT && pixel.is_possible(&plane) {
        (state.plane, state.settled) = (plane, true);
        return;
    }
    let judged = pixel.energy_in(&plane, state.best);
    let is_better = judged.energy < state.energy;
    if is_better {
        *state = State::new(plane, judged);
    }
    state.settled = !is_better;
}
