//! A sweep over the image: each pixel tries the planes of its neighbours and refines the best one.

use nalgebra::{Matrix3, Vector3};

use crate::energy::Judged;
use crate::field::{Colour, Field, State};
use crate::matcher::{Matcher, Pixel};
use crate::plane::Plane;
use crate::seed::Bounds;
use crate::source::MOST_SOURCES;

/// The neighbours that propagate their planes, by direction. All of them have the other colour of the checkerboard.
pub const DIRECTIONS: [[(i32, i32); 4]; 4] = [
    [(1, 0), (2, 1), (2, -1), (5, 0)],
    [(-1, 0), (-2, 1), (-2, -1), (-5, 0)],
    [(0, 1), (1, 2), (-1, 2), (0, 5)],
    [(0, -1), (1, -2), (-1, -2), (0, -5)],
];

/// The adjacent pixels. All of them have the other colour.
pub const ADJACENT: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

/// Adjacent planes agree if their inverse depths at the pixel between them differ by less than this, pixels of disparity.
pub(crate) const AGREE: f32 = 1.0;

/// The pixel's own plane agrees with their mean if it is nearer than this, pixels of disparity.
pub(crate) const NEAR: f32 = 3.0;

/// A neighbour's plane is tried if it differs from the pixel's own by more than this over the window, pixels of disparity.
/// Nearer ones would be the same surface with other noise.
pub(crate) const OTHER: f32 = 3.0;

/// A source view's depth is tried if it is farther from the pixel's own than this, and from those that were tried, pixels of
/// disparity.
pub(crate) const DISTINCT: f32 = 0.3;

/// The radius of the window, pixels.
pub(crate) const RADIUS: f32 = 5.0;

/// A Gauss–Newton step that is shorter than this over the window, pixels of disparity, is taken without evaluating its
/// energy, and settles the plane.
pub(crate) const SHORT: f32 = 0.1;

/// The longest Gauss–Newton step: of depth, in pixels of disparity, and of the slopes, in pixels of disparity per
/// pixel.
pub(crate) const LONGEST: [f32; 2] = [1.0, 0.2];

/// The variance of a depth that is fitted to one texel with this residual variance is this share of it: a window has many
/// texels, of which some are independent. Fitted to rendered scenes, after planes are smoothed.
pub(crate) const INDEPENDENT: f32 = 0.05;

/// Damping of depth and of the slopes, relative to the squared noise: it shortens the steps where there is little
/// texture.
pub(crate) const DAMPING: [f32; 2] = [0.1, 4.0];

/// Improves all planes, those of one colour after those of the other. `pixel(x, y, w)` gives a pixel around inverse depth
/// `w`. Planes that have settled are left alone unless another plane replaces them.
pub(crate) fn sweep<'a>(field: &mut Field, pixel: impl Fn(usize, usize, f32) -> Option<Pixel<'a>> + Sync) {
    for colour in 0..2 {
        field.update(colour, |other, x, y, state| {
            if state.plane.w <= 0.0 {
                return;
            }
            if let Some(pixel) = pixel(x, y, state.plane.w) {
                improve(&pixel, other, (x, y), 2, state);
            }
        });
    }
}

/// Begins with the planes that `own` gives and those that `beside` tries, and sweeps once, with one Gauss–Newton step.
/// The pixel's own plane is also the prior. `bounds` are those of a pixel, given its [`Pixel::step`].
///
/// The second colour begins. The first one takes the mean of the four adjacent planes where these agree, so that only
/// half of the pixels of a smooth surface are matched; elsewhere it begins and is swept, and then the second colour beside
/// it is.
pub(crate) fn sweep_from(
    matcher: &Matcher,
    (own, bounds): (impl Fn(usize, usize) -> Plane + Sync, impl Fn(usize, usize, f32) -> Bounds + Sync),
    beside: impl Fn(&Pixel, (usize, usize), &mut State) + Sync,
) -> Field {
    let pixel = |x: usize, y: usize, plane: &Plane| {
        let pixel = if plane.w > 0.0 { matcher.pixel(x, y, plane.w, plane.w)? } else { return None };
        Some(Pixel { bounds: bounds(x, y, pixel.step), ..pixel })
    };
    let mut field = Field::empty(matcher.image.size);
    field.update(1, |_, x, y, state| {
        let plane = own(x, y);
        if let Some(pixel) = pixel(x, y, &plane) {
            *state = State::new(plane, pixel.energy(&plane, None));
            beside(&pixel, (x, y), state);
            from_sources(&pixel, state);
            descend(&pixel, state);
            // It takes a second step only if another plane replaces it.
            state.settled = true;
        }
    });
    field.update(0, |other, x, y, state| {
        let plane = own(x, y);
        if let Some(mean) = between(matcher, other, (x, y), &plane) {
            *state = mean;
        } else if let Some(pixel) = pixel(x, y, &plane) {
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
        if adjacent(other, (x, y)).all(State::is_between) {
            return;
        }
        if let Some(pixel) = pixel(x, y, &own(x, y)) {
            improve(&pixel, other, (x, y), 1, state);
        }
    });
    field
}

/// The mean of the four adjacent planes, if they agree with each other and with the pixel's own plane.
fn between(matcher: &Matcher, other: Colour, (x, y): (usize, usize), own: &Plane) -> Option<State> {
    if own.w <= 0.0 || matcher.image.at(x, y) < 0.0 {
        return None;
    }
    let (mean, range) = mean_of_adjacent(other, (x, y))?;
    let step = matcher.step(x, y, own.w);
    let agree = range < AGREE * step && (mean.plane.w - own.w).abs() < NEAR * step;
    agree.then_some(mean)
}

/// The mean of the four adjacent planes as seen from the pixel, and the range of their inverse depths there.
fn mean_of_adjacent(other: Colour, place: (usize, usize)) -> Option<(State, f32)> {
    let mut mean = State { settled: true, ..State::default() };
    let (mut least, mut most) = (f32::INFINITY, 0.0_f32);
    for (dx, dy) in ADJACENT {
        let neighbour = other.neighbour(place, (dx, dy))?;
        let Plane { w, gx, gy } = neighbour.plane.seen_from(-dx as f32, -dy as f32);
        (least, most) = (least.min(w), most.max(w));
        let sum = mean.plane;
        mean.plane = Plane { w: sum.w + 0.25 * w, gx: sum.gx + 0.25 * gx, gy: sum.gy + 0.25 * gy };
        mean.energy += 0.25 * neighbour.energy;
        mean.correlation += 0.25 * neighbour.correlation;
        mean.variance += 0.25 * neighbour.variance;
    }
    Some((mean, most - least))
}

/// The adjacent pixels that have a plane.
fn adjacent<'a>(other: Colour<'a>, place: (usize, usize)) -> impl Iterator<Item = &'a State> {
    ADJACENT.into_iter().filter_map(move |offset| other.neighbour(place, offset))
}

/// The energy of the adjacent pixel that matches best.
fn matched_best(other: Colour, place: (usize, usize)) -> Option<Judged> {
    let best = adjacent(other, place).min_by(|a, b| a.energy.total_cmp(&b.energy))?;
    (best.best != 0).then(|| best.judged())
}

/// One turn of a pixel, with at most this many Gauss–Newton steps.
fn improve(pixel: &Pixel, other: Colour, place: (usize, usize), steps: usize, state: &mut State) {
    propagate(pixel, other, place, state);
    from_sources(pixel, state);
    for _ in 0..steps {
        descend(pixel, state);
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
fn from_sources(pixel: &Pixel, state: &mut State) {
    let (mut tried, mut most) = ([0.0; MOST_SOURCES], 0);
    for group in 0..pixel.matcher.groups.len() {
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

/// A Gauss–Newton step over all views that match, taken if it raises their correlation and lowers the energy in those that
/// match best.
fn descend(pixel: &Pixel, state: &mut State) {
    if state.settled {
        return;
    }
    let equations = pixel.equations(&state.plane, state.judged());
    let floor = pixel.matcher.options.noise.powi(2);
    let damping = Vector3::new(DAMPING[0], DAMPING[1], DAMPING[1]) * floor;
    let Some(inverse) = (equations.matrix + Matrix3::from_diagonal(&damping)).try_inverse() else { return };
    let step = inverse * equations.vector;
    let unexplained = 1.0 - equations.correlation * equations.correlation;
    let variance = INDEPENDENT * (pixel.window.variance * unexplained + floor) * inverse[(0, 0)];
    let limit = |step: f32, most: f32| step.clamp(-most, most) * pixel.step;
    let plane = Plane {
        w: state.plane.w + limit(step.x, LONGEST[0]),
        gx: state.plane.gx + limit(step.y, LONGEST[1]),
        gy: state.plane.gy + limit(step.z, LONGEST[1]),
    };
    let length = step.x.abs() + RADIUS * (step.y.abs() + step.z.abs());
    if length < SHORT && pixel.is_possible(&plane) {
        (state.plane, state.variance, state.settled) = (plane, variance, true);
        return;
    }
    let (judged, correlation) = pixel.energy_and_correlation(&plane, state.best, equations.views);
    let is_better = correlation > equations.correlation && judged.energy < state.energy;
    if is_better {
        *state = State::new(plane, judged);
    }
    (state.variance, state.settled) = (variance, !is_better);
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::Size;

    #[test]
    fn the_mean_of_adjacent_planes_of_a_surface_is_its_plane() {
        let inverse_depth = |x: usize, y: usize| 2.0 + 0.25 * x as f32 - 0.125 * y as f32;
        let state = |x: usize, y: usize| {
            let (gx, gy) = if x < 5 { (0.25, -0.125) } else { (0.0, 0.0) };
            let w = if x < 5 { inverse_depth(x, y) } else { 1.0 };
            State { energy: 0.2, correlation: 0.8, ..State::unjudged(Plane { w, gx, gy }) }
        };
        Field::new(Size::new(8, 6), state).update(0, |other, x, y, _| {
            let found = mean_of_adjacent(other, (x, y));
            let is_at_border = x == 0 || y == 0 || x == 7 || y == 5;
            assert_eq!(found.is_none(), is_at_border);
            let Some((mean, range)) = found else { return };
            assert!((mean.energy - 0.2).abs() < 1e-6 && (mean.correlation - 0.8).abs() < 1e-6);
            match x {
                ..4 => assert_eq!((mean.plane, range), (state(x, y).plane, 0.0)),
                4 => assert_eq!(range, inverse_depth(4, y) - 1.0),
                5 => assert_eq!(range, inverse_depth(5, y) - 1.0),
                _ => assert_eq!((mean.plane.w, range), (1.0, 0.0)),
            }
        });
    }
}
