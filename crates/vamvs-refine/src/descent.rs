//! The normal equations of a Gauss–Newton step of a plane towards the best correlation.
//!
//! A gain a and an offset b fit the warped source values v to the reference values r: a v + b ≈ r. The residual's
//! derivatives with respect to depth and slopes are projected orthogonally to what gain and offset can explain
//! (variable projection). So the step leads towards the largest zero-mean normalised cross-correlation.

use nalgebra::{Matrix3, Vector3};

use crate::isa::for_each_isa;
use crate::luminance::Quads;
use crate::sampling::{at_least, sample};
use crate::transfer::Affine;
use crate::window::{LANES, OFFSETS, Window, sum_lanes};

/// Normal equations of inverse depth and its two slopes, for one source view: `matrix · step = vector`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Normal {
    pub matrix: Matrix3<f32>,
    pub vector: Vector3<f32>,
    /// The correlation at the plane itself, as [`crate::correlation::correlations`] gives it.
    pub correlation: f32,
}

for_each_isa! {
    /// The normal equations for a source image under a warp; the warp's centre moves by `speed` source pixels per
    /// unit of inverse depth.
    pub(crate) fn normal(window: &Window, source: &Quads, warp: &Affine, speed: [f32; 2], noise: f32) -> Normal = equations
}

/// Weighted sums over the window of products of v, the source value; r, the reference value (centred); and d, the
/// derivatives of v with respect to inverse depth, its slope in x and its slope in y. `dd` is the upper triangle, row
/// by row.
#[derive(Default)]
struct Sums {
    v: [f32; LANES],
    vv: [f32; LANES],
    rv: [f32; LANES],
    d: [[f32; LANES]; 3],
    dv: [[f32; LANES]; 3],
    dr: [[f32; LANES]; 3],
    dd: [[f32; LANES]; 6],
}

#[inline(always)]
fn equations<const N: usize>(
    window: &Window,
    source: &Quads,
    warp: &Affine,
    speed: [f32; 2],
    noise: f32,
) -> Normal {
    let mut sums = Sums::default();
    for begin in (0..2 * LANES).step_by(N) {
        add::<N>(&mut sums, window, source, warp, speed, begin);
    }
    let floor = noise * noise;
    let mean = sum_lanes(&sums.v);
    let variance = at_least(sum_lanes(&sums.vv) - mean * mean, 0.0) + floor;
    let product = sum_lanes(&sums.rv);
    let gain = product / variance;
    let (mut d, mut dv, mut dr, mut dd) = ([0.0; 3], [0.0; 3], [0.0; 3], [0.0; 6]);
    for j in 0..3 {
        d[j] = sum_lanes(&sums.d[j]);
        dv[j] = sum_lanes(&sums.dv[j]) - d[j] * mean;
        dr[j] = sum_lanes(&sums.dr[j]);
    }
    for (sum, lanes) in dd.iter_mut().zip(&sums.dd) {
        *sum = sum_lanes(lanes);
    }
    let mut normal =
        Normal { correlation: product / ((window.variance + floor) * variance).sqrt(), ..Normal::default() };
    for (place, (j, k)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
        let entry = gain * gain * (dd[place] - d[j] * d[k] - dv[j] * dv[k] / variance);
        (normal.matrix[(j, k)], normal.matrix[(k, j)]) = (entry, entry);
    }
    for j in 0..3 {
        normal.vector[j] = gain * (dr[j] - gain * dv[j]);
    }
    normal
}

#[inline(always)]
fn add<const N: usize>(
    sums: &mut Sums,
    window: &Window,
    source: &Quads,
    warp: &Affine,
    speed: [f32; 2],
    begin: usize,
) {
    let samples = sample::<N>(source, warp, begin);
    let values = samples.values(window.mean);
    let (right, down) = samples.gradient();
    let range = begin..begin + N;
    let (weights, centred) = (&window.weights[range.clone()], &window.centred[range.clone()]);
    let (dx, dy) = (&OFFSETS.0[range.clone()], &OFFSETS.1[range]);
    for i in 0..N {
        let lane = (begin + i) % LANES;
        let (weight, value) = (weights[i], values[i]);
        let change = right[i].mul_add(speed[0], down[i] * speed[1]);
        let weighted = weight * change;
        let twice = weighted * change;
        let of_reference = centred[i] * change;
        let with_value = weighted * value;
        sums.v[lane] = weight.mul_add(value, sums.v[lane]);
        sums.vv[lane] = (weight * value).mul_add(value, sums.vv[lane]);
        sums.rv[lane] = centred[i].mul_add(value, sums.rv[lane]);
        for (j, place) in [1.0, dx[i], dy[i]].into_iter().enumerate() {
            sums.d[j][lane] = weighted.mul_add(place, sums.d[j][lane]);
            sums.dv[j][lane] = with_value.mul_add(place, sums.dv[j][lane]);
            sums.dr[j][lane] = of_reference.mul_add(place, sums.dr[j][lane]);
        }
        let (across, along) = (twice * dx[i], twice * dy[i]);
        sums.dd[0][lane] += twice;
        sums.dd[1][lane] += across;
        sums.dd[2][lane] += along;
        sums.dd[3][lane] = across.mul_add(dx[i], sums.dd[3][lane]);
        sums.dd[4][lane] = across.mul_add(dy[i], sums.dd[4][lane]);
        sums.dd[5][lane] = along.mul_add(dy[i], sums.dd[5][lane]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isa::Isa;
    use crate::luminance::Padded;
    use crate::transfer::Warps;
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
        // This is one step of a linearised problem on 8-bit images, hence the tolerance.
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
        let images = [Some(&source), None, None, None];
        let expected =
            crate::correlation::correlations(&window, &images, &Warps::all(&warp), 1.5, Isa::Scalar);
        assert!((own - expected[0]).abs() < 1e-6);
    }
}
