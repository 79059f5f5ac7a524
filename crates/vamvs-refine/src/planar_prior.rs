//! Planar priors: each pixel is drawn to the plane of its segment as far as its own depth is uncertain.
//!
//! On a textureless surface matching tells little, and depth is noise around the surface; where the surface is a plane, all
//! of its pixels together tell it well. Where matching is sure, or the depth is clearly not the plane's, the plane counts
//! little or nothing, so relief and objects before a wall stay.

use vamvs_core::Grid;

use crate::field::Field;
use crate::plane::Plane;
use crate::segments::{Segments, variance_of};

/// A depth that is farther from the plane than this, in standard deviations, is of another surface.
const OTHER_SURFACE: f64 = 8.0;

/// Replaces each plane by the mean of it and the segment's, weighted by the inverse variances; `steps` holds, for each pixel,
/// the change of inverse depth that is one pixel of disparity.
pub(crate) fn apply(field: &mut Field, steps: &Grid<f32>) {
    let segments = Segments::of(field, steps);
    for colour in 0..2 {
        field.update(colour, |_, x, y, state| {
            let (plane, step) = (state.plane, steps[(x, y)]);
            if plane.w <= 0.0 || state.unfounded {
                return;
            }
            let (w, own) = (f64::from(plane.w), variance_of(state.variance, step));
            let Some(prior) = segments.nearest((x, y), w) else { return };
            let both = own + prior.variance;
            if (prior.w - w).powi(2) > OTHER_SURFACE * OTHER_SURFACE * both {
                return;
            }
            let share = own / both;
            let mixed = |own: f32, other: f64| (f64::from(own) + share * (other - f64::from(own))) as f32;
            state.plane = Plane {
                w: mixed(plane.w, prior.w),
                gx: mixed(plane.gx, prior.gx),
                gy: mixed(plane.gy, prior.gy),
            };
            let variance = share * prior.variance / f64::from(step * step);
            state.variance = state.variance.min(variance as f32);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::State;
    use vamvs_core::Size;

    const STEP: f32 = 0.01;

    /// A wall with a well-textured board in the middle that stands out by two pixels of disparity. The wall is noise of a
    /// pixel.
    fn field() -> (Field, impl Fn(usize, usize) -> f32) {
        let is_board = |x: usize, y: usize| (32..64).contains(&x) && (24..40).contains(&y);
        let wall =
            move |x: usize, y: usize| 1.0 + 1e-3 * x as f32 + if is_board(x, y) { 2.0 * STEP } else { 0.0 };
        let mut random = 1_u32;
        let noise = Grid::from_fn(Size::new(96, 64), |_, _| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) as f32 / (1 << 24) as f32 - 0.5
        });
        let field = Field::new(Size::new(96, 64), |x, y| {
            let sigma = if is_board(x, y) { 0.02 } else { 1.0 };
            let w = wall(x, y) + 12.0_f32.sqrt() * sigma * STEP * noise[(x, y)];
            State { variance: sigma * sigma, ..State::unjudged(Plane { w, gx: 0.0, gy: 0.0 }) }
        });
        (field, wall)
    }

    #[test]
    fn a_noisy_wall_becomes_flat_and_what_stands_out_stays() {
        let (mut field, wall) = field();
        let error = |field: &Field, x: usize, y: usize| (field.at(x, y).plane.w - wall(x, y)).abs() / STEP;
        let mean = |field: &Field| {
            (0..24).flat_map(|y| (0..96).map(move |x| (x, y))).map(|(x, y)| error(field, x, y)).sum::<f32>()
                / (24.0 * 96.0)
        };
        let before = mean(&field);
        apply(&mut field, &Grid::filled(Size::new(96, 64), STEP));
        assert!(before > 0.7 && mean(&field) < 0.15, "{before} {}", mean(&field));
        for (x, y) in [(36, 28), (50, 30), (60, 36)] {
            assert!(error(&field, x, y) < 0.1, "{x} {y}: {}", error(&field, x, y));
        }
        let state = field.at(10, 10);
        assert!(state.variance.sqrt() < 0.35 && (state.plane.gx - 1e-3).abs() < 3e-4);
    }
}
