//! The inputs of depth maps, which do not change while the maps are made.

use crate::{DepthOptions, Method, Photographs, Plan};
use vamvs_core::Scene;

/// A scene with its photographs, the method, and what will be done for each view;
/// [`crate::Reconstruction::prepare`] makes it.
#[derive(Debug)]
pub struct Prepared {
    /// The cameras, and sparse points if there are any.
    pub scene: Scene,
    /// The photographs, at the size at which the method sees them.
    pub photographs: Photographs,
    /// What will be done for each view.
    pub plan: Plan,
    /// The network, or what stands in for it.
    pub method: Method,
    /// How depth maps are made.
    pub options: DepthOptions,
}
