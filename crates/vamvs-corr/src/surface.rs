//! Where there is a surface to be measured at all.

use crate::CorrError;
use crate::convolution::Convolution;
use crate::map::{Map, Row};
use crate::pyramid::{CHANNELS, positive};
use crate::to_one::ToOne;
use crate::weights::{Shape, Weights};
use crate::wide::{add, relu, sigmoids};

/// Channels of what the volumes tell of a surface.
const EVIDENCE: usize = 6;

/// Channels of what is seen around a pixel.
const LOOKED: usize = 16;

const INPUTS: usize = LOOKED + EVIDENCE;

/// How likely a pixel shows a surface inside the depth range, and not sky or what lies beyond.
#[derive(Debug)]
pub struct Surface {
    /// What is seen around a pixel.
    pub look: Convolution,
    /// Of that, and of what the volumes tell.
    pub weigh: Convolution,
    /// Beside the identity.
    pub wide: Convolution,
    /// The probability, before the sigmoid.
    pub judge: ToOne,
}

impl Surface {
    pub(crate) fn new(weights: &Weights) -> Result<Self, CorrError> {
        let name = |part: &str| format!("surface_net.{part}");
        Ok(Self {
            look: weights.bare(&name("look"), Shape::image(CHANNELS, LOOKED, 3), true)?,
            weigh: weights.bare(&name("weigh"), Shape::image(INPUTS, 16, 3), true)?,
            wide: weights.dilated(&name("wide"), Shape::image(16, 16, 3))?,
            judge: weights.to_one(&name("judge"), Shape::image(16, 1, 1), true)?,
        })
    }

    /// The probability for each pixel, (h, w), from what the volumes tell of it and the features of the reference view.
    pub fn probability(
        &self,
        evidence: impl Fn(usize) -> [f32; EVIDENCE] + Sync,
        reference: &Map,
    ) -> Vec<f32> {
        let looked = self.look.run(reference, positive);
        let inputs = Map::by_rows(reference.sides(), INPUTS, |Row { y, .. }, to| {
            for (x, to) in to.as_chunks_mut::<INPUTS>().0.iter_mut().enumerate() {
                to[..LOOKED].copy_from_slice(&looked.line(y)[x * LOOKED..][..LOOKED]);
                to[LOOKED..].copy_from_slice(&evidence(y * reference.width + x));
            }
        });
        let weighed = self.weigh.run(&inputs, positive);
        let judged = self.wide.run(&weighed, |row, values| {
            relu(values);
            add(values, weighed.row(row));
        });
        self.judge.run(&judged, |_, values| sigmoids(values, 1.0))
    }
}
