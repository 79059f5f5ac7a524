//! The inputs of depth maps, which do not change while the maps are made.

use vamvs_core::Scene;
use vamvs_net::Estimator;

use crate::{DepthOptions, Photographs, Plan};

/// A scene with its photographs, the network, and what will be done for each view;
/// [`crate::Reconstruction::prepare`] makes it.
pub struct Prepared {
    /// The cameras, and sparse points if there are any.
    pub scene: Scene,
    /// The photographs, at the size at which the network sees them.
    pub photographs: Photographs,
    /// What will be done for each view.
    pub plan: Plan,
    /// The network and how it is run.
    pub estimator: Estimator,
    /// The hash of the network's module, a part of the identity of depth maps.
    pub(crate) module: blake3::Hash,
    /// How depth maps are made.
    pub options: DepthOptions,
}
