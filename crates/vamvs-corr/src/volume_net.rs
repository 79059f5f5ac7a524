//! Regularisation of a volume of correlations: a 3D U-Net most of which works at half the resolution and below, whose
//! channels are weighed by what the reference photograph shows.

use crate::CorrError;
use crate::convolution::Convolution;
use crate::map::{Map, Row};
use crate::pyramid::{CHANNELS, as_is, positive};
use crate::to_one::ToOne;
use crate::weights::{Shape, Weights};
use crate::wide::{add, multiply, relu, sigmoids};

/// Channels of the volume at full resolution, 1/2, 1/4, 1/8.
const WIDTHS: [usize; 4] = [8, 16, 32, 64];

/// Channels of the gates' own layers at these resolutions.
const GATE_WIDTHS: [usize; 4] = [16, 32, 48, 64];

/// Planes that go through the layers at full resolution at once.
const SLAB: usize = 16;

/// The sides of a volume are padded to multiples of this.
pub const BLOCK: usize = 8;

/// Factors for the channels of the volume, from the features of the reference view (guided cost-volume excitation,
/// Bangunharcana et al., IROS 2021).
#[derive(Debug)]
pub struct Gates {
    /// Of the features at full resolution, then from each level to the next, half as large; the first and the second see the features.
    pub sides: [Convolution; 4],
    /// The last one of 1/8.
    pub last8: Convolution,
    /// From 1/2, 1/4 and 1/8 to the level above.
    pub ups: [Convolution; 3],
    /// To the factors, from full resolution, 1/2, 1/4, 1/8, and once more 1/2 and 1/4.
    pub heads: Vec<Convolution>,
}

/// The U-Net of a volume.
#[derive(Debug)]
pub struct VolumeNet {
    /// The factors of its channels.
    pub gates: Gates,
    /// Beside all others, at full resolution.
    pub same: Convolution,
    /// To 1/2.
    pub scale2: Convolution,
    /// At 1/2.
    pub scale2_same: Convolution,
    /// To 1/4.
    pub scale4: Convolution,
    /// At 1/4.
    pub scale4_same: Convolution,
    /// To 1/8.
    pub scale8: Convolution,
    /// At 1/8.
    pub scale8_same: Convolution,
    /// Beside the identity, at 1/4.
    pub deep4: [Convolution; 2],
    /// Beside the identity, twice, at 1/8.
    pub deep8: [[Convolution; 2]; 2],
    /// To 1/4.
    pub up4: Convolution,
    /// To 1/2.
    pub up2: Convolution,
    /// To full resolution.
    pub up1: Convolution,
    /// To the costs.
    pub last: ToOne,
}

impl Gates {
    fn new(weights: &Weights, name: &str) -> Result<Self, CorrError> {
        let [a, b, c, d] = GATE_WIDTHS;
        let layer = |part: &str, inputs: usize, outputs: usize, side: usize| {
            weights.layer(
                &format!("{name}.{part}"),
                Shape::image(inputs, outputs, side),
                if side == 4 { 2 } else { 1 },
            )
        };
        let one = |part: &str, inputs: usize, outputs: usize| {
            weights.bare(&format!("{name}.{part}"), Shape::image(inputs, outputs, 1), true)
        };
        let [v1, v2, v4, v8] = WIDTHS;
        let heads = [(a, v1), (b, v2), (c, v4), (d, v8), (b, v2), (c, v4)];
        let head = |(at, (inputs, outputs)): (usize, &(usize, usize))| {
            one(&format!("heads.{at}"), *inputs, *outputs)
        };
        Ok(Self {
            sides: [
                layer("side1", CHANNELS, a, 3)?,
                layer("side2", CHANNELS, b, 4)?,
                layer("side4", b, c, 4)?,
                layer("side8.0", c, d, 4)?,
            ],
            last8: layer("side8.1", d, d, 3)?,
            ups: [one("up1", b, a)?, one("up2", c, b)?, one("up4", d, c)?],
            heads: heads.iter().enumerate().map(head).collect::<Result<_, _>>()?,
        })
    }

    /// Factors from 0 to 2 at full resolution, 1/2, 1/4, 1/8, and once more at 1/2 and 1/4.
    fn of(&self, reference: &Map) -> Vec<Map> {
        let reference = reference.padded([1, BLOCK, BLOCK]);
        let half = self.sides[1].run(&reference, positive);
        let quarter = self.sides[2].run(&half, positive);
        let eighth = self.last8.run(&self.sides[3].run(&quarter, positive), positive);
        let onto = |up: &Convolution, from: &Map, to: &Map| up.run(from, as_is).enlarged_onto(to, true);
        let quarter = onto(&self.ups[2], &eighth, &quarter);
        let half = onto(&self.ups[1], &quarter, &half);
        let full = onto(&self.ups[0], &half, &self.sides[0].run(&reference, positive));
        let levels = [&full, &half, &quarter, &eighth, &half, &quarter];
        let gate = |(head, level): (&Convolution, &Map)| head.run(level, |_, values| sigmoids(values, 2.0));
        self.heads.iter().zip(levels).map(gate).collect()
    }
}

impl VolumeNet {
    /// The network `name` of the weights.
    pub(crate) fn new(weights: &Weights, name: &str) -> Result<Self, CorrError> {
        let [a, b, c, d] = WIDTHS;
        let layer = |part: &str, inputs: usize, outputs: usize, stride: usize| {
            weights.layer(&format!("{name}.{part}"), Shape::volume(inputs, outputs, 3), stride)
        };
        let residual = |part: &str, channels: usize| -> Result<[Convolution; 2], CorrError> {
            let second = format!("{name}.{part}.second");
            Ok([
                layer(&format!("{part}.first"), channels, channels, 1)?,
                weights.bare(&second, Shape::volume(channels, channels, 3), false)?,
            ])
        };
        let up = |part: &str, inputs, outputs| weights.doubling(&format!("{name}.{part}"), inputs, outputs);
        Ok(Self {
            gates: Gates::new(weights, &format!("{name}.gates"))?,
            same: weights.bare(&format!("{name}.same"), Shape::volume(a, a, 1), true)?,
            scale2: layer("scale2", a, b, 2)?,
            scale2_same: layer("scale2_same", b, b, 1)?,
            scale4: layer("scale4", b, c, 2)?,
            scale4_same: layer("scale4_same", c, c, 1)?,
            scale8: layer("scale8", c, d, 2)?,
            scale8_same: layer("scale8_same", d, d, 1)?,
            deep4: residual("deep4", c)?,
            deep8: [residual("deep8.0", d)?, residual("deep8.1", d)?],
            up4: up("up4", d, c)?,
            up2: up("up2", c, b)?,
            up1: up("up1", b, a)?,
            last: weights.to_one(&format!("{name}.last"), Shape::volume(a, 1, 3), false)?,
        })
    }

    /// The costs of a volume's planes, (D, h, w), a low cost being likely, with the features of the reference view at its
    /// resolution.
    pub fn costs(&self, volume: &Map, reference: &Map) -> Vec<f32> {
        let sides = volume.sides();
        let gates = self.gates.of(reference);
        let volume = volume.padded([BLOCK; 3]);
        let half = self.half(&volume, &gates);
        let [planes, height, width] = volume.sides();
        let mut costs = Vec::with_capacity(sides.iter().product());
        for first in (0..sides[0]).step_by(SLAB) {
            let end = (first + SLAB).min(sides[0]);
            let (low, high) = (first.saturating_sub(1), (end + 1).min(planes));
            let same = self.same.run_planes(&volume, low..high, positive);
            let full = self.up1.run_planes(&half, low..high, |Row { z, y }, values| {
                relu(values);
                add(values, same.row(Row { z: z - low, y }));
                multiply(values, gates[0].line(y));
            });
            let slab = self.last.run_planes(&full, low, first..end, as_is);
            for plane in slab.chunks_exact(height * width) {
                plane
                    .chunks_exact(width)
                    .take(sides[1])
                    .for_each(|row| costs.extend_from_slice(&row[..sides[2]]));
            }
        }
        costs
    }

    /// All layers at half the resolution and below.
    fn half(&self, volume: &Map, gates: &[Map]) -> Map {
        let gated = |layer: &Convolution, input: &Map, gate: &Map| {
            layer.run(input, |row, values| {
                relu(values);
                multiply(values, gate.line(row.y));
            })
        };
        let joined = |layer: &Convolution, input: &Map, beside: &Map, gate: &Map| {
            layer.run(input, |row, values| {
                relu(values);
                add(values, beside.row(row));
                multiply(values, gate.line(row.y));
            })
        };
        let half = gated(&self.scale2_same, &self.scale2.run(volume, positive), &gates[1]);
        let quarter = gated(&self.scale4_same, &self.scale4.run(&half, positive), &gates[2]);
        let quarter = residual(&self.deep4, &quarter);
        let eighth = gated(&self.scale8_same, &self.scale8.run(&quarter, positive), &gates[3]);
        let eighth = self.deep8.iter().fold(eighth, |map, layers| residual(layers, &map));
        let quarter = joined(&self.up4, &eighth, &quarter, &gates[5]);
        joined(&self.up2, &quarter, &half, &gates[4])
    }
}

/// Two convolutions beside the identity.
fn residual([first, second]: &[Convolution; 2], map: &Map) -> Map {
    second.run(&first.run(map, positive), |row, values| add(values, map.row(row)))
}
