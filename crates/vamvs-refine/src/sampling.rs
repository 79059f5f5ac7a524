//! Bilinear samples of a source image at the texels of a window.
//!
//! The code uses loops instead of closures: a closure that is not inlined would be compiled without the caller's
//! instruction set.

use vamvs_core::Size;

#[cfg(target_arch = "x86_64")]
use crate::avx2;
use crate::luminance::Quads;
use crate::transfer::Affine;
use crate::window::OFFSETS;

/// The neighbourhoods of some positions in the image: the four grey values around each, and the fractional parts
/// of its coordinates.
pub(crate) struct Samples<const N: usize> {
    quads: [u32; N],
    fx: [f32; N],
    fy: [f32; N],
}

/// Samples of the source at `N` texels from texel `begin` on. The image's border is replicated.
#[inline(always)]
pub(crate) fn sample<const N: usize>(source: &Quads, warp: &Affine, begin: usize) -> Samples<N> {
    let words = source.words();
    let (index, fx, fy) = places::<N>(source.size(), warp, begin);
    let mut quads = [0_u32; N];
    for i in 0..N {
        // SAFETY: the column is at most width − 1 and the row at most height − 1.
        quads[i] = unsafe { *words.as_ptr().offset(index[i] as isize) };
    }
    Samples { quads, fx, fy }
}

/// The texels' positions in the source image, inside it: indices of the pixels to the left and above, and fractions.
#[inline(always)]
fn places<const N: usize>(size: Size, warp: &Affine, begin: usize) -> ([i32; N], [f32; N], [f32; N]) {
    let (last_x, last_y) = ((size.width - 1) as f32, (size.height - 1) as f32);
    let (dx, dy) = (&OFFSETS.0[begin..begin + N], &OFFSETS.1[begin..begin + N]);
    let (mut fx, mut fy, mut index) = ([0.0; N], [0.0; N], [0_i32; N]);
    #[cfg(target_arch = "x86_64")]
    if N == 8 {
        // SAFETY: vectors have 8 values only where the processor has AVX2.
        let found = unsafe { avx2::places(size, warp, eight(dx), eight(dy)) };
        index.copy_from_slice(&found.0);
        fx.copy_from_slice(&found.1);
        fy.copy_from_slice(&found.2);
        return (index, fx, fy);
    }
    // From image coordinates to coordinates whose integers are pixel centres.
    let (u, v) = (warp.u - 0.5, warp.v - 0.5);
    for i in 0..N {
        let x = warp.ux.mul_add(dx[i], warp.uy.mul_add(dy[i], u));
        let y = warp.vx.mul_add(dx[i], warp.vy.mul_add(dy[i], v));
        let (x, y) = (at_most(at_least(x, 0.0), last_x), at_most(at_least(y, 0.0), last_y));
        // SAFETY: both lie between 0 and the last column or row; NaN has become 0.
        let (column, row): (i32, i32) = unsafe { (x.to_int_unchecked(), y.to_int_unchecked()) };
        fx[i] = x - column as f32;
        fy[i] = y - row as f32;
        index[i] = row * size.width as i32 + column;
    }
    (index, fx, fy)
}

impl<const N: usize> Samples<N> {
    /// The bilinear values minus `mean`.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "all of several arrays are indexed")]
    pub fn values(&self, mean: f32) -> [f32; N] {
        let mut values = [0.0; N];
        #[cfg(target_arch = "x86_64")]
        if N == 8 {
            // SAFETY: vectors have 8 values only where the processor has AVX2.
            let found = unsafe { avx2::values(eight(&self.quads), eight(&self.fx), eight(&self.fy), mean) };
            values.copy_from_slice(&found);
            return values;
        }
        for i in 0..N {
            let [a, b, c, d] = bytes(self.quads[i]);
            let top = self.fx[i].mul_add(b - a, a - mean);
            let bottom = self.fx[i].mul_add(d - c, c - mean);
            values[i] = self.fy[i].mul_add(bottom - top, top);
        }
        values
    }

    /// The change of the values per source pixel to the right, and down.
    #[inline(always)]
    pub fn gradient(&self) -> ([f32; N], [f32; N]) {
        let (mut right, mut down) = ([0.0; N], [0.0; N]);
        #[cfg(target_arch = "x86_64")]
        if N == 8 {
            // SAFETY: vectors have 8 values only where the processor has AVX2.
            let found = unsafe { avx2::gradient(eight(&self.quads), eight(&self.fx), eight(&self.fy)) };
            right.copy_from_slice(&found.0);
            down.copy_from_slice(&found.1);
            return (right, down);
        }
        for i in 0..N {
            let [a, b, c, d] = bytes(self.quads[i]);
            right[i] = self.fy[i].mul_add((d - c) - (b - a), b - a);
            down[i] = self.fx[i].mul_add((d - b) - (c - a), c - a);
        }
        (right, down)
    }
}

#[inline(always)]
fn bytes(quad: u32) -> [f32; 4] {
    [
        (quad & 255) as i32 as f32,
        ((quad >> 8) & 255) as i32 as f32,
        ((quad >> 16) & 255) as i32 as f32,
        (quad >> 24) as i32 as f32,
    ]
}

/// The larger of both; `least` if `value` is NaN. This compiles to one instruction, which [`f32::max`] does not.
#[inline(always)]
pub(crate) fn at_least(value: f32, least: f32) -> f32 {
    if value > least { value } else { least }
}

#[inline(always)]
pub(crate) fn at_most(value: f32, most: f32) -> f32 {
    if value < most { value } else { most }
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn eight<T>(values: &[T]) -> &[T; 8] {
    values.try_into().expect("vectors of AVX2 have eight values")
}
