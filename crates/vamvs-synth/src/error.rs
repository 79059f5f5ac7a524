//! Why scenes could not be made.

use std::path::PathBuf;

use vamvs_io::IoError;

use crate::AssetError;

/// Why scenes could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// An asset cannot be used.
    #[error(transparent)]
    Asset(#[from] AssetError),
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// Options that make no scene.
    #[error("{name} must be {expected}, got {got}")]
    Option {
        /// The option.
        name: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// As given.
        got: String,
    },
    /// A complete scene is there already, and another one is wanted.
    #[error(
        "{} is complete but was made with {differences}; choose another folder, the same options, or overwrite it with --force",
        folder.display()
    )]
    OtherScene {
        /// The scene's folder.
        folder: PathBuf,
        /// What differs: `option old instead of new`.
        differences: String,
    },
    /// The record of a scene is not one.
    #[error("{} is not the record of a scene; overwrite the scene with --force", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// On none of several stages there was room for the cameras.
    #[error(
        "scene {scene} ({style}): no place found for {views} cameras ({rig}); use fewer views or another rig"
    )]
    NoPlace {
        /// The scene.
        scene: u64,
        /// Its style.
        style: &'static str,
        /// How many cameras.
        views: usize,
        /// How they should have stood.
        rig: &'static str,
    },
}
