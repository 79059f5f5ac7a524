//! Rendered scenes with exact ground truth, for tests across crates and for the demo.
//!
//! They are made of `vamvs-synth`'s meshes, patterns and light; the depth and the normal of every pixel
//! are exact. The world's z axis points up; lengths are of the order of 1.

pub mod fixtures;
pub mod folder;
pub mod render;
pub mod rig;
mod sky;
mod still_life;
pub mod texture;

pub use render::{Rendered, render};
