//! Measures of depth maps and clouds against truth.
//!
//! This crate knows no file and makes no pictures; it counts.

pub mod cloud;
pub mod depth;

pub use cloud::{Agreement, compare_clouds};
pub use depth::{DepthErrors, compare_depths};
