//! The error type of this crate.

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
    /// An option is out of its range.
    #[error("{name} must be {expected}, got {got}")]
    Option {
        /// The option.
        name: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// The value that was given.
        got: String,
    },
    /// The folder holds a complete scene that was made with other options.
    #[error(
        "{} is complete but was made with {differences}; choose another folder, the same options, or overwrite it with --force",
        folder.display()
    )]
    OtherScene {
        /// The scene's folder.
        folder: PathBuf,
        /// What differs, each as `option old instead of new`.
        differences: String,
    },
    /// Something that is no scene of this program is where one would be made.
    #[error("{} was not made by vamvs synth and would be removed: choose another folder, or move it away", path.display())]
    Occupied {
        /// The file or folder.
        path: PathBuf,
    },
    /// The record of a scene is not valid JSON.
    #[error("{} is not the record of a scene; overwrite the scene with --force", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// No room was found for the cameras on any of the stages that were tried.
    #[error(
        "scene {scene} ({style}): no place found for {views} cameras ({rig}); use fewer views or another rig"
    )]
    NoPlace {
        /// The scene's number.
        scene: u64,
        /// Its style.
        style: &'static str,
        /// How many cameras.
        views: usize,
        /// The rig they should have formed.
        rig: &'static str,
    },
}
