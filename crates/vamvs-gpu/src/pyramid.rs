//! Features of a photograph, as `vamvs_corr::layers::Pyramid` makes them.

use vamvs_corr::layers;

use crate::layer::{Convolution, Finish, enlarged_onto, padded};
use crate::map::Map;
use crate::recorder::Recorder;
use crate::{Gpu, GpuError};

/// The layers.
pub struct Pyramid {
    down: [Vec<Convolution>; 3],
    deep: [Vec<Convolution>; 2],
    up4: Convolution,
    up3: Convolution,
    side3: Convolution,
    up2: Convolution,
    side2: Convolution,
    out2: Convolution,
}

impl Pyramid {
    pub fn new(gpu: &Gpu, layers: &layers::Pyramid) -> Result<Self, GpuError> {
        let one = |layer: &layers::Convolution| Convolution::new(gpu, layer);
        let all = |layers: &[layers::Convolution]| layers.iter().map(one).collect::<Result<Vec<_>, _>>();
        let [down1, down2, down3] = &layers.down;
        let [deep4, deep5] = &layers.deep;
        Ok(Self {
            down: [all(down1)?, all(down2)?, all(down3)?],
            deep: [all(deep4)?, all(deep5)?],
            up4: one(&layers.up4)?,
            up3: one(&layers.up3)?,
            side3: one(&layers.side3)?,
            up2: one(&layers.up2)?,
            side2: one(&layers.side2)?,
            out2: one(&layers.out2)?,
        })
    }

    /// The features at 1/4 of an image whose sides are multiples of 8.
    pub fn features(&self, to: &mut Recorder<'_>, image: &Map) -> Result<Map, GpuError> {
        let as_is = Finish::default();
        let half = chain(to, &self.down[0], image)?;
        let quarter = chain(to, &self.down[1], &half)?;
        let eighth = chain(to, &self.down[2], &quarter)?;
        let even = padded(to, &eighth, [1, 2, 2])?;
        let sixteenth = chain(to, &self.deep[0], even.as_ref().unwrap_or(&eighth))?;
        let even = padded(to, &sixteenth, [1, 2, 2])?;
        let far = chain(to, &self.deep[1], even.as_ref().unwrap_or(&sixteenth))?;
        let far = self.up4.run(to, &far, as_is)?;
        let sixteenth = enlarged_onto(to, &far, &sixteenth, true)?;
        let wide = self.up3.run(to, &sixteenth, as_is)?;
        let side = self.side3.run(to, &eighth, as_is)?;
        let eighth = enlarged_onto(to, &wide, &side, false)?;
        let up = self.up2.run(to, &eighth, as_is)?;
        let side = self.side2.run(to, &quarter, as_is)?;
        let quarter = enlarged_onto(to, &up, &side, false)?;
        self.out2.run(to, &quarter, as_is)
    }
}

/// The layers one after the other, each with a ReLU.
fn chain(to: &mut Recorder<'_>, layers: &[Convolution], first: &Map) -> Result<Map, GpuError> {
    let mut map = layers[0].run(to, first, Finish::RELU)?;
    for layer in &layers[1..] {
        map = layer.run(to, &map, Finish::RELU)?;
    }
    Ok(map)
}
