//! Zero-mean normalised cross-correlation of a reference window with a source image.

#[cfg(target_arch = "x86_64")]
use crate::avx2;
use crate::isa::for_each_isa;
use crate::luminance::Quads;
use crate::sampling::{at_least, sample};
use crate::transfer::{TOGETHER, Warps};
use crate::window::{LANES, TEXELS, Texels, Window, sum_lanes};

/// Source images, `None` where there is no view, or its correlation is not wanted.
pub(crate) type Images<'a> = [Option<&'a Quads>; TOGETHER];

for_each_isa! {
    /// The correlations, −1 to 1, of the window with source images under its warps into them; 0 outside of an image. The
    /// square of `noise`, grey values, is added to both variances, so that the correlation of a textureless window is
    /// near 0. The border of a source image is replicated.
    pub(crate) fn correlations(window: &Window, images: &Images<'_>, warps: &Warps, noise: f32) -> [f32; TOGETHER] = correlate
}

#[inline(always)]
fn correlate<const N: usize>(
    window: &Window,
    images: &Images<'_>,
    warps: &Warps,
    noise: f32,
) -> [f32; TOGETHER] {
    let (mut mean, mut second, mut product) = ([0.0; TOGETHER], [0.0; TOGETHER], [0.0; TOGETHER]);
    for (i, image) in images.iter().enumerate() {
        let (Some(source), Some(warp)) = (image, warps.of(i)) else { continue };
        let mut values = [0.0; TEXELS];
        for begin in (0..TEXELS).step_by(N) {
            values[begin..begin + N].copy_from_slice(&sample::<N>(source, &warp, begin).values(window.mean));
        }
        [mean[i], second[i], product[i]] = moments::<N>(window, &values);
    }
    let floor = noise * noise;
    let mut found = [0.0; TOGETHER];
    for i in 0..TOGETHER {
        let variance = at_least(second[i] - mean[i] * mean[i], 0.0);
        found[i] = product[i] / ((window.variance + floor) * (variance + floor)).sqrt();
    }
    found
}

/// The weighted sums of the values, of their squares, and of their products with the window's own.
#[inline(always)]
fn moments<const N: usize>(window: &Window, values: &Texels) -> [f32; 3] {
    #[cfg(target_arch = "x86_64")]
    if N == 16 {
        // SAFETY: vectors have 16 values only where the processor has AVX-512.
        return unsafe { moments_avx512(window, values) };
    }
    #[cfg(target_arch = "x86_64")]
    if N == 8 {
        // SAFETY: vectors have 8 values only where the processor has AVX2.
        return unsafe { avx2::moments(window, values) };
    }
    let (mut first, mut second, mut product) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for begin in [0, LANES] {
        for lane in 0..LANES {
            let (weight, value) = (window.weights[begin + lane], values[begin + lane]);
            let weighted = weight * value;
            first[lane] += weighted;
            second[lane] = weighted.mul_add(value, second[lane]);
            product[lane] = window.centred[begin + lane].mul_add(value, product[lane]);
        }
    }
    [sum_lanes(&first), sum_lanes(&second), sum_lanes(&product)]
}

/// The same sums in the same order. Compilers split the plain loop into vectors of four, as the sums end in four.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,fma")]
#[inline]
fn moments_avx512(window: &Window, values: &Texels) -> [f32; 3] {
    use std::arch::x86_64::{
        __m128, __m512, _mm_add_ps, _mm_cvtss_f32, _mm_movehl_ps, _mm_shuffle_ps, _mm256_add_ps,
        _mm256_castps256_ps128, _mm256_extractf128_ps, _mm512_add_ps, _mm512_castps512_ps256,
        _mm512_extractf32x8_ps, _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_mul_ps,
    };
    let load = |values: &Texels, begin: usize| {
        let part: &[f32; LANES] = values[begin..begin + LANES].try_into().expect("it has that many");
        // SAFETY: sixteen values are read from an array of sixteen.
        unsafe { _mm512_loadu_ps(part.as_ptr()) }
    };
    // The sum as of `sum_lanes`, in the first two of four values.
    let halved = |sum: __m512| -> __m128 {
        let eight = _mm256_add_ps(_mm512_castps512_ps256(sum), _mm512_extractf32x8_ps::<1>(sum));
        let four = _mm_add_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
        _mm_add_ps(four, _mm_movehl_ps(four, four))
    };
    let (low, high) = (load(values, 0), load(values, LANES));
    let (near, far) = (load(&window.weights, 0), load(&window.weights, LANES));
    let (near, far) = (_mm512_mul_ps(near, low), _mm512_mul_ps(far, high));
    let first = _mm512_add_ps(near, far);
    let second = _mm512_fmadd_ps(far, high, _mm512_mul_ps(near, low));
    let product = _mm512_mul_ps(load(&window.centred, 0), low);
    let product = _mm512_fmadd_ps(load(&window.centred, LANES), high, product);
    let sum = |halves: __m128| _mm_cvtss_f32(_mm_add_ps(halves, _mm_shuffle_ps::<1>(halves, halves)));
    [sum(halved(first)), sum(halved(second)), sum(halved(product))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isa::Isa;
    use crate::luminance::Padded;
    use crate::transfer::Affine;
    use crate::window::{self, OFFSETS};
    use vamvs_core::{Grid, Size};

    const NOISE: f32 = 1.5;

    fn correlation(window: &Window, source: &Quads, warp: &Affine, noise: f32, isa: Isa) -> f32 {
        let found = correlations(window, &[None, Some(source), None, None], &Warps::all(warp), noise, isa);
        assert_eq!([found[0], found[2], found[3]], [0.0; 3]);
        found[1]
    }

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
