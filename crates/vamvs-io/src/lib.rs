//! The file formats of vamvs: photographs, depth maps, clouds, masks and camera models.
//!
//! Readers check every count against the file's size before they allocate. They answer malformed or
//! hostile input with an [`IoError`] that names the file, the place, what was expected and what was
//! found. Writers go through [`atomic`], so that no half-written file is ever seen. Pixels, cameras and
//! clouds are handed on as `vamvs_core` types, in the conventions of this project.

pub mod atomic;
mod broken;
pub mod bundler;
mod bytes;
pub mod colmap;
pub mod depth;
pub mod dtu;
pub mod error;
mod exr;
mod faces;
mod folder;
pub mod image;
mod jpeg;
mod locate;
pub mod masks;
pub mod mat;
pub mod mesh;
pub mod mvsnet;
mod names;
pub mod nerfstudio;
mod npy;
pub mod nvm;
pub mod openmvs;
pub mod pfm;
pub mod ply;
mod point_line;
mod sizes;
mod text;
pub mod tnt;
mod trackless;
pub mod visibility;

pub use error::{IoError, Place};

use std::path::PathBuf;

use vamvs_core::Scene;

use crate::masks::Masks;

/// A scene as read from its files.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// The folder that the views' names are relative to.
    pub images: PathBuf,
    /// The masks that the scene's files name.
    pub masks: Masks,
    /// Warnings for the user about how the files were read, one sentence each.
    pub warnings: Vec<String>,
    /// What is wrong with cameras that cannot be used, one sentence each. Their views are not in the scene, of which a warning tells.
    pub broken: Vec<String>,
}
