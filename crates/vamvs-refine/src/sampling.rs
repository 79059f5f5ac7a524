//! Bilinear samples of a source image at the texels of a window.

use crate::luminance::Quads;
use crate::transfer::Affine;
use crate::window::OFFSETS;

/// Texels that are sampled at once.
pub(crate) const LANES: usize = 16;

/// A value for each of them.
pub(crate) type Lanes = [f32; LANES];

/// What lies around some places in the image: four grey values each, and where between them the place is.
pub(crate) struct Samples {
    quads: [u32; LANES],
    fx: Lanes,
    fy: Lanes,
}

/// Samples of the source at the texels from `begin` on. Outside of the image its border goes on.
#[inline(always)]
pub(crate) fn sample(source: &Quads, warp: &Affine, begin: usize) -> Samples {
    let (words, size) = (source.words(), source.size());
    let (last_x, last_y) = ((size.width - 1) as f32, (size.height - 1) as f32);
    let (dx, dy) = (&OFFSETS.0[begin..begin + LANES], &OFFSETS.1[begin..begin + LANES]);
    let (mut fx, mut fy, mut index) = ([0.0; LANES], [0.0; LANES], [0_i32; LANES]);
    // From image coordinates to those in which pixel centres are whole numbers.
    let (u, v) = (warp.u - 0.5, warp.v - 0.5);
    for i in 0..LANES {
        let x = at_most(at_least(u + warp.ux * dx[i] + warp.uy * dy[i], 0.0), last_x);
        let y = at_most(at_least(v + warp.vx * dx[i] + warp.vy * dy[i], 0.0), last_y);
        // SAFETY: both lie between 0 and a size, and NaN has become 0.
        let (column, row): (i32, i32) = unsafe { (x.to_int_unchecked(), y.to_int_unchecked()) };
        fx[i] = x - column as f32;
        fy[i] = y - row as f32;
        index[i] = row * size.width as i32 + column;
    }
    let mut quads = [0_u32; LANES];
    for i in 0..LANES {
        // SAFETY: the column is at most width − 1 and the row at most height − 1.
        quads[i] = unsafe { *words.get_unchecked(index[i] as usize) };
    }
    Samples { quads, fx, fy }
}

impl Samples {
    /// The values less `mean`.
    #[inline(always)]
    pub fn values(&self, mean: f32) -> Lanes {
        std::array::from_fn(|i| {
            let [a, b, c, d] = bytes(self.quads[i]);
            let top = a + self.fx[i] * (b - a);
            let bottom = c + self.fx[i] * (d - c);
            top + self.fy[i] * (bottom - top) - mean
        })
    }

    /// The change of the values for a pixel to the right and down.
    #[inline(always)]
    pub fn gradient(&self) -> (Lanes, Lanes) {
        let right = std::array::from_fn(|i| {
            let [a, b, c, d] = bytes(self.quads[i]);
            (b - a) + self.fy[i] * ((d - c) - (b - a))
        });
        let down = std::array::from_fn(|i| {
            let [a, b, c, d] = bytes(self.quads[i]);
            (c - a) + self.fx[i] * ((d - b) - (c - a))
        });
        (right, down)
    }
}

#[inline(always)]
fn bytes(quad: u32) -> [f32; 4] {
    let byte = |shift: u32| ((quad >> shift) & 255) as i32 as f32;
    [byte(0), byte(8), byte(16), byte(24)]
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
