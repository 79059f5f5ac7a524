//! Zero-mean normalised cross-correlation of a reference window with a source image.

use crate::isa::for_each_isa;
use crate::luminance::Quads;
use crate::sampling::{at_least, sample};
use crate::transfer::Affine;
use crate::window::{LANES, Window, sum_lanes};

for_each_isa! {
    /// The correlation, −1 to 1, of the window with the source image under the warp. The square of `noise`, grey
    /// values, is added to both variances, so that the correlation of a textureless window is near 0. The border
    /// of the source image is replicated.
    pub(crate) fn correlation(window: &Window, source: &Quads, warp: &Affine, noise: f32) -> f32 = correlate
}

#[inline(always)]
fn correlate<const N: usize>(window: &Window, source: &Quads, warp: &Affine, noise: f32) -> f32 {
    let (mut first, mut second, mut product) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for part in (0..LANES).step_by(N) {
        let (mut firsts, mut seconds, mut products) = ([0.0; N], [0.0; N], [0.0; N]);
        for begin in [part, part + LANES] {
            let values = sample::<N>(source, warp, begin).values(window.mean);
            let (weights, centred) = (&window.weights[begin..begin + N], &window.centred[begin..begin + N]);
            for i in 0..N {
                let weighted = weights[i] * values[i];
                firsts[i] += weighted;
                seconds[i] = weighted.mul_add(values[i], seconds[i]);
                products[i] = centred[i].mul_add(values[i], products[i]);
            }
        }
        first[part..part + N].copy_from_slice(&firsts);
        second[part..part + N].copy_from_slice(&seconds);
        product[part..part + N].copy_from_slice(&products);
    }
    let mean = sum_lanes(&first);
    let variance = at_least(sum_lanes(&second) - mean * mean, 0.0);
    let floor = noise * noise;
    sum_lanes(&product) / ((window.variance + floor) * (variance + floor)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isa::Isa;
    use crate::luminance::Padded;
    use crate::window::{self, OFFSETS, TEXELS};
    use vamvs_core::{Grid, Size};

    const NOISE: f32 = 1.5;

    fn picture(seed: usize) -> Grid<u8> {
        Grid::from_fn(Size::new(70, 50), |x, y| {
            let wave = (0.31 * x as f32 + 0.2 * (seed * y) as f32).sin() + (0.45 * y as f32).cos();
            (120.0 + 50.0 * wave) as u8 + ((x * 31 + y * 17 + seed * 7) % 11) as u8
        })
    }

    const WARP: Affine = Affine { u: 33.4, v: 21.7, ux: 0.93, uy: 0.12, vx: -0.2, vy: 1.08 };

    /// The correlation by its definition, in double precision.
    fn by_definition(window: &Window, image: &Grid<u8>, warp: &Affine, reference: &Padded) -> f64 {
        let (values, stride) = reference.around(30, 20);
        let at = |x: i32, y: i32| {
            let inside = |v: i32, count: usize| v.clamp(0, count as i32 - 1) as usize;
            f64::from(image[(inside(x, image.width()), inside(y, image.height()))])
        };
        let texel = |i: usize| {
            let (dx, dy) = (OFFSETS.0[i], OFFSETS.1[i]);
            let own = values[(6 + dy as i32) as usize * stride + (6 + dx as i32) as usize];
            let x = f64::from(warp.u + warp.ux * dx + warp.uy * dy) - 0.5;
            let y = f64::from(warp.v + warp.vx * dx + warp.vy * dy) - 0.5;
            let (column, row, fx, fy) = (x.floor() as i32, y.floor() as i32, x - x.floor(), y - y.floor());
            let mix = |row: i32| at(column, row) * (1.0 - fx) + at(column + 1, row) * fx;
            (f64::from(window.weights[i]), f64::from(own), mix(row) * (1.0 - fy) + mix(row + 1) * fy)
        };
        let texels: Vec<_> = (0..TEXELS).map(texel).collect();
        let mean = |f: &dyn Fn(f64, f64) -> f64| texels.iter().map(|&(w, a, b)| w * f(a, b)).sum::<f64>();
        let (a, b) = (mean(&|a, _| a), mean(&|_, b| b));
        let floor = f64::from(NOISE * NOISE);
        let variances = (mean(&|a, _| a * a) - a * a + floor) * (mean(&|_, b| b * b) - b * b + floor);
        (mean(&|a, b| a * b) - a * b) / variances.sqrt()
    }

    #[test]
    fn it_is_what_its_definition_says() {
        let (reference, source) = (picture(1), picture(2));
        let padded = Padded::new(&reference, None);
        let window = window::window(&padded, 30, 20, 25.0, Isa::Scalar);
        assert!((window.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let found = correlation(&window, &Quads::new(&source), &WARP, NOISE, Isa::Scalar);
        let expected = by_definition(&window, &source, &WARP, &padded);
        assert!((f64::from(found) - expected).abs() < 1e-4, "{found} {expected}");
        let beside = Affine { u: -1.0, v: 49.0, ..WARP };
        let found = correlation(&window, &Quads::new(&source), &beside, NOISE, Isa::Scalar);
        let expected = by_definition(&window, &source, &beside, &padded);
        assert!((f64::from(found) - expected).abs() < 0.02, "{found} {expected} over the border");
    }

    #[test]
    fn an_image_matches_itself_whatever_the_exposure_and_nothing_matches_grey() {
        let image = picture(3);
        let window = window::window(&Padded::new(&image, None), 30, 20, 25.0, Isa::Scalar);
        let same = Affine { u: 30.5, v: 20.5, ux: 1.0, uy: 0.0, vx: 0.0, vy: 1.0 };
        let darker = image.map(|grey| grey / 2 + 10);
        assert!(correlation(&window, &Quads::new(&darker), &same, 0.5, Isa::Scalar) > 0.99);
        let grey = Quads::new(&image.map(|_| 128));
        assert!(correlation(&window, &grey, &same, 0.5, Isa::Scalar).abs() < 1e-3);
    }

    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let (padded, source) = (Padded::new(&picture(1), None), Quads::new(&picture(2)));
        for x in 0..70 {
            let window = |isa| window::window(&padded, x, 25, 25.0, isa);
            let warp = Affine { u: x as f32 - 3.2, vx: 0.01 * x as f32, ..WARP };
            let value = |isa| correlation(&window(isa), &source, &warp, NOISE, isa).to_bits();
            for isa in Isa::all() {
                assert_eq!(value(isa), value(Isa::Scalar), "{isa:?} at {x}");
            }
        }
    }
}
