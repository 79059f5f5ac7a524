//! From the seed to planes at full size, from coarse to fine.

use vamvs_core::{DepthMap, Grid, Photo, Pinhole};

use crate::field::{Field, State};
use crate::luminance::{self, Padded};
use crate::matcher::{Matcher, Pixel};
use crate::matching::{self, Begin, Near};
use crate::plane::Plane;
use crate::seed::{Bounds, Guess, Seed};
use crate::source::{Source, reduced};
use crate::sweep::{consider, sweep, sweep_from};
use crate::{Problem, RefineError, RefineOptions};

/// Most halvings of the photograph.
const MOST_LEVELS: usize = 2;

/// Share of [`RefineOptions::beyond`] at the first resolution, whose pixels are as large as the seed's.
const AT_FIRST: f32 = 0.25;

/// When planes are enlarged, a neighbour's plane is tried if it is farther from the pixel's own than this, pixels
/// of disparity.
pub(crate) const APART: f32 = 1.0;

/// The matcher of a problem, with photographs at 1/2^level of their size.
pub(crate) fn matcher<'a>(problem: &Problem<'a>, level: usize) -> Matcher<'a> {
    let reference = problem.reference;
    let (image, mask) = luminance::at_level(reference, level);
    let camera = reduced(&reference.camera, level);
    let here = (&camera, &reference.cam_from_world);
    let source = |(index, photo): (usize, &&Photo)| {
        Source::new(photo, level, here).with_visibility(problem.visibility.get(index))
    };
    let sources = problem.sources.iter().enumerate().map(source).collect();
    Matcher::new(Padded::new(&image, mask.as_ref()), sources, problem.options)
}

/// The planes at the last resolution, the upsampled seed at the first one, and the matcher of the last one.
pub(crate) fn solve<'a>(
    problem: &Problem<'a>,
    seed: &DepthMap,
) -> Result<(Field, Grid<Guess>, Matcher<'a>), RefineError> {
    let last = last_level(problem.options);
    let first = first_level(&problem.reference.camera, seed).max(last);
    let matcher = self::matcher(problem, first);
    let guesses = Seed::new(seed).guesses(&matcher.image, &reduced(&problem.reference.camera, first));
    let beyond = |level: usize| if level == first { AT_FIRST } else { 1.0 } * problem.options.beyond;
    let near = |level: usize| Near { guesses: &guesses, halvings: first - level, beyond: beyond(level) };
    let mut field =
        matching::planes(&matcher, Begin::Seed(near(first), problem.options.sweeps), problem.device)?;
    let mut matcher = matcher;
    for level in (last..first).rev() {
        matcher = self::matcher(problem, level);
        field = matching::planes(&matcher, Begin::Planes(&field, Some(near(level))), problem.device)?;
    }
    Ok((field, guesses, matcher))
}

/// The planes of all pixels by the processor.
pub(crate) fn planes(matcher: &Matcher<'_>, begin: Begin<'_>) -> Field {
    match begin {
        Begin::Seed(Near { guesses, beyond, .. }, sweeps) => {
            let mut field = search(matcher, guesses, beyond);
            for _ in 0..sweeps {
                sweep(&mut field, |x, y, w| near_seed(matcher, guesses, (x, y, w), beyond));
            }
            field
        }
        Begin::Planes(field, near) => {
            let bounds =
                |x: usize, y: usize, step: f32| near.map_or(Bounds::NONE, |near| near.bounds(x, y, step));
            if field.size() == matcher.image.size {
                return sweep_from(matcher, (|x, y| field.at(x, y).plane, bounds), |_, _, _| ());
            }
            enlarged(field, matcher, bounds)
        }
    }
}

impl Near<'_> {
    /// The bounds of a pixel, given its [`Pixel::step`].
    fn bounds(&self, x: usize, y: usize, step: f32) -> Bounds {
        let inside = |at: usize, count: usize| (at >> self.halvings).min(count - 1);
        let place = (inside(x, self.guesses.width()), inside(y, self.guesses.height()));
        self.guesses[place].bounds(self.beyond * step)
    }
}

/// The level (number of halvings) of the result.
pub(crate) fn last_level(options: &RefineOptions) -> usize {
    options.halvings.min(MOST_LEVELS)
}

/// The level at which the search begins: that at which a pixel of the seed is one to two pixels wide, limited to 1
/// to [`MOST_LEVELS`].
fn first_level(camera: &Pinhole, seed: &DepthMap) -> usize {
    let ratio = camera.intrinsics.fx / seed.camera.intrinsics.fx;
    (ratio.log2().floor() as usize).clamp(1, MOST_LEVELS)
}

/// A pixel whose surface is sought near the seed, around inverse depth `w`.
fn near_seed<'a>(
    matcher: &'a Matcher<'a>,
    guesses: &Grid<Guess>,
    (x, y, w): (usize, usize, f32),
    beyond: f32,
) -> Option<Pixel<'a>> {
    let guess = &guesses[(x, y)];
    let pixel = matcher.pixel(x, y, w, guess.trusted().w)?;
    Some(Pixel { bounds: guess.bounds(beyond * pixel.step), ..pixel })
}

/// The best planes near the seed: steps in depth around its plane, and the surfaces beside it.
fn search(matcher: &Matcher, guesses: &Grid<Guess>, beyond: f32) -> Field {
    Field::new(matcher.image.size, |x, y| {
        let Guess { plane, ends, .. } = guesses[(x, y)];
        let pixel = (plane.w > 0.0).then(|| near_seed(matcher, guesses, (x, y, plane.w), beyond)).flatten();
        let Some(pixel) = pixel else { return State::unjudged(Plane::default()) };
        let mut state = State::unjudged(plane);
        let reach = matcher.options.search as i32;
        consider(&pixel, plane, &mut state);
        for offset in (-reach..=reach).filter(|&offset| offset != 0) {
            let w = plane.w + offset as f32 * pixel.step;
            consider(&pixel, Plane { w, ..plane }, &mut state);
        }
        for w in ends {
            if (w - plane.w).abs() > (reach as f32 + 0.5) * pixel.step {
                consider(&pixel, Plane { w, gx: 0.0, gy: 0.0 }, &mut state);
            }
        }
        state
    })
}

/// The plane of the pixel at half the resolution that contains `(x, y)`, as seen from `(x, y)`, and that pixel.
pub(crate) fn parent(coarse: &Field, x: usize, y: usize) -> (Plane, (usize, usize)) {
    let size = coarse.size();
    let (px, py) = ((x / 2).min(size.width - 1), (y / 2).min(size.height - 1));
    (coarse.at(px, py).plane.enlarged(2.0, (px, py), (x, y)), (px, py))
}

/// The planes at twice the resolution: each pixel begins with the best plane of the four nearest coarse pixels.
/// `bounds` are those of a pixel, given its [`Pixel::step`].
fn enlarged(coarse: &Field, matcher: &Matcher, bounds: impl Fn(usize, usize, f32) -> Bounds + Sync) -> Field {
    let size = coarse.size();
    let own = |x: usize, y: usize| parent(coarse, x, y).0;
    sweep_from(matcher, (own, bounds), |pixel, (x, y), state| {
        let (own, (px, py)) = parent(coarse, x, y);
        let beside = |at: usize, parent: usize, count: usize| {
            if at.is_multiple_of(2) { parent.saturating_sub(1) } else { (parent + 1).min(count - 1) }
        };
        let (qx, qy) = (beside(x, px, size.width), beside(y, py, size.height));
        for place in [(qx, py), (px, qy), (qx, qy)] {
            let plane = coarse.at(place.0, place.1).plane.enlarged(2.0, place, (x, y));
            if plane.w > 0.0 && (plane.w - own.w).abs() > APART * pixel.step {
                consider(pixel, plane, state);
            }
        }
    })
}
