//! A Gauss–Newton step of a plane towards the best correlation.
//!
//! The warped source values v are brought to the reference's r by gain and offset, a v + b; of the residual's
//! derivatives with respect to depth and slopes only what gain and offset cannot explain counts (variable projection).
//! So the step is one towards the largest zero-mean normalised cross-correlation.

use nalgebra::{Matrix3, Vector3};

use crate::isa::for_each_isa;
use crate::luminance::Quads;
use crate::sampling::{LANES, Lanes, at_least, sample};
use crate::transfer::Affine;
use crate::window::{OFFSETS, TEXELS, Window, sum_lanes};

/// Normal equations of inverse depth and its two slopes, for one source view.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Normal {
    pub matrix: Matrix3<f32>,
    pub vector: Vector3<f32>,
    /// The correlation at the plane itself, as [`crate::correlation::correlation`] gives it.
    pub correlation: f32,
}

for_each_isa! {
    /// The normal equations for a source image under a warp, whose centre moves by `speed` source pixels for a unit of
    /// inverse depth.
    pub(crate) fn normal(window: &Window, source: &Quads, warp: &Affine, speed: [f32; 2], noise: f32) -> Normal = equations
}

/// Weighted sums over the window; v: value, d: its change with inverse depth, x, y: texel, r: reference value.
#[derive(Default)]
struct Sums {
    v: Lanes,
    vv: Lanes,
    rv: Lanes,
    d: [Lanes; 3],
    dv: [Lanes; 3],
    dr: [Lanes; 3],
    dd: [Lanes; 6],
}

#[inline(always)]
fn equations(window: &Window, source: &Quads, warp: &Affine, speed: [f32; 2], noise: f32) -> Normal {
    let mut sums = Sums::default();
    for part in 0..TEXELS / LANES {
        add(&mut sums, window, source, warp, speed, part * LANES);
    }
    let floor = noise * noise;
    let mean = sum_lanes(&sums.v);
    let variance = at_least(sum_lanes(&sums.vv) - mean * mean, 0.0) + floor;
    let product = sum_lanes(&sums.rv);
    let gain = product / variance;
    let d = sums.d.each_ref().map(sum_lanes);
    let dv: [f32; 3] = std::array::from_fn(|j| sum_lanes(&sums.dv[j]) - d[j] * mean);
    let dr = sums.dr.each_ref().map(sum_lanes);
    let dd = sums.dd.each_ref().map(sum_lanes);
    let entry = |j: usize, k: usize| {
        let place = [[0, 1, 2], [1, 3, 4], [2, 4, 5]][j][k];
        gain * gain * (dd[place] - d[j] * d[k] - dv[j] * dv[k] / variance)
    };
    Normal {
        matrix: Matrix3::from_fn(entry),
        vector: Vector3::from_fn(|j, _| gain * (dr[j] - gain * dv[j])),
        correlation: product / ((window.variance + floor) * variance).sqrt(),
    }
}

#[inline(always)]
fn add(sums: &mut Sums, window: &Window, source: &Quads, warp: &Affine, speed: [f32; 2], begin: usize) {
    let samples = sample(source, warp, begin);
    let values = samples.values(window.mean);
    let (right, down) = samples.gradient();
    let range = begin..begin + LANES;
    let (weights, centred) = (&window.weights[range.clone()], &window.centred[range.clone()]);
    let (dx, dy) = (&OFFSETS.0[range.clone()], &OFFSETS.1[range]);
    for i in 0..LANES {
        let (weight, value) = (weights[i], values[i]);
        let change = right[i] * speed[0] + down[i] * speed[1];
        let weighted = weight * change;
        let twice = weighted * change;
        let of_reference = centred[i] * change;
        sums.v[i] += weight * value;
        sums.vv[i] += weight * value * value;
        sums.rv[i] += centred[i] * value;
        sums.d[0][i] += weighted;
        sums.d[1][i] += weighted * dx[i];
        sums.d[2][i] += weighted * dy[i];
        sums.dv[0][i] += weighted * value;
        sums.dv[1][i] += weighted * value * dx[i];
        sums.dv[2][i] += weighted * value * dy[i];
        sums.dr[0][i] += of_reference;
        sums.dr[1][i] += of_reference * dx[i];
        sums.dr[2][i] += of_reference * dy[i];
        sums.dd[0][i] += twice;
        sums.dd[1][i] += twice * dx[i];
        sums.dd[2][i] += twice * dy[i];
        sums.dd[3][i] += twice * dx[i] * dx[i];
        sums.dd[4][i] += twice * dx[i] * dy[i];
        sums.dd[5][i] += twice * dy[i] * dy[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isa::Isa;
    use crate::luminance::Padded;
    use crate::window::window;
    use vamvs_core::{Grid, Size};

    fn picture(shift: f32, stretch: f32) -> Grid<u8> {
        Grid::from_fn(Size::new(60, 50), |x, y| {
            let x = 30.5 + (x as f32 - 30.0 - shift) / stretch;
            (125.0 + 60.0 * (0.5 * x).sin() + 50.0 * (0.37 * y as f32 + 0.21 * x).cos()) as u8
        })
    }

    #[test]
    fn a_step_leads_to_where_the_source_was_shifted_and_stretched() {
        let window = window(&Padded::new(&picture(0.0, 1.0), None), 30, 25, 60.0, Isa::Scalar);
        let source = Quads::new(&picture(0.4, 1.03));
        let warp = Affine { u: 30.5, v: 25.5, ux: 1.0, uy: 0.0, vx: 0.0, vy: 1.0 };
        let equations = |isa| normal(&window, &source, &warp, [1.0, 0.0], 1.0, isa);
        let Normal { matrix, vector, .. } = equations(Isa::Scalar);
        let step = matrix.try_inverse().unwrap() * vector;
        // The pixel's centre is half a pixel from where the stretch begins.
        assert!((step - Vector3::new(0.4, 0.03, 0.0)).amax() < 0.04, "{step}");
        for isa in Isa::all() {
            assert_eq!(equations(isa).matrix, matrix);
            assert_eq!(equations(isa).vector, vector);
        }
    }

    #[test]
    fn the_correlation_is_the_matchers() {
        let window = window(&Padded::new(&picture(0.0, 1.0), None), 30, 25, 20.0, Isa::Scalar);
        let source = Quads::new(&picture(1.3, 1.1));
        let warp = Affine { u: 30.2, v: 25.1, ux: 1.1, uy: 0.1, vx: -0.1, vy: 0.9 };
        let own = normal(&window, &source, &warp, [1.0, 0.0], 1.5, Isa::Scalar).correlation;
        let expected = crate::correlation::correlation(&window, &source, &warp, 1.5, Isa::Scalar);
        assert!((own - expected).abs() < 1e-6);
    }
}
