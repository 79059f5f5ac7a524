//! Rendered scenes with exact truth, for tests across crates and for the demo.
//!
//! The renderer casts rays at analytic shapes with procedural textures, so that the depth and the
//! normal of every pixel are exact. The world's z axis points up; lengths are of the order of 1.

pub mod fixtures;
pub mod folder;
pub mod noise;
pub mod render;
pub mod rig;
pub mod scene;
pub mod shape;
pub mod texture;

pub use render::{Rendered, render};
