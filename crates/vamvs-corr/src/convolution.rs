//! Convolutions of images and volumes, direct: no matrix of patches is ever made.
//!
//! With channels last, the inputs of one output along a row of the kernel are one run of memory, and those of the next output
//! begin `stride` pixels later. So a tile of a few pixels × 8 or 16 output channels stays in registers while the runs of all rows
//! of the kernel are gone through: one broadcast input times one vector of weights at a time. A transposed convolution of stride 2
//! is eight convolutions, one for each parity of the output's position, with one or two taps along each axis.

use std::ops::Range;

use crate::lanes::Lanes;
use crate::map::{Map, Row};
#[cfg(target_arch = "x86_64")]
use crate::wide::{Widest, widest};

/// The weights of a convolution as PyTorch has them: (outputs, inputs, kz, ky, kx), of a transposed one
/// (inputs, outputs, kz, ky, kx).
#[derive(Clone, Debug)]
pub struct Kernel {
    pub outputs: usize,
    pub inputs: usize,
    /// Sides kz, ky, kx.
    pub sides: [usize; 3],
    pub weights: Vec<f32>,
    /// Added to each output.
    pub shift: Vec<f32>,
}

/// How a kernel moves over its input.
#[derive(Clone, Copy, Debug)]
pub struct Moves {
    pub stride: usize,
    /// Zeros before and after, along z, y and x.
    pub padding: [usize; 3],
    pub dilation: usize,
}

impl Kernel {
    /// The weight of one output, one input and one place of the kernel.
    pub fn at(&self, output: usize, input: usize, [z, y, x]: [usize; 3]) -> f32 {
        let [_, height, width] = self.sides;
        self.weights[((output * self.inputs + input) * self.sides[0] + z) * height * width + y * width + x]
    }

    /// The kernel of a transposed convolution with its first two axes in the order of others.
    fn transposed(&self) -> Self {
        let places = self.sides.iter().product::<usize>();
        let mut weights = vec![0.0; self.weights.len()];
        for (at, values) in self.weights.chunks_exact(places).enumerate() {
            let (input, output) = (at / self.outputs, at % self.outputs);
            weights[(output * self.inputs + input) * places..][..places].copy_from_slice(values);
        }
        Self { weights, ..self.clone() }
    }
}

/// A run of inputs along a row of the kernel: where it begins, relative to the place of the output, and its pixels.
#[derive(Clone, Copy, Debug)]
pub struct Tap {
    /// Planes from the place of the output.
    pub z: isize,
    /// Rows from there.
    pub y: isize,
    /// Pixels from there to the first.
    pub x: isize,
    /// Pixels of the run.
    pub pixels: usize,
}

/// Taps with their weights.
#[derive(Clone, Debug)]
pub struct Pass {
    /// The runs.
    pub taps: Vec<Tap>,
    /// For each block of output channels and each tap, (pixels · inputs, lanes).
    pub panels: Vec<f32>,
}

impl Pass {
    /// The taps at these places of the kernel, each with the offset of its input; places along x that follow each other in
    /// both become one run.
    fn new(kernel: &Kernel, lanes: usize, places: &[Vec<(usize, isize)>; 3]) -> Self {
        let mut runs: Vec<Vec<(usize, isize)>> = Vec::new();
        for &(place, offset) in &places[2] {
            match runs.last_mut() {
                Some(run) if run[run.len() - 1].1 + 1 == offset => run.push((place, offset)),
                _ => runs.push(vec![(place, offset)]),
            }
        }
        let rows = || places[0].iter().flat_map(|z| places[1].iter().map(move |y| (*z, *y)));
        let (mut taps, mut panels) = (Vec::new(), Vec::new());
        for ((_, z), (_, y)) in rows() {
            taps.extend(runs.iter().map(|run| Tap { z, y, x: run[0].1, pixels: run.len() }));
        }
        for block in (0..kernel.outputs).step_by(lanes) {
            for ((kz, _), (ky, _)) in rows() {
                for &(kx, _) in runs.iter().flatten() {
                    for input in 0..kernel.inputs {
                        panels.extend((block..block + lanes).map(|output| {
                            if output < kernel.outputs { kernel.at(output, input, [kz, ky, kx]) } else { 0.0 }
                        }));
                    }
                }
            }
        }
        Self { taps, panels }
    }
}

/// A convolution, or a transposed one of stride 2, ready to run.
#[derive(Clone, Debug)]
pub struct Convolution {
    /// Channels of the input.
    pub inputs: usize,
    /// Channels of the output.
    pub outputs: usize,
    /// Output channels in a register.
    pub lanes: usize,
    /// Pixels of the input from one output to the next.
    pub stride: usize,
    /// What the sides of the output are less than those of the input, before the stride.
    narrower: [isize; 3],
    /// One, or for a transposed convolution one for each parity of the output's z, y and x.
    pub passes: Vec<Pass>,
    /// Whether it is a transposed one.
    pub doubles: bool,
    /// Added to each output; whole registers.
    pub shift: Vec<f32>,
}

impl Convolution {
    pub(crate) fn new(kernel: &Kernel, moves: Moves) -> Self {
        let Moves { stride, padding, dilation } = moves;
        let places: [Vec<(usize, isize)>; 3] = std::array::from_fn(|axis| {
            let offset = |place: usize| (place * dilation) as isize - padding[axis] as isize;
            (0..kernel.sides[axis]).map(|place| (place, offset(place))).collect()
        });
        let narrower = std::array::from_fn(|axis| {
            (dilation * (kernel.sides[axis] - 1)) as isize - 2 * padding[axis] as isize
        });
        let lanes = lanes_for(kernel.outputs);
        let passes = vec![Pass::new(kernel, lanes, &places)];
        Self::of(kernel, (lanes, stride, narrower), passes)
    }

    /// A transposed convolution with a kernel of 3×3×3 that doubles each side (stride 2, padding 1, output padding 1). Along an
    /// axis, output 2k is w₁ x[k], and output 2k + 1 is w₂ x[k] + w₀ x[k + 1].
    pub(crate) fn doubling(kernel: &Kernel) -> Self {
        assert_eq!(kernel.sides, [3; 3], "a kernel that doubles has 3×3×3 places");
        let kernel = kernel.transposed();
        let lanes = lanes_for(kernel.outputs);
        let of_parity = |parity: usize| if parity == 0 { vec![(1, 0)] } else { vec![(2, 0), (0, 1)] };
        let places = |parity: usize| [parity / 4, parity / 2 % 2, parity % 2].map(of_parity);
        let passes = (0..8).map(|parity| Pass::new(&kernel, lanes, &places(parity))).collect();
        Self { doubles: true, ..Self::of(&kernel, (lanes, 1, [0; 3]), passes) }
    }

    fn of(kernel: &Kernel, (lanes, stride, narrower): (usize, usize, [isize; 3]), passes: Vec<Pass>) -> Self {
        let mut shift = kernel.shift.clone();
        shift.resize(kernel.outputs.next_multiple_of(lanes), 0.0);
        let (inputs, outputs) = (kernel.inputs, kernel.outputs);
        Self { inputs, outputs, lanes, stride, narrower, passes, doubles: false, shift }
    }

    /// The sides of the output, [planes, height, width], for an input of these sides.
    #[must_use]
    pub fn sides(&self, input: [usize; 3]) -> [usize; 3] {
        if self.doubles {
            return input.map(|side| 2 * side);
        }
        std::array::from_fn(|axis| {
            // A plane of an image stays one.
            let stride = if input[axis] == 1 && self.narrower[axis] == 0 { 1 } else { self.stride };
            (input[axis] as isize - self.narrower[axis] - 1) as usize / stride + 1
        })
    }

    /// The floating-point operations for an input of these sides, a product and a sum counted as two; borders as if all taps lay inside.
    #[must_use]
    pub fn operations(&self, input: [usize; 3]) -> u64 {
        let taps: usize = self.passes.iter().flat_map(|pass| &pass.taps).map(|tap| tap.pixels).sum();
        let outputs = self.sides(input).iter().product::<usize>() / self.passes.len();
        2 * (outputs * taps * self.inputs * self.outputs) as u64
    }

    /// The output; `finish` is called for each of its rows while it is in the cache.
    pub fn run(&self, input: &Map, finish: impl Fn(Row, &mut [f32]) + Sync) -> Map {
        let [planes, ..] = self.sides(input.sides());
        self.run_planes(input, 0..planes, finish)
    }

    /// As [`Convolution::run`], of some planes of the output only. Rows that `finish` gets are numbered as in the whole output.
    pub fn run_planes(
        &self,
        input: &Map,
        planes: Range<usize>,
        finish: impl Fn(Row, &mut [f32]) + Sync,
    ) -> Map {
        assert_eq!(input.channels, self.inputs, "a convolution takes {} channels", self.inputs);
        let [_, height, width] = self.sides(input.sides());
        Map::by_rows_with(
            [planes.len(), height, width],
            self.outputs,
            Vec::new,
            |scratch, Row { z, y }, values| {
                let row = Row { z: planes.start + z, y };
                run_row(self, input, row, values, scratch);
                finish(row, values);
            },
        )
    }
}

fn lanes_for(outputs: usize) -> usize {
    if outputs <= 8 { 8 } else { 16 }
}

/// One row of the output, by the widest vectors that the processor has.
fn run_row(layer: &Convolution, input: &Map, row: Row, out: &mut [f32], scratch: &mut Vec<f32>) {
    #[cfg(target_arch = "x86_64")]
    {
        use crate::lanes::x86::{Avx, Avx512};

        #[target_feature(enable = "avx2,fma")]
        fn avx2(layer: &Convolution, input: &Map, row: Row, out: &mut [f32], scratch: &mut Vec<f32>) {
            match layer.lanes {
                8 => row_of::<12, Avx<1>>(layer, input, row, out, scratch),
                _ => row_of::<6, Avx<2>>(layer, input, row, out, scratch),
            }
        }
        #[target_feature(enable = "avx512f,avx512vl,avx2,fma")]
        fn avx512(layer: &Convolution, input: &Map, row: Row, out: &mut [f32], scratch: &mut Vec<f32>) {
            match layer.lanes {
                8 => row_of::<12, Avx<1>>(layer, input, row, out, scratch),
                _ => row_of::<12, Avx512>(layer, input, row, out, scratch),
            }
        }
        match widest() {
            // SAFETY: the processor has what the functions are compiled for.
            Widest::Avx512 => return unsafe { avx512(layer, input, row, out, scratch) },
            // SAFETY: as above.
            Widest::Avx2 => return unsafe { avx2(layer, input, row, out, scratch) },
            Widest::Any => {}
        }
    }
    #[cfg(target_arch = "aarch64")]
    {
        use crate::lanes::arm::Neon;

        match layer.lanes {
            8 => row_of::<8, Neon<2>>(layer, input, row, out, scratch),
            _ => row_of::<6, Neon<4>>(layer, input, row, out, scratch),
        }
    }
    #[cfg(not(target_arch = "aarch64"))]
    match layer.lanes {
        8 => row_of::<6, [f32; 8]>(layer, input, row, out, scratch),
        _ => row_of::<6, [f32; 16]>(layer, input, row, out, scratch),
    }
}

#[inline(always)]
fn row_of<const P: usize, V: Lanes>(
    layer: &Convolution,
    input: &Map,
    row: Row,
    out: &mut [f32],
    scratch: &mut Vec<f32>,
) {
    if !layer.doubles {
        let place = [row.z * layer.stride, row.y * layer.stride].map(|place| place as isize);
        return pass_of::<P, V>(layer, &layer.passes[0], input, place, (0, 1), out, scratch);
    }
    let place = [row.z / 2, row.y / 2].map(|place| place as isize);
    for parity in 0..2 {
        let pass = &layer.passes[row.z % 2 * 4 + row.y % 2 * 2 + parity];
        pass_of::<P, V>(layer, pass, input, place, (parity, 2), out, scratch);
    }
}

/// Every `step`-th pixel of a row, from `first` on, by one pass over the input around (z, y).
#[inline(always)]
fn pass_of<const P: usize, V: Lanes>(
    layer: &Convolution,
    pass: &Pass,
    input: &Map,
    [z, y]: [isize; 2],
    (first, step): (usize, usize),
    out: &mut [f32],
    scratch: &mut Vec<f32>,
) {
    let (channels, outputs) = (layer.inputs, layer.outputs);
    let columns = (out.len() / outputs).saturating_sub(first).div_ceil(step);
    let blocks = layer.shift.len() / V::COUNT;
    for block in 0..blocks {
        let shift = V::load(&layer.shift[block * V::COUNT..]);
        let lanes = V::COUNT.min(outputs - block * V::COUNT);
        for x in (0..columns).step_by(P) {
            let mut sums = [shift; P];
            let mut panel = &pass.panels[block * pass.panels.len() / blocks..];
            for tap in &pass.taps {
                let (weights, rest) = panel.split_at(tap.pixels * channels * V::COUNT);
                panel = rest;
                let (z, y) = (z + tap.z, y + tap.y);
                if z < 0 || y < 0 || z >= input.planes as isize || y >= input.height as isize {
                    continue;
                }
                let line = input.row(Row { z: z as usize, y: y as usize });
                let begin = (x * layer.stride) as isize + tap.x;
                let pixels = (P - 1) * layer.stride + tap.pixels;
                let is_inside = begin >= 0 && begin as usize + pixels <= input.width;
                let run = if is_inside {
                    &line[begin as usize * channels..][..pixels * channels]
                } else {
                    copy_run(line, channels, begin, pixels, scratch);
                    &scratch[..]
                };
                sums = accumulate(run, (layer.stride * channels, tap.pixels * channels), weights, sums);
            }
            for (p, sum) in sums.into_iter().enumerate().take(columns - x) {
                let to = &mut out[(first + (x + p) * step) * outputs + block * V::COUNT..];
                if lanes == V::COUNT {
                    sum.store(to);
                } else {
                    let mut whole = [0.0; MOST_LANES];
                    sum.store(&mut whole);
                    to[..lanes].copy_from_slice(&whole[..lanes]);
                }
            }
        }
    }
}

/// The most lanes of a vector.
const MOST_LANES: usize = 16;

/// Copies `pixels` pixels of a line from `begin` on into `scratch`, with zeros where it has none.
fn copy_run(line: &[f32], channels: usize, begin: isize, pixels: usize, scratch: &mut Vec<f32>) {
    scratch.clear();
    scratch.resize(pixels * channels, 0.0);
    let width = (line.len() / channels) as isize;
    let (low, high) = (begin.clamp(0, width), (begin + pixels as isize).clamp(0, width));
    let to = (low - begin) as usize * channels;
    let count = (high - low) as usize * channels;
    scratch[to..to + count].copy_from_slice(&line[low as usize * channels..][..count]);
}

/// Each pixel's sums plus its run of `length` values, which begins `step` values after that of the pixel before, times the weights.
#[inline(always)]
fn accumulate<const P: usize, V: Lanes>(
    run: &[f32],
    (step, length): (usize, usize),
    weights: &[f32],
    mut sums: [V; P],
) -> [V; P] {
    assert!(
        run.len() >= (P - 1) * step + length && weights.len() >= length * V::COUNT,
        "a run of each pixel"
    );
    for k in 0..length {
        let of_lanes = V::load(&weights[k * V::COUNT..]);
        for (p, sum) in sums.iter_mut().enumerate() {
            // SAFETY: p · step + k is below (P − 1) · step + length, which the run is at least as long as.
            let value = unsafe { *run.get_unchecked(p * step + k) };
            *sum = sum.plus(of_lanes, V::all(value));
        }
    }
    sums
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Numbers without pattern, from -1 to 1.
    pub fn numbers(count: usize, seed: u32) -> Vec<f32> {
        let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12345);
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        (0..count).map(|_| next()).collect()
    }

    pub fn kernel(outputs: usize, inputs: usize, sides: [usize; 3]) -> Kernel {
        let places: usize = sides.iter().product();
        let weights = numbers(outputs * inputs * places, 7);
        Kernel { outputs, inputs, sides, weights, shift: numbers(outputs, 9) }
    }

    pub fn map(sides: [usize; 3], channels: usize) -> Map {
        let count = sides.iter().product::<usize>() * channels;
        Map { values: numbers(count, 3), ..Map::new(sides, channels) }
    }

    /// A value of a map, or zero outside of it.
    pub fn value(map: &Map, place: [isize; 3], channel: usize) -> f64 {
        let inside = place.iter().zip(map.sides()).all(|(&at, side)| at >= 0 && at < side as isize);
        let [z, y, x] = place.map(|at| at as usize);
        if inside { f64::from(map.row(Row { z, y })[x * map.channels + channel]) } else { 0.0 }
    }

    pub fn places(sides: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
        let [depth, height, width] = sides;
        (0..depth * height * width).map(move |at| [at / width / height, at / width % height, at % width])
    }

    /// By the definition, one output at a time.
    pub fn defined(kernel: &Kernel, moves: Moves, input: &Map, place: [usize; 3], output: usize) -> f64 {
        let mut sum = f64::from(kernel.shift[output]);
        for at in places(kernel.sides) {
            let from: [isize; 3] = std::array::from_fn(|axis| {
                let stride = if input.sides()[axis] == 1 { 1 } else { moves.stride };
                (place[axis] * stride + at[axis] * moves.dilation) as isize - moves.padding[axis] as isize
            });
            for channel in 0..kernel.inputs {
                sum += f64::from(kernel.at(output, channel, at)) * value(input, from, channel);
            }
        }
        sum
    }

    #[test]
    fn convolutions_are_what_they_are_defined_to_be() {
        let moves = |stride, padding, dilation| Moves { stride, padding, dilation };
        let cases = [
            (kernel(16, 3, [1, 4, 4]), moves(2, [0, 1, 1], 1), [1, 10, 38]),
            (kernel(32, 8, [3, 3, 3]), moves(1, [1, 1, 1], 1), [4, 5, 29]),
            (kernel(16, 8, [3, 3, 3]), moves(2, [1, 1, 1], 1), [4, 6, 26]),
            (kernel(16, 16, [1, 3, 3]), moves(1, [0, 2, 2], 2), [1, 7, 17]),
            (kernel(9, 32, [1, 1, 1]), moves(1, [0, 0, 0], 1), [1, 3, 13]),
            (kernel(8, 8, [1, 1, 1]), moves(1, [0, 0, 0], 1), [3, 2, 5]),
            (kernel(48, 32, [1, 3, 3]), moves(1, [0, 1, 1], 1), [1, 4, 3]),
        ];
        for (kernel, moves, sides) in cases {
            let input = map(sides, kernel.inputs);
            let out = Convolution::new(&kernel, moves).run(&input, |_, _| ());
            assert_eq!(out.channels, kernel.outputs);
            for place in places(out.sides()) {
                for output in 0..kernel.outputs {
                    let expected = defined(&kernel, moves, &input, place, output);
                    let found = value(&out, place.map(|at| at as isize), output);
                    assert!(
                        (found - expected).abs() < 1e-4,
                        "{sides:?} {place:?}: {found} is not {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_doubling_convolution_spreads_each_input_over_the_kernel() {
        for outputs in [8, 32] {
            let of_input = Kernel { inputs: 16, outputs, ..kernel(16, outputs, [3; 3]) };
            let kernel = Kernel { shift: numbers(outputs, 5), ..of_input };
            let input = map([2, 3, 15], 16);
            let out = Convolution::doubling(&kernel).run(&input, |_, _| ());
            assert_eq!(out.sides(), [4, 6, 30]);
            let mut expected = vec![0.0_f64; out.values.len()];
            for (place, at) in places(input.sides()).flat_map(|p| places([3; 3]).map(move |at| (p, at))) {
                let to: [isize; 3] = std::array::from_fn(|axis| (2 * place[axis] + at[axis]) as isize - 1);
                if to.iter().zip(out.sides()).any(|(&to, side)| to < 0 || to >= side as isize) {
                    continue;
                }
                let [z, y, x] = to.map(|to| to as usize);
                for (channel, output) in (0..16).flat_map(|c| (0..outputs).map(move |o| (c, o))) {
                    let weight =
                        kernel.weights[(channel * outputs + output) * 27 + at[0] * 9 + at[1] * 3 + at[2]];
                    let product = f64::from(weight) * value(&input, place.map(|at| at as isize), channel);
                    expected[((z * 6 + y) * 30 + x) * outputs + output] += product;
                }
            }
            for (at, (found, expected)) in out.values.iter().zip(&expected).enumerate() {
                let expected = expected + f64::from(kernel.shift[at % outputs]);
                assert!((f64::from(*found) - expected).abs() < 1e-4, "{at}: {found} is not {expected}");
            }
        }
    }

    #[test]
    fn some_planes_are_those_of_the_whole() {
        let kernel = Kernel { inputs: 16, outputs: 8, ..kernel(16, 8, [3; 3]) };
        let kernel = Kernel { shift: numbers(8, 2), ..kernel };
        let (layer, input) = (Convolution::doubling(&kernel), map([4, 3, 5], 16));
        let whole = layer.run(&input, |row, values| values.iter_mut().for_each(|v| *v += row.z as f32));
        let part =
            layer.run_planes(&input, 3..6, |row, values| values.iter_mut().for_each(|v| *v += row.z as f32));
        assert_eq!(part.values, whole.values[3 * 6 * 10 * 8..6 * 6 * 10 * 8]);
    }

    /// A hash of the outputs' bits, which no processor may change.
    #[test]
    fn bits_are_those_of_every_processor() {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut add = |map: &Map| {
            for byte in map.values.iter().flat_map(|value| value.to_bits().to_le_bytes()) {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        };
        let moves = |stride| Moves { stride, padding: [1; 3], dilation: 1 };
        for (outputs, stride) in [(8, 1), (16, 2), (32, 1)] {
            let kernel = kernel(outputs, 16, [3; 3]);
            add(&Convolution::new(&kernel, moves(stride)).run(&map([4, 5, 29], 16), |_, _| ()));
        }
        assert_eq!(hash, 0x0df7_5932_67c1_4813, "{hash:#x}");
    }
}
