//! Convolutions to one channel, for which a tile of output channels would be empty but for one.

use std::ops::Range;

use rayon::prelude::*;

use crate::convolution::Kernel;
use crate::lanes::Lanes;
use crate::map::{Map, Row};

/// A convolution of stride 1 to one channel. Its products are summed over lanes of input channels.
#[derive(Clone, Debug)]
pub struct ToOne {
    /// Channels of the input.
    pub inputs: usize,
    /// Zeros before and after, along z, y and x.
    pub padding: [usize; 3],
    /// Sides of the kernel.
    pub sides: [usize; 3],
    /// (kz, ky, kx, inputs)
    pub weights: Vec<f32>,
    /// Added to the output.
    pub shift: f32,
}

/// Lanes of [`ToOne`].
const LANES: usize = 8;

impl ToOne {
    pub(crate) fn new(kernel: &Kernel, padding: [usize; 3]) -> Self {
        let Kernel { outputs, inputs, sides, .. } = *kernel;
        assert!(outputs == 1 && inputs % LANES == 0, "one channel from multiples of {LANES}");
        let [depth, height, width] = sides;
        let mut weights = Vec::with_capacity(kernel.weights.len());
        for (z, y) in (0..depth).flat_map(|z| (0..height).map(move |y| (z, y))) {
            weights.extend((0..width).flat_map(|x| (0..inputs).map(move |c| kernel.at(0, c, [z, y, x]))));
        }
        Self { inputs, padding, sides, weights, shift: kernel.shift.first().copied().unwrap_or(0.0) }
    }

    /// The output's rows of some planes, each of which is given to `finish`. There is nothing outside of the planes of the input,
    /// which are numbered from `first` on.
    pub fn run_planes(
        &self,
        input: &Map,
        first: usize,
        planes: Range<usize>,
        finish: impl Fn(Row, &mut [f32]) + Sync,
    ) -> Vec<f32> {
        assert_eq!(input.channels, self.inputs, "a convolution takes {} channels", self.inputs);
        let mut out = vec![0.0; planes.len() * input.height * input.width];
        out.par_chunks_mut(input.width).enumerate().for_each(|(at, values)| {
            let row = Row { z: planes.start + at / input.height, y: at % input.height };
            run_row_to_one(self, input, first, row, values);
            finish(row, values);
        });
        out
    }

    /// The whole output.
    pub fn run(&self, input: &Map, finish: impl Fn(Row, &mut [f32]) + Sync) -> Vec<f32> {
        self.run_planes(input, 0, 0..input.planes, finish)
    }
}

/// Pixels whose sums are in registers at once.
const TILE: usize = 8;

/// One row of the output, by the widest vectors of eight values that the processor has.
fn run_row_to_one(layer: &ToOne, input: &Map, first: usize, row: Row, out: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn avx2(layer: &ToOne, input: &Map, first: usize, row: Row, out: &mut [f32]) {
            row_to_one::<crate::lanes::x86::Avx<1>>(layer, input, first, row, out);
        }
        if crate::wide::widest() != crate::wide::Widest::Any {
            // SAFETY: the processor has what the function is compiled for.
            return unsafe { avx2(layer, input, first, row, out) };
        }
    }
    #[cfg(target_arch = "aarch64")]
    row_to_one::<crate::lanes::arm::Neon<2>>(layer, input, first, row, out);
    #[cfg(not(target_arch = "aarch64"))]
    row_to_one::<[f32; LANES]>(layer, input, first, row, out);
}

#[inline(always)]
fn row_to_one<V: Lanes>(layer: &ToOne, input: &Map, first: usize, row: Row, out: &mut [f32]) {
    let left = layer.padding[2];
    let last = (input.width + left + 1).saturating_sub(layer.sides[2]);
    let mut x = 0;
    while x < out.len() {
        if x >= left && x + TILE <= last {
            tile_to_one::<V, TILE>(layer, input, first, row, x, &mut out[x..x + TILE]);
            x += TILE;
        } else {
            tile_to_one::<V, 1>(layer, input, first, row, x, &mut out[x..x + 1]);
            x += 1;
        }
    }
}

/// The pixels from `x` on, whose neighbours all lie inside of the row unless it is one pixel.
#[inline(always)]
fn tile_to_one<V: Lanes, const P: usize>(
    layer: &ToOne,
    input: &Map,
    first: usize,
    row: Row,
    x: usize,
    out: &mut [f32],
) {
    let [depth, height, width] = layer.sides;
    let (channels, line) = (layer.inputs, width * layer.inputs);
    let begin = x as isize - layer.padding[2] as isize;
    let low = begin.max(0) as usize;
    let high = (begin + width as isize).min(input.width as isize) as usize;
    let left_out = (low as isize - begin) as usize * channels;
    let mut sums = [V::all(0.0); P];
    for (kz, ky) in (0..depth).flat_map(|z| (0..height).map(move |y| (z, y))) {
        let z = (row.z + kz) as isize - (layer.padding[0] + first) as isize;
        let y = (row.y + ky) as isize - layer.padding[1] as isize;
        if z < 0 || y < 0 || z >= input.planes as isize || y >= input.height as isize {
            continue;
        }
        let weights = &layer.weights[(kz * height + ky) * line + left_out..][..(high - low) * channels];
        let values = &input.row(Row { z: z as usize, y: y as usize })[low * channels..];
        let values = &values[..(high - low + P - 1) * channels];
        for (at, weights) in weights.as_chunks::<LANES>().0.iter().enumerate() {
            let weights = V::load(weights);
            for (p, sum) in sums.iter_mut().enumerate() {
                *sum = sum.plus(V::load(&values[p * channels + at * LANES..]), weights);
            }
        }
    }
    for (sum, out) in sums.into_iter().zip(out) {
        let mut lanes = [0.0; LANES];
        sum.store(&mut lanes);
        let [a, b, c, d, e, f, g, h] = lanes;
        *out = layer.shift + (((a + e) + (c + g)) + ((b + f) + (d + h)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convolution::Moves;
    use crate::convolution::tests::{defined, kernel, map, places};

    #[test]
    fn one_channel_is_summed_as_defined_also_plane_by_plane() {
        let kernel = kernel(1, 16, [3, 3, 3]);
        let moves = Moves { stride: 1, padding: [1, 1, 1], dilation: 1 };
        let input = map([5, 4, 9], 16);
        let layer = ToOne::new(&kernel, moves.padding);
        let whole = layer.run(&input, |_, _| ());
        for (place, found) in places(input.sides()).zip(&whole) {
            let expected = defined(&kernel, moves, &input, place, 0);
            assert!((f64::from(*found) - expected).abs() < 1e-4, "{place:?}: {found} is not {expected}");
        }
        let plane = 4 * 9 * 16;
        let part = Map { planes: 3, values: input.values[2 * plane..].to_vec(), ..input };
        assert_eq!(layer.run_planes(&part, 2, 3..5, |_, _| ()), whole[3 * 4 * 9..]);
    }
}
