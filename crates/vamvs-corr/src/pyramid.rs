//! Features of a photograph: a pyramid with context from levels down to 1/32, of which the level at 1/4 is used.

use rayon::prelude::*;
use vamvs_core::{Grid, Rgb};

use crate::CorrError;
use crate::convolution::Convolution;
use crate::map::{Map, Row};
use crate::weights::{Shape, Weights};
use crate::wide::relu;

/// Channels of the features.
pub const CHANNELS: usize = 32;

/// Stride of the features in the image that they are made of.
pub const STRIDE: usize = 4;

/// Images are padded to multiples of this.
pub const BLOCK: usize = 8;

/// The layers of the features, each but the last ones with a ReLU.
#[derive(Debug)]
pub struct Pyramid {
    /// From the image to 1/2, 1/4, 1/8; the first layer of each halves.
    pub down: [Vec<Convolution>; 3],
    /// To 1/16 and 1/32; odd sides are made even before.
    pub deep: [Vec<Convolution>; 2],
    /// From 1/32, enlarged onto 1/16.
    pub up4: Convolution,
    /// From 1/16, enlarged onto `side3`.
    pub up3: Convolution,
    /// Of 1/8.
    pub side3: Convolution,
    /// From 1/8, enlarged onto `side2`.
    pub up2: Convolution,
    /// Of 1/4.
    pub side2: Convolution,
    /// The features.
    pub out2: Convolution,
}

impl Pyramid {
    pub(crate) fn new(weights: &Weights) -> Result<Self, CorrError> {
        let layer = |name: &str, inputs: usize, outputs: usize, side: usize| {
            weights.layer(
                &format!("pyramid.{name}"),
                Shape::image(inputs, outputs, side),
                if side == 4 { 2 } else { 1 },
            )
        };
        let bare = |name: &str, inputs: usize, outputs: usize, side: usize, has_bias: bool| {
            weights.bare(&format!("pyramid.{name}"), Shape::image(inputs, outputs, side), has_bias)
        };
        Ok(Self {
            down: [
                vec![layer("down1.0", 3, 16, 4)?, layer("down1.1", 16, 16, 3)?],
                vec![
                    layer("down2.0", 16, 32, 4)?,
                    layer("down2.1", 32, 32, 3)?,
                    layer("down2.2", 32, 32, 3)?,
                ],
                vec![
                    layer("down3.0", 32, 48, 4)?,
                    layer("down3.1", 48, 48, 3)?,
                    layer("down3.2", 48, 48, 3)?,
                ],
            ],
            deep: [
                vec![layer("down4.0.conv", 48, 64, 4)?, layer("down4.1", 64, 64, 3)?],
                vec![layer("down5.0.conv", 64, 64, 4)?, layer("down5.1", 64, 64, 3)?],
            ],
            up4: bare("up4", 64, 64, 1, true)?,
            up3: bare("up3", 64, 32, 1, true)?,
            side3: bare("side3", 48, 32, 1, false)?,
            up2: bare("up2", 32, 32, 1, true)?,
            side2: bare("side2", 32, 32, 1, false)?,
            out2: bare("out2", 32, CHANNELS, 3, false)?,
        })
    }

    /// The features at 1/4 of an image with three channels in [0, 1], whose sides are multiples of 8.
    pub fn features(&self, image: &Map) -> Map {
        let quarter = chain(&self.down[1], &chain(&self.down[0], &normalised(image)));
        let eighth = chain(&self.down[2], &quarter);
        let sixteenth = chain(&self.deep[0], &eighth.padded([1, 2, 2]));
        let far = chain(&self.deep[1], &sixteenth.padded([1, 2, 2]));
        let sixteenth = self.up4.run(&far, as_is).enlarged_onto(&sixteenth, true);
        let wide = self.up3.run(&sixteenth, as_is);
        let eighth = wide.enlarged_onto(&self.side3.run(&eighth, as_is), false);
        let quarter = self.up2.run(&eighth, as_is).enlarged_onto(&self.side2.run(&quarter, as_is), false);
        self.out2.run(&quarter, as_is)
    }
}

/// No change to a row.
pub fn as_is(_: Row, _: &mut [f32]) {}

/// Negative values of a row become zero.
pub fn positive(_: Row, values: &mut [f32]) {
    relu(values);
}

/// The layers one after the other, each with a ReLU.
fn chain(layers: &[Convolution], first: &Map) -> Map {
    let mut map = layers[0].run(first, positive);
    for layer in &layers[1..] {
        map = layer.run(&map, positive);
    }
    map
}

/// A photograph with values in [0, 1], padded to multiples of 8 by repeating the last column and row.
pub fn image(photograph: &Grid<Rgb>) -> Map {
    let size = photograph.size();
    let map = Map::by_rows([1, size.height, size.width], 3, |Row { y, .. }, to| {
        for (to, value) in to.iter_mut().zip(photograph.row(y).as_flattened()) {
            *to = f32::from(*value) / 255.0;
        }
    });
    map.padded([1, BLOCK, BLOCK]).into_owned()
}

/// The sum of values and that of their squares.
fn moments(values: &[f32]) -> [f64; 2] {
    const LANES: usize = 8;
    let (mut sums, mut squares) = ([0.0; LANES], [0.0; LANES]);
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            let value = f64::from(chunk[lane]);
            sums[lane] += value;
            squares[lane] += value * value;
        }
    }
    let rest = rest.iter().map(|value| f64::from(*value));
    [
        sums.iter().sum::<f64>() + rest.clone().sum::<f64>(),
        squares.iter().sum::<f64>() + rest.map(|v| v * v).sum::<f64>(),
    ]
}

/// The image with zero mean and unit standard deviation over all its values.
fn normalised(image: &Map) -> Map {
    let rows: Vec<[f64; 2]> = image.values.par_chunks(image.width * image.channels).map(moments).collect();
    let [sum, squares] = rows.iter().fold([0.0; 2], |[a, b], row| [a + row[0], b + row[1]]);
    let count = image.values.len() as f64;
    let mean = sum / count;
    let deviation = ((squares - sum * mean).max(0.0) / (count - 1.0)).sqrt();
    let (mean, share) = (mean as f32, 1.0 / (deviation + 1e-3) as f32);
    Map::by_rows(image.sides(), image.channels, |row, to| {
        for (to, value) in to.iter_mut().zip(image.row(row)) {
            *to = (value - mean) * share;
        }
    })
}
