//! Where a scene comes from.

use std::path::PathBuf;

use vamvs_io::masks::Masks;
use vamvs_io::{IoError, Loaded, bundler, colmap, mvsnet, nerfstudio, nvm, openmvs};

use crate::VamvsError;

/// The files of a scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
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
        /// Folder of the model's files, or the workspace with one model in `sparse` or `sparse/0`.
        model: PathBuf,
        /// Folder of photographs, if they are not in `images` of the workspace.
        images: Option<PathBuf>,
    },
    /// nerfstudio's `transforms.json`.
    Nerfstudio {
        /// The file, or its folder.
        transforms: PathBuf,
        /// Folder of photographs, if they are not where the file says.
        images: Option<PathBuf>,
    },
    /// Bundler's `bundle.out`, with its list of images beside it.
    Bundler {
        /// The file.
        bundle: PathBuf,
        /// Folder of photographs, if they are not where the list says.
        images: Option<PathBuf>,
    },
    /// VisualSFM's `.nvm`.
    Nvm {
        /// The file.
        nvm: PathBuf,
        /// Folder of photographs, if they are not where the file says.
        images: Option<PathBuf>,
    },
    /// OpenMVS's `.mvs`.
    Openmvs {
        /// The file.
        mvs: PathBuf,
        /// Folder of photographs, if they are not where the file says.
        images: Option<PathBuf>,
    },
}

impl Input {
    /// Reads the scene. If its files name no masks, it gets those in `masks` next to the
    /// photographs.
    ///
    /// # Errors
    /// If a file is missing or malformed, or there are fewer than two views.
    pub fn load(&self) -> Result<Loaded, VamvsError> {
        let mut loaded = self.read()?;
        if loaded.masks == Masks::None {
            loaded.masks = Masks::next_to(&loaded.images);
        }
        match loaded.scene.views.len() {
            0 | 1 => Err(VamvsError::Request(format!(
                "the scene has {} view(s), but depth comes from comparing views: expected at least 2",
                loaded.scene.views.len()
            ))),
            _ => Ok(loaded),
        }
    }

    fn read(&self) -> Result<Loaded, IoError> {
        match self {
            Self::Mvsnet { cams, images, pairs, options } => {
                mvsnet::read_scene(cams, images, pairs.as_deref(), options)
            }
            Self::Colmap { model, images } => colmap::read_scene(model, images.as_deref()),
            Self::Nerfstudio { transforms, images } => nerfstudio::read_scene(transforms, images.as_deref()),
            Self::Bundler { bundle, images } => bundler::read_scene(bundle, images.as_deref()),
            Self::Nvm { nvm, images } => nvm::read_scene(nvm, images.as_deref()),
            Self::Openmvs { mvs, images } => openmvs::read_scene(mvs, images.as_deref()),
        }
    }
}
