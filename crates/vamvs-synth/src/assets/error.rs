//! The error type of assets.

use std::io;
use std::path::{Path, PathBuf};

/// Why assets could not be used.
#[derive(Debug, thiserror::Error)]
pub enum AssetError {
    /// A folder could not be listed.
    #[error("cannot list the folder {}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The system's reason.
        source: walkdir::Error,
    },
    /// A file could not be read.
    #[error("cannot read {}", path.display())]
    System {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A folder holds no file of its kind that the filter admits.
    #[error(
        "{}: expected {expected}, found none among its {found} files; check the folder and the asset filter",
        folder.display()
    )]
    Empty {
        /// The folder.
        folder: PathBuf,
        /// The kind of file that was looked for.
        expected: &'static str,
        /// How many files the folder holds, of any kind.
        found: usize,
    },
    /// A name in a filter is not a valid glob.
    #[error("the asset name {pattern:?} is not a valid glob pattern")]
    Pattern {
        /// The name.
        pattern: String,
        /// What is wrong with it.
        source: glob::PatternError,
    },
    /// A mesh file has invalid content.
    #[error("{}: {problem}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        problem: String,
    },
    /// A texture could not be read.
    #[error(transparent)]
    Texture(#[from] vamvs_io::IoError),
    /// An environment map could not be decoded.
    #[error("cannot decode the environment map {}", path.display())]
    Environment {
        /// The file.
        path: PathBuf,
        /// The decoder's reason.
        source: image::ImageError,
    },
    /// An environment map is dark in its upper half.
    #[error("{}: expected an environment map with light in its upper half, found none", path.display())]
    DarkEnvironment {
        /// The file.
        path: PathBuf,
    },
}

impl AssetError {
    /// A closure for `map_err` that makes [`AssetError::System`] of the file `path`.
    pub(super) fn system(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::System { path: path.to_owned(), source }
    }

    /// A problem with the content of the mesh file `path`.
    pub(super) fn mesh(path: &Path, problem: impl Into<String>) -> Self {
        Self::Mesh { path: path.to_owned(), problem: problem.into() }
    }
}
