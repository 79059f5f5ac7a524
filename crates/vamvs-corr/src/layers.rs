//! The network's layers, for programs that run them elsewhere, as on a GPU.

pub use crate::convolution::{Convolution, Pass, Tap};
pub use crate::enlarge::Enlarge;
pub use crate::map::{Map, Row};
pub use crate::pyramid::Pyramid;
pub use crate::surface::Surface;
pub use crate::to_one::ToOne;
pub use crate::volume_net::{BLOCK as VOLUME_BLOCK, Gates, VolumeNet};

pub use crate::enlarge::{REACH, bilinear};
pub use crate::plane_map::ONE_SURFACE;
pub use crate::pyramid::{BLOCK, CHANNELS, STRIDE};
pub use crate::sweep::{BEHIND, GROUPS, PlaneDepth, UNSEEN};

use crate::CorrError;
use crate::weights::{Shape, Weights};

/// All layers of the network.
#[derive(Debug)]
pub struct Layers {
    /// The features of a photograph.
    pub pyramid: Pyramid,
    /// What a source view sees, from its pooled correlations: two layers with a ReLU, one with a sigmoid.
    pub seen: ([Convolution; 2], ToOne),
    /// Regularisation of the first volume.
    pub coarse: VolumeNet,
    /// Regularisation of the second one.
    pub fine: VolumeNet,
    /// The first depth map at twice its resolution.
    pub enlarge: Enlarge,
    /// Where there is a surface.
    pub surface: Surface,
}

impl Layers {
    pub(crate) fn new(weights: &Weights) -> Result<Self, CorrError> {
        let image = Shape::image;
        let seen = [
            weights.layer("seen.0", image(2 * GROUPS, 16, 3), 1)?,
            weights.layer("seen.1", image(16, 16, 3), 1)?,
        ];
        Ok(Self {
            pyramid: Pyramid::new(weights)?,
            seen: (seen, weights.to_one("seen.2", image(16, 1, 1), true)?),
            coarse: VolumeNet::new(weights, "volume")?,
            fine: VolumeNet::new(weights, "fine")?,
            enlarge: Enlarge::new(weights)?,
            surface: Surface::new(weights)?,
        })
    }
}
