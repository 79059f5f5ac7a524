//! Regularisation of a volume, as `vamvs_corr::layers::VolumeNet` does it.

use vamvs_corr::layers::{self, VOLUME_BLOCK};
use wgpu::Buffer;

use crate::layer::{Convolution, Finish, Place, ToOne, enlarged_onto, padded};
use crate::map::Map;
use crate::recorder::Recorder;
use crate::{Gpu, GpuError};

/// The factors of the volume's channels.
struct Gates {
    sides: Vec<Convolution>,
    last8: Convolution,
    ups: Vec<Convolution>,
    heads: Vec<Convolution>,
}

/// The U-Net.
pub struct VolumeNet {
    gates: Gates,
    same: Convolution,
    scale2: Convolution,
    scale2_same: Convolution,
    scale4: Convolution,
    scale4_same: Convolution,
    scale8: Convolution,
    scale8_same: Convolution,
    deep4: [Convolution; 2],
    deep8: [[Convolution; 2]; 2],
    up4: Convolution,
    up2: Convolution,
    up1: Convolution,
    last: ToOne,
}

fn all(gpu: &Gpu, layers: &[layers::Convolution]) -> Result<Vec<Convolution>, GpuError> {
    layers.iter().map(|layer| Convolution::new(gpu, layer)).collect()
}

fn two(gpu: &Gpu, [first, second]: &[layers::Convolution; 2]) -> Result<[Convolution; 2], GpuError> {
    Ok([Convolution::new(gpu, first)?, Convolution::new(gpu, second)?])
}

impl Gates {
    fn new(gpu: &Gpu, layers: &layers::Gates) -> Result<Self, GpuError> {
        Ok(Self {
            sides: all(gpu, &layers.sides)?,
            last8: Convolution::new(gpu, &layers.last8)?,
            ups: all(gpu, &layers.ups)?,
            heads: all(gpu, &layers.heads)?,
        })
    }

    /// Factors from 0 to 2 at full resolution, 1/2, 1/4, 1/8, and once more at 1/2 and 1/4.
    fn of(&self, to: &mut Recorder<'_>, reference: &Map) -> Result<Vec<Map>, GpuError> {
        let whole = padded(to, reference, [1, VOLUME_BLOCK, VOLUME_BLOCK])?;
        let reference = whole.as_ref().unwrap_or(reference);
        let half = self.sides[1].run(to, reference, Finish::RELU)?;
        let quarter = self.sides[2].run(to, &half, Finish::RELU)?;
        let eighth = self.sides[3].run(to, &quarter, Finish::RELU)?;
        let eighth = self.last8.run(to, &eighth, Finish::RELU)?;
        let onto = |to: &mut Recorder<'_>, up: &Convolution, from: &Map, beside: &Map| {
            let from = up.run(to, from, Finish::default())?;
            enlarged_onto(to, &from, beside, true)
        };
        let quarter = onto(to, &self.ups[2], &eighth, &quarter)?;
        let half = onto(to, &self.ups[1], &quarter, &half)?;
        let full = self.sides[0].run(to, reference, Finish::RELU)?;
        let full = onto(to, &self.ups[0], &half, &full)?;
        let levels = [&full, &half, &quarter, &eighth, &half, &quarter];
        let sigmoid = Finish { sigmoid: Some(2.0), ..Finish::default() };
        self.heads.iter().zip(levels).map(|(head, level)| head.run(to, level, sigmoid)).collect()
    }
}

impl VolumeNet {
    pub fn new(gpu: &Gpu, layers: &layers::VolumeNet) -> Result<Self, GpuError> {
        let one = |layer: &layers::Convolution| Convolution::new(gpu, layer);
        let [first, second] = &layers.deep8;
        Ok(Self {
            gates: Gates::new(gpu, &layers.gates)?,
            same: one(&layers.same)?,
            scale2: one(&layers.scale2)?,
            scale2_same: one(&layers.scale2_same)?,
            scale4: one(&layers.scale4)?,
            scale4_same: one(&layers.scale4_same)?,
            scale8: one(&layers.scale8)?,
            scale8_same: one(&layers.scale8_same)?,
            deep4: two(gpu, &layers.deep4)?,
            deep8: [two(gpu, first)?, two(gpu, second)?],
            up4: one(&layers.up4)?,
            up2: one(&layers.up2)?,
            up1: one(&layers.up1)?,
            last: ToOne::new(gpu, &layers.last, false)?,
        })
    }

    /// The costs of a volume's planes, (D, h, w), with the features of the reference view at its resolution.
    pub fn costs(&self, to: &mut Recorder<'_>, volume: &Map, reference: &Map) -> Result<Buffer, GpuError> {
        let sides = volume.sides;
        let gates = self.gates.of(to, reference)?;
        let whole = padded(to, volume, [VOLUME_BLOCK; 3])?;
        let volume = whole.as_ref().unwrap_or(volume);
        let half = self.half(to, volume, &gates)?;
        let same = self.same.run(to, volume, Finish::RELU)?;
        let full = self.up1.run(to, &half, joined(&same, &gates[0]))?;
        let buffer = to.gpu.buffer(4 * sides.iter().product::<usize>())?;
        self.last.run(to, &full, Place { buffer: &buffer, first: 0, sides });
        Ok(buffer)
    }

    /// All layers at half the resolution and below.
    fn half(&self, to: &mut Recorder<'_>, volume: &Map, gates: &[Map]) -> Result<Map, GpuError> {
        let half = self.scale2.run(to, volume, Finish::RELU)?;
        let half = self.scale2_same.run(to, &half, Finish::gated(&gates[1]))?;
        let quarter = self.scale4.run(to, &half, Finish::RELU)?;
        let quarter = self.scale4_same.run(to, &quarter, Finish::gated(&gates[2]))?;
        let quarter = residual(to, &self.deep4, &quarter)?;
        let eighth = self.scale8.run(to, &quarter, Finish::RELU)?;
        let mut eighth = self.scale8_same.run(to, &eighth, Finish::gated(&gates[3]))?;
        for layers in &self.deep8 {
            eighth = residual(to, layers, &eighth)?;
        }
        let quarter = self.up4.run(to, &eighth, joined(&quarter, &gates[5]))?;
        self.up2.run(to, &quarter, joined(&half, &gates[4]))
    }
}

/// A ReLU, then another map beside it, then factors.
fn joined<'a>(beside: &'a Map, gate: &'a Map) -> Finish<'a> {
    Finish { beside: Some(beside), ..Finish::gated(gate) }
}

/// Two convolutions beside the identity.
fn residual(to: &mut Recorder<'_>, [first, second]: &[Convolution; 2], map: &Map) -> Result<Map, GpuError> {
    let inner = first.run(to, map, Finish::RELU)?;
    second.run(to, &inner, Finish { beside: Some(map), ..Finish::default() })
}
