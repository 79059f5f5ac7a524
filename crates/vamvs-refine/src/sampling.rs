//! Bilinear samples of a source image at the texels of a window.
//!
//! Loops instead of closures: what is not inlined into a function for an instruction set is compiled without it.

use crate::luminance::Quads;
use crate::transfer::Affine;
use crate::window::OFFSETS;

/// What lies around some places in the image: four grey values each, and where between them the place is.
pub(crate) struct Samples<const N: usize> {
    quads: [u32; N],
    fx: [f32; N],
    fy: [f32; N],
}

/// Samples of the source at `N` texels from `begin` on. Outside of the image its border goes on.
#[inline(always)]
pub(crate) fn sample<const N: usize>(source: &Quads, warp: &Affine, begin: usize) -> Samples<N> {
    let (words, size) = (source.words(), source.size());
    let (last_x, last_y) = ((size.width - 1) as f32, (size.height - 1) as f32);
    let (dx, dy) = (&OFFSETS.0[begin..begin + N], &OFFSETS.1[begin..begin + N]);
    let (mut fx, mut fy, mut index) = ([0.0; N], [0.0; N], [0_u32; N]);
    // From image coordinates to those in which pixel centres are whole numbers.
    let (u, v) = (warp.u - 0.5, warp.v - 0.5);
    for i in 0..N {
        let x = warp.ux.mul_add(dx[i], warp.uy.mul_add(dy[i], u));
        let y = warp.vx.mul_add(dx[i], warp.vy.mul_add(dy[i], v));
        let (x, y) = (at_most(at_least(x, 0.0), last_x), at_most(at_least(y, 0.0), last_y));
        // SAFETY: both lie between 0 and a size, and NaN has become 0.
        let (column, row): (i32, i32) = unsafe { (x.to_int_unchecked(), y.to_int_unchecked()) };
        fx[i] = x - column as f32;
        fy[i] = y - row as f32;
        index[i] = (row * size.width as i32 + column) as u32;
    }
    let mut quads = [0_u32; N];
    for i in 0..N {
        // SAFETY: the column is at most width − 1 and the row at most height − 1.
        quads[i] = unsafe { *words.get_unchecked(index[i] as usize) };
    }
    Samples { quads, fx, fy }
}

impl<const N: usize> Samples<N> {
    /// The values less `mean`.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "all of several arrays are indexed")]
    pub fn values(&self, mean: f32) -> [f32; N] {
        let mut values = [0.0; N];
        for i in 0..N {
            let [a, b, c, d] = bytes(self.quads[i]);
            let top = self.fx[i].mul_add(b - a, a - mean);
            let bottom = self.fx[i].mul_add(d - c, c - mean);
            values[i] = self.fy[i].mul_add(bottom - top, top);
        }
        values
    }

    /// The change of the values for a pixel to the right and down.
    #[inline(always)]
    pub fn gradient(&self) -> ([f32; N], [f32; N]) {
        let (mut right, mut down) = ([0.0; N], [0.0; N]);
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

/// The larger value; `least` for NaN. One instruction, which [`f32::max`] is not.
#[inline(always)]
pub(crate) fn at_least(value: f32, least: f32) -> f32 {
    if value > least { value } else { least }
}

#[inline(always)]
fn at_most(value: f32, most: f32) -> f32 {
    if value < most { value } else { most }
}
