//! Where a scene comes from.

use std::path::{Path, PathBuf};

use vamvs_io::{Loaded, colmap, mvsnet};

use crate::VamvsError;

/// The files of a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// MVSNet's layout.
    Mvsnet {
        /// Folder of `NAME_cam.txt` files.
        cams: PathBuf,
        /// Folder of photographs.
        images: PathBuf,
        /// `pair.txt`, if it is not in or beside `cams`.
        pairs: Option<PathBuf>,
        /// How camera files are read.
        options: mvsnet::Options,
    },
    /// A COLMAP model, text or binary.
    Colmap {
        /// Folder of the model's files.
        model: PathBuf,
        /// Folder of photographs.
        images: PathBuf,
    },
}

impl Input {
    /// Reads the scene.
    ///
    /// # Errors
    /// If a file is missing or malformed, or there are fewer than two views.
    pub fn load(&self) -> Result<Loaded, VamvsError> {
        let loaded = match self {
            Self::Mvsnet { cams, images, pairs, options } => {
                mvsnet::read_scene(cams, images, pairs.as_deref(), options)?
            }
            Self::Colmap { model, images } => colmap::read_scene(model, images)?,
        };
        match loaded.scene.views.len() {
            0 | 1 => Err(VamvsError::Request(format!(
                "the scene has {} view(s), but depth comes from comparing views: expected at least 2",
                loaded.scene.views.len()
            ))),
            _ => Ok(loaded),
        }
    }

    /// The folder of photographs.
    #[must_use]
    pub fn images(&self) -> &Path {
        match self {
            Self::Mvsnet { images, .. } | Self::Colmap { images, .. } => images,
        }
    }
}
