//! Comparison with ground truth: depth maps, clouds, and whole scenes with a page that shows them.

pub mod cloud;
pub mod depth;
pub mod page;
pub mod scene;

pub use cloud::{CloudProtocol, CloudScores};
pub use depth::{DepthScene, RegionErrors, SceneErrors, ViewErrors};
pub use scene::{CloudThreshold, SceneEvaluation, SceneScores};
