//! Convolutions to one channel, for which a tile of output channels would be empty but for one.

use std::ops::Range;

use rayon::prelude::*;

use crate::convolution::Kernel;
use crate::map::{Map, Row};
use crate::wide::widened;

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

#[inline(always)]
fn row_to_one(layer: &ToOne, input: &Map, first: usize, row: Row, out: &mut [f32]) {
    let [depth, height, width] = layer.sides;
    let line = width * layer.inputs;
    for (x, out) in out.iter_mut().enumerate() {
        let mut sums = [0.0_f32; LANES];
        for (kz, ky) in (0..depth).flat_map(|z| (0..height).map(move |y| (z, y))) {
            let z = (row.z + kz) as isize - (layer.padding[0] + first) as isize;
            let y = (row.y + ky) as isize - layer.padding[1] as isize;
            if z < 0 || y < 0 || z >= input.planes as isize || y >= input.height as isize {
                continue;
            }
            let begin = x as isize - layer.padding[2] as isize;
            let low = begin.max(0);
            let high = (begin + width as isize).min(input.width as isize);
            let weights = &layer.weights[(kz * height + ky) * line..][..line];
            let weights =
                &weights[(low - begin) as usize * layer.inputs..(high - begin) as usize * layer.inputs];
            let values = &input.row(Row { z: z as usize, y: y as usize })[low as usize * layer.inputs..];
            let (weights, values) = (weights.as_chunks::<LANES>().0, values.as_chunks::<LANES>().0);
            for (weights, values) in weights.iter().zip(values) {
                for lane in 0..LANES {
                    sums[lane] = values[lane].mul_add(weights[lane], sums[lane]);
                }
            }
        }
        let [a, b, c, d, e, f, g, h] = sums;
        *out = layer.shift + (((a + e) + (c + g)) + ((b + f) + (d + h)));
    }
}

widened!(row_to_one => run_row_to_one(layer: &ToOne, input: &Map, first: usize, row: Row, out: &mut [f32]));

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
