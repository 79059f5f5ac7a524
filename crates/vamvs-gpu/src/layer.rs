//! Convolutions.

use vamvs_corr::layers::{self, Pass};
use wgpu::Buffer;

use crate::kernels::{NARROW, Tile, WIDE};
use crate::map::Map;
use crate::recorder::{Recorder, Words};
use crate::{Gpu, GpuError};

/// What follows a convolution, in this order.
#[derive(Clone, Copy, Default)]
pub struct Finish<'a> {
    /// Negative values become zero.
    pub relu: bool,
    /// A map of the output's sides is added.
    pub beside: Option<&'a Map>,
    /// An image of the output's height and width is multiplied.
    pub gate: Option<&'a Map>,
    /// The values go through a sigmoid, times this.
    pub sigmoid: Option<f32>,
}

impl<'a> Finish<'a> {
    /// A ReLU alone.
    pub const RELU: Self = Self { relu: true, beside: None, gate: None, sigmoid: None };

    /// A ReLU, then factors.
    pub fn gated(gate: &'a Map) -> Self {
        Self { gate: Some(gate), ..Self::RELU }
    }

    fn bits(&self) -> usize {
        usize::from(self.relu)
            | usize::from(self.beside.is_some()) << 1
            | usize::from(self.gate.is_some()) << 2
            | usize::from(self.sigmoid.is_some()) << 3
    }
}

/// A convolution, its weights in the device's memory.
pub struct Convolution {
    layer: layers::Convolution,
    passes: Vec<Taps>,
}

/// The taps of one pass and their weights.
struct Taps {
    weights: Buffer,
    taps: Buffer,
    count: usize,
    /// Multiplications for an output pixel.
    products: usize,
    /// Vectors of weights of a block of output channels.
    panel: usize,
}

impl Convolution {
    pub fn new(gpu: &Gpu, layer: &layers::Convolution) -> Result<Self, GpuError> {
        let passes = layer.passes.iter().map(|pass| Taps::new(gpu, layer, pass)).collect::<Result<_, _>>()?;
        let mut layer = layer.clone();
        layer.passes = Vec::new();
        Ok(Self { layer, passes })
    }

    fn tile(&self) -> Tile {
        if self.layer.lanes == 4 * NARROW.vectors { NARROW } else { WIDE }
    }

    /// The output, with what follows it.
    pub fn run(&self, recorder: &mut Recorder<'_>, input: &Map, finish: Finish<'_>) -> Result<Map, GpuError> {
        let Self { layer, passes } = self;
        let kernels = &recorder.gpu.kernels;
        let tile = self.tile();
        let kernel = if tile.vectors == NARROW.vectors { &kernels.narrow } else { &kernels.wide };
        let output = Map::new(recorder.gpu, layer.sides(input.sides), layer.outputs.div_ceil(4))?;
        let blocks = layer.shift.len() / layer.lanes;
        for (number, pass) in passes.iter().enumerate() {
            // The passes of a transposed convolution are those of the parities of z, y and x.
            let (first, step) = match layer.doubles {
                true => ([number / 4, number / 2 % 2, number % 2], 2),
                false => ([0; 3], 1),
            };
            let count = output.sides.map(|side| side / step);
            let words = Words::new()
                .counts(&input.sides)
                .count(input.vectors)
                .counts(&output.sides)
                .count(output.vectors)
                .counts(&first)
                .count(step)
                .counts(&count)
                .count(layer.stride)
                .counts(&[pass.count, blocks, pass.panel, finish.bits()])
                .number(finish.sigmoid.unwrap_or(1.0));
            let buffers = [
                &input.buffer,
                &pass.weights,
                &pass.taps,
                &finish.beside.unwrap_or(input).buffer,
                &finish.gate.unwrap_or(input).buffer,
                &output.buffer,
            ];
            let [planes, height, width] = count;
            recorder.run(kernel, words, &buffers, [width.div_ceil(tile.pixels), height, planes * blocks]);
            recorder.count(2 * (planes * height * width * pass.products) as u64);
        }
        Ok(output)
    }
}

impl Taps {
    /// Weights in whole vectors of input channels, then the shifts.
    fn new(gpu: &Gpu, layer: &layers::Convolution, pass: &Pass) -> Result<Self, GpuError> {
        let padding = vec![0.0; (layer.inputs.next_multiple_of(4) - layer.inputs) * layer.lanes];
        let mut weights = Vec::new();
        for pixel in pass.panels.chunks_exact(layer.inputs * layer.lanes) {
            weights.extend_from_slice(pixel);
            weights.extend_from_slice(&padding);
        }
        let panel = weights.len() / 4 / (layer.shift.len() / layer.lanes);
        weights.extend_from_slice(&layer.shift);
        let taps: Vec<[i32; 4]> = pass
            .taps
            .iter()
            .map(|tap| [tap.z as i32, tap.y as i32, tap.x as i32, tap.pixels as i32])
            .collect();
        let products = pass.taps.iter().map(|tap| tap.pixels).sum::<usize>() * layer.inputs * layer.outputs;
        Ok(Self {
            weights: gpu.upload(&weights)?,
            taps: gpu.upload(&taps)?,
            count: taps.len(),
            products,
            panel,
        })
    }
}

/// A convolution to one channel.
pub struct ToOne {
    layer: layers::ToOne,
    weights: Buffer,
    sigmoid: bool,
}

/// Where the output of a [`ToOne`] goes.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    pub buffer: &'a Buffer,
    /// Its first value.
    pub first: usize,
    /// Planes, height, width; those of the input, or less.
    pub sides: [usize; 3],
}

impl ToOne {
    pub fn new(gpu: &Gpu, layer: &layers::ToOne, sigmoid: bool) -> Result<Self, GpuError> {
        let weights = gpu.upload(&layer.weights)?;
        let layer = layers::ToOne { weights: Vec::new(), ..layer.clone() };
        Ok(Self { layer, weights, sigmoid })
    }

    /// Writes the output to its place.
    pub fn run(&self, recorder: &mut Recorder<'_>, input: &Map, place: Place<'_>) {
        let words = Words::new()
            .counts(&input.sides)
            .count(input.vectors)
            .counts(&place.sides)
            .count(place.first)
            .counts(&self.layer.sides)
            .flag(self.sigmoid)
            .counts(&self.layer.padding)
            .number(self.layer.shift);
        let [planes, height, width] = place.sides;
        let buffers = [&input.buffer, &self.weights, place.buffer];
        recorder.run(&recorder.gpu.kernels.to_one, words, &buffers, [width, height, planes]);
    }
}

/// The part of a volume of these sides from the pixel (x, y) on; beyond its end the last values are repeated.
pub fn part(
    recorder: &mut Recorder<'_>,
    map: &Map,
    (x, y): (usize, usize),
    sides: [usize; 3],
) -> Result<Map, GpuError> {
    let output = Map::new(recorder.gpu, sides, map.vectors)?;
    let words = Words::new().counts(&map.sides).count(map.vectors).counts(&sides).counts(&[x, y]);
    let [planes, height, width] = sides;
    recorder.run(&recorder.gpu.kernels.part, words, &[&map.buffer, &output.buffer], [width, height, planes]);
    Ok(output)
}

/// The map with height and width, and of a volume its planes, extended to multiples of `block` by repeating the last values.
pub fn padded(recorder: &mut Recorder<'_>, map: &Map, block: [usize; 3]) -> Result<Option<Map>, GpuError> {
    let sides: [usize; 3] = std::array::from_fn(|axis| map.sides[axis].next_multiple_of(block[axis]));
    (sides != map.sides).then(|| part(recorder, map, (0, 0), sides)).transpose()
}

/// An image at twice its size, cut to that of `others`, plus these, and a ReLU if asked for.
pub fn enlarged_onto(
    recorder: &mut Recorder<'_>,
    map: &Map,
    others: &Map,
    relu: bool,
) -> Result<Map, GpuError> {
    let output = Map::new(recorder.gpu, others.sides, map.vectors)?;
    let finish = 1 | usize::from(relu) << 1;
    enlarge(recorder, map, [&map.buffer, &others.buffer, &output.buffer], (others.sides, finish));
    Ok(output)
}

/// An image at twice its size, cut to these sides.
pub fn enlarged(recorder: &mut Recorder<'_>, map: &Map, sides: [usize; 3]) -> Result<Map, GpuError> {
    let output = Map::new(recorder.gpu, sides, map.vectors)?;
    enlarge(recorder, map, [&map.buffer, &map.buffer, &output.buffer], (sides, 0));
    Ok(output)
}

fn enlarge(
    recorder: &mut Recorder<'_>,
    map: &Map,
    buffers: [&Buffer; 3],
    (sides, finish): ([usize; 3], usize),
) {
    let words = Words::new().counts(&map.sides).count(map.vectors).counts(&sides).count(finish);
    let [planes, height, width] = sides;
    recorder.run(&recorder.gpu.kernels.enlarge, words, &buffers, [width, height, planes]);
}

/// Images with one channel, [number, height, width], at twice their size, cut to that of `sides`.
pub fn enlarged_ones(
    recorder: &mut Recorder<'_>,
    buffer: &Buffer,
    from: [usize; 3],
    sides: [usize; 3],
) -> Result<Buffer, GpuError> {
    let output = recorder.gpu.buffer(4 * sides.iter().product::<usize>())?;
    let words = Words::new().counts(&from).count(1).counts(&sides).count(0);
    let [number, height, width] = sides;
    let buffers = [buffer, buffer, &output];
    recorder.run(&recorder.gpu.kernels.enlarge_ones, words, &buffers, [width, height, number]);
    Ok(output)
}
