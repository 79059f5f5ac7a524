//! The window of a reference pixel: the offsets of its texels, their weights and statistics.

use crate::isa::for_each_isa;
use crate::luminance::{BORDER, Padded};

/// Texels of a window: every other pixel of 11×11 in both directions, without the four corners.
pub(crate) const TEXELS: usize = 32;

/// Number of partial sums over the texels, the same for all instruction sets so that they give the same bits.
pub(crate) const LANES: usize = TEXELS / 2;

/// Values of the texels of a window.
pub(crate) type Texels = [f32; TEXELS];

/// Offsets (x, y) of the texels from the window's centre, pixels.
pub(crate) const OFFSETS: ([f32; TEXELS], [f32; TEXELS]) = offsets();

/// The weights by distance alone, approximately Gaussian.
const NEARNESS: Texels = all_nearness();

const fn offsets() -> ([f32; TEXELS], [f32; TEXELS]) {
    let (mut dx, mut dy) = ([0.0; TEXELS], [0.0; TEXELS]);
    let (mut cell, mut texel) = (0_usize, 0);
    while cell < 36 {
        let (column, row) = (cell % 6, cell / 6);
        let corner = (column == 0 || column == 5) && (row == 0 || row == 5);
        if !corner {
            dx[texel] = 2.0 * column as f32 - 5.0;
            dy[texel] = 2.0 * row as f32 - 5.0;
            texel += 1;
        }
        cell += 1;
    }
    (dx, dy)
}

const fn all_nearness() -> Texels {
    let (mut weights, mut texel) = ([0.0; TEXELS], 0);
    while texel < TEXELS {
        weights[texel] = nearness(OFFSETS.0[texel], OFFSETS.1[texel]);
        texel += 1;
    }
    weights
}

/// The weight of a texel by its offset alone.
pub(crate) const fn nearness(dx: f32, dy: f32) -> f32 {
    // 1 / (1 + t + t²/2 + t³/6) ≈ exp(−t), with t = distance² / (2 · 4.5²).
    let t = (dx * dx + dy * dy) / 40.5;
    1.0 / (1.0 + t + t * t / 2.0 + t * t * t / 6.0)
}

/// The weights and statistics of a reference window.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Window {
    /// Bilateral weights; they sum to 1.
    pub weights: Texels,
    /// Weight · (grey value − mean).
    pub centred: Texels,
    /// The weighted mean, grey values.
    pub mean: f32,
    /// The weighted variance, grey values².
    pub variance: f32,
}

for_each_isa! {
    /// The window of pixel (x, y). The weights fall with the difference in grey value from the centre; at a
    /// difference of `colour` they are a quarter.
    pub(crate) fn window(image: &Padded, x: usize, y: usize, colour: f32) -> Window = weighted
}

#[inline(always)]
fn weighted<const N: usize>(image: &Padded, x: usize, y: usize, colour: f32) -> Window {
    let centre = image.at(x, y);
    let values = texels(image, x, y);
    let scale = 1.0 / (colour * colour);
    let mut weights = [0.0; TEXELS];
    for i in 0..TEXELS {
        let difference = values[i] - centre;
        let likeness = 1.0 / (1.0 + difference * difference * scale);
        weights[i] = NEARNESS[i] * likeness * likeness;
    }
    let norm = 1.0 / sum(&weights);
    let (mut shares, mut first, mut second) = ([0.0; TEXELS], [0.0; TEXELS], [0.0; TEXELS]);
    for i in 0..TEXELS {
        shares[i] = weights[i] * norm;
        first[i] = shares[i] * (values[i] - centre);
        second[i] = first[i] * (values[i] - centre);
    }
    let mean = sum(&first);
    let variance = (sum(&second) - mean * mean).max(0.0);
    let mut centred = [0.0; TEXELS];
    for i in 0..TEXELS {
        centred[i] = first[i] - shares[i] * mean;
    }
    Window { weights: shares, centred, mean: centre + mean, variance }
}

#[inline(always)]
fn texels(image: &Padded, x: usize, y: usize) -> Texels {
    let (values, stride) = image.around(x, y);
    let mut texels = [0.0; TEXELS];
    let mut texel = 0;
    for row in 0..6 {
        let skipped = usize::from(row == 0 || row == 5);
        let values = &values[(BORDER - 5 + 2 * row) * stride + BORDER - 5..][..11];
        for column in skipped..6 - skipped {
            texels[texel] = values[2 * column];
            texel += 1;
        }
    }
    texels
}

/// The sum, in a fixed order that suits vector registers of any length.
#[inline(always)]
pub(crate) fn sum(values: &Texels) -> f32 {
    let mut halves = [0.0; LANES];
    for i in 0..LANES {
        halves[i] = values[i] + values[i + LANES];
    }
    sum_lanes(&halves)
}

/// The sum of 16 values in a fixed order.
#[inline(always)]
pub(crate) fn sum_lanes(values: &[f32; LANES]) -> f32 {
    let (mut a, mut b) = ([0.0; 8], [0.0; 4]);
    for i in 0..8 {
        a[i] = values[i] + values[i + 8];
    }
    for i in 0..4 {
        b[i] = a[i] + a[i + 4];
    }
    sum_of_four(b)
}

/// `(b0 + b2) + (b1 + b3)`, in SSE intrinsics, which every x86-64 processor has: compilers generate more
/// instructions for the plain expression.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn sum_of_four(b: [f32; 4]) -> f32 {
    use std::arch::x86_64::{
        _mm_add_ps, _mm_add_ss, _mm_cvtss_f32, _mm_loadu_ps, _mm_movehl_ps, _mm_shuffle_ps,
    };
    // SAFETY: four values are read from an array of four.
    unsafe {
        let all = _mm_loadu_ps(b.as_ptr());
        let pairs = _mm_add_ps(all, _mm_movehl_ps(all, all));
        _mm_cvtss_f32(_mm_add_ss(pairs, _mm_shuffle_ps::<1>(pairs, pairs)))
    }
}

#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn sum_of_four(b: [f32; 4]) -> f32 {
    (b[0] + b[2]) + (b[1] + b[3])
}
