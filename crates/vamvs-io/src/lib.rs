//! The file formats of vamvs: photographs, depth maps, clouds, masks and camera models.
//!
//! Readers stream, check every count against the file's size before they allocate, and answer
//! hostile input with an [`IoError`] that names the file, the place, what was expected and what was
//! found. Writers go through [`atomic`], so that no half-written file is ever seen. Nothing here
//! computes geometry: pixels and cameras are handed on as `vamvs_core` types.

pub mod atomic;
mod bytes;
pub mod colmap;
pub mod depth;
pub mod error;
mod folder;
pub mod image;
mod jpeg;
pub mod masks;
pub mod mvsnet;
pub mod pfm;
pub mod ply;
mod text;

pub use error::{IoError, Place};

use vamvs_core::Scene;

/// A scene as read from its files.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// What a user should know about how the files were read, one sentence each.
    pub warnings: Vec<String>,
}
