//! Inner loops in AVX2 intrinsics. They give the same bits as the plain loops of the same names, which compilers split into
//! vectors of four.

use std::arch::x86_64::{
    __m256, __m256i, _mm_add_ps, _mm_cvtss_f32, _mm_movehl_ps, _mm_shuffle_ps, _mm256_add_epi32,
    _mm256_add_ps, _mm256_and_si256, _mm256_castps256_ps128, _mm256_cvtepi32_ps, _mm256_cvttps_epi32,
    _mm256_extractf128_ps, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_loadu_si256, _mm256_max_ps,
    _mm256_min_ps, _mm256_mul_ps, _mm256_mullo_epi32, _mm256_set1_epi32, _mm256_set1_ps, _mm256_setzero_ps,
    _mm256_srli_epi32, _mm256_storeu_ps, _mm256_storeu_si256, _mm256_sub_ps,
};

use vamvs_core::Size;

use crate::transfer::Affine;
use crate::window::{LANES, Texels, Window};

/// The texels' positions in the source image.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub(crate) fn places(
    size: Size,
    warp: &Affine,
    dx: &[f32; 8],
    dy: &[f32; 8],
) -> ([i32; 8], [f32; 8], [f32; 8]) {
    let (dx, dy) = (load(dx), load(dy));
    let along = |origin: f32, [by_x, by_y]: [f32; 2], count: usize| {
        let [origin, by_x, by_y] = [origin - 0.5, by_x, by_y].map(|value| _mm256_set1_ps(value));
        let at = _mm256_fmadd_ps(by_x, dx, _mm256_fmadd_ps(by_y, dy, origin));
        // NaN becomes 0.
        let at = _mm256_max_ps(at, _mm256_setzero_ps());
        _mm256_min_ps(at, _mm256_set1_ps((count - 1) as f32))
    };
    let (x, y) =
        (along(warp.u, [warp.ux, warp.uy], size.width), along(warp.v, [warp.vx, warp.vy], size.height));
    let (column, row) = (_mm256_cvttps_epi32(x), _mm256_cvttps_epi32(y));
    let width = _mm256_set1_epi32(size.width as i32);
    let index = _mm256_add_epi32(_mm256_mullo_epi32(row, width), column);
    let fraction = |at: __m256, whole: __m256i| stored(_mm256_sub_ps(at, _mm256_cvtepi32_ps(whole)));
    let mut indices = [0; 8];
    // SAFETY: eight values are written to an array of eight.
    unsafe { _mm256_storeu_si256(indices.as_mut_ptr().cast(), index) };
    (indices, fraction(x, column), fraction(y, row))
}

/// The bilinear values minus `mean`.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub(crate) fn values(quads: &[u32; 8], fx: &[f32; 8], fy: &[f32; 8], mean: f32) -> [f32; 8] {
    let ([a, b, c, d], fx, mean) = (bytes(quads), load(fx), _mm256_set1_ps(mean));
    let top = _mm256_fmadd_ps(fx, _mm256_sub_ps(b, a), _mm256_sub_ps(a, mean));
    let bottom = _mm256_fmadd_ps(fx, _mm256_sub_ps(d, c), _mm256_sub_ps(c, mean));
    stored(_mm256_fmadd_ps(load(fy), _mm256_sub_ps(bottom, top), top))
}

/// The change of the values per source pixel to the right, and down.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub(crate) fn gradient(quads: &[u32; 8], fx: &[f32; 8], fy: &[f32; 8]) -> ([f32; 8], [f32; 8]) {
    let [a, b, c, d] = bytes(quads);
    // Values are integers, so that the order of the differences does not matter.
    let (right, down) = (_mm256_sub_ps(b, a), _mm256_sub_ps(c, a));
    let twist = _mm256_sub_ps(_mm256_sub_ps(d, c), right);
    (stored(_mm256_fmadd_ps(load(fy), twist, right)), stored(_mm256_fmadd_ps(load(fx), twist, down)))
}

/// The weighted sums over the window of the values, of their squares, and of their products with the window's own.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub(crate) fn moments(window: &Window, values: &Texels) -> [f32; 3] {
    let load =
        |values: &Texels, begin: usize| load(values[begin..begin + 8].try_into().expect("it has that many"));
    // Sums over the texels `begin` to `begin` + 8 and those LANES further on.
    let half = |begin: usize| {
        let [near, far] = [begin, begin + LANES].map(|begin| load(values, begin));
        let weighted = [begin, begin + LANES].map(|begin| load(&window.weights, begin));
        let weighted = [_mm256_mul_ps(weighted[0], near), _mm256_mul_ps(weighted[1], far)];
        let product = _mm256_mul_ps(load(&window.centred, begin), near);
        [
            _mm256_add_ps(weighted[0], weighted[1]),
            _mm256_fmadd_ps(weighted[1], far, _mm256_mul_ps(weighted[0], near)),
            _mm256_fmadd_ps(load(&window.centred, begin + LANES), far, product),
        ]
    };
    let (low, high) = (half(0), half(8));
    [sum(low[0], high[0]), sum(low[1], high[1]), sum(low[2], high[2])]
}

/// The sum of 16 values, in the order of [`crate::window::sum_lanes`].
#[target_feature(enable = "avx2,fma")]
#[inline]
fn sum(low: __m256, high: __m256) -> f32 {
    let eight = _mm256_add_ps(low, high);
    let four = _mm_add_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
    let halves = _mm_add_ps(four, _mm_movehl_ps(four, four));
    _mm_cvtss_f32(_mm_add_ps(halves, _mm_shuffle_ps::<1>(halves, halves)))
}

#[target_feature(enable = "avx2,fma")]
#[inline]
fn bytes(quads: &[u32; 8]) -> [__m256; 4] {
    // SAFETY: eight values are read from an array of eight.
    let quads = unsafe { _mm256_loadu_si256(quads.as_ptr().cast()) };
    let low = |word: __m256i| _mm256_cvtepi32_ps(_mm256_and_si256(word, _mm256_set1_epi32(255)));
    let last = _mm256_cvtepi32_ps(_mm256_srli_epi32::<24>(quads));
    [low(quads), low(_mm256_srli_epi32::<8>(quads)), low(_mm256_srli_epi32::<16>(quads)), last]
}

#[target_feature(enable = "avx2,fma")]
#[inline]
fn load(values: &[f32; 8]) -> __m256 {
    // SAFETY: eight values are read from an array of eight.
    unsafe { _mm256_loadu_ps(values.as_ptr()) }
}

#[target_feature(enable = "avx2,fma")]
#[inline]
fn stored(vector: __m256) -> [f32; 8] {
    let mut values = [0.0; 8];
    // SAFETY: eight values are written to an array of eight.
    unsafe { _mm256_storeu_ps(values.as_mut_ptr(), vector) };
    values
}
