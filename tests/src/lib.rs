//! Rendered scenes with exact ground truth, for tests across crates and for the demo.
//!
//! `vamvs-synth` supplies the meshes, patterns and light; the depth and the normal of every pixel are exact.
//! The world's z axis points up; the unit of length is the metre, and objects are up to 1 m in size.

pub mod fixtures;
pub mod folder;
pub mod render;
pub mod rig;
mod sky;
mod still_life;
pub mod texture;

pub use render::{Rendered, render};
