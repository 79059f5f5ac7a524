//! The errors of reading and writing files. Each names the file, the place in it, what was expected and what
//! was found.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use vamvs_core::Size;

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IoError {
    /// The operating system refused.
    #[error("cannot {action} {}", path.display())]
    System {
        /// What was tried, as a verb.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file's content is not what its format asks for.
    #[error("{}{place}: {problem}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in the file.
        place: Place,
        /// The entity, what was expected and what was found.
        problem: String,
    },
    /// The content is valid but not supported.
    #[error("{}{place}: {problem}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Where in the file.
        place: Place,
        /// What is not supported, and what to do.
        problem: String,
    },
    /// A file of somebody else has the name of one that will be written.
    #[error(
        "{}: was not written by vamvs and would be overwritten: choose another name for what is written, or move it away",
        path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// An image could not be decoded.
    #[error("cannot decode the image {}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// The decoder's reason.
        source: ::image::ImageError,
    },
    /// An image has neither the size nor the aspect ratio of its camera, or a mask those of its photograph.
    #[error(
        "{}: the image is {image} pixels, its {of} {expected}; the sizes must agree, or at least their aspect ratios",
        path.display()
    )]
    SizeMismatch {
        /// The file.
        path: PathBuf,
        /// The image's size in pixels.
        image: Size,
        /// What the image was compared with: "camera" or "photograph".
        of: &'static str,
        /// The size of the camera or photograph.
        expected: Size,
    },
    /// Photographs that the scene's files name are not in the image folder.
    #[error(
        "{}: half of the scene's photographs or more are missing there, {count}: {}{}; give their folder with --images",
        folder.display(), first.iter().map(|name| crate::names::shown(name)).collect::<Vec<_>>().join(", "), if *count > first.len() { ", …" } else { "" }
    )]
    MissingImages {
        /// The image folder.
        folder: PathBuf,
        /// How many images are missing.
        count: usize,
        /// The names of the first few missing images.
        first: Vec<String>,
    },
}

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// The file as a whole.
    Whole,
    /// A line, counted from 1.
    Line(usize),
    /// A byte offset, counted from 0.
    Byte(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Line(line) => write!(f, " line {line}"),
            Self::Byte(byte) => write!(f, " byte {byte}"),
        }
    }
}

impl IoError {
    /// A closure for `map_err`: the error that `action`, a verb, failed on `path`.
    pub(crate) fn system(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::System { action, path: path.to_owned(), source }
    }

    /// The same error of one of several things of which so many of `all` are broken in some way.
    pub(crate) fn of_several(self, broken: usize, all: usize) -> Self {
        match self {
            Self::Malformed { path, place, problem } if broken > 1 => {
                let others = broken - 1;
                Self::Malformed {
                    path,
                    place,
                    problem: format!("{problem}; of the {all}, {others} more cannot be used"),
                }
            }
            error => error,
        }
    }

    /// An error about malformed content of `path`.
    pub(crate) fn malformed(path: &Path, place: Place, problem: impl fmt::Display) -> Self {
        Self::Malformed { path: path.to_owned(), place, problem: problem.to_string() }
    }

    /// An error about valid content of `path` that is not supported.
    pub(crate) fn unsupported(path: &Path, place: Place, problem: impl fmt::Display) -> Self {
        Self::Unsupported { path: path.to_owned(), place, problem: problem.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_the_file_and_the_place() {
        let error = IoError::malformed(Path::new("a b.txt"), Place::Line(3), "expected 1, found 2");
        assert_eq!(error.to_string(), "a b.txt line 3: expected 1, found 2");
        let first = vec!["é.jpg".to_owned(), "b.jpg".to_owned()];
        let error = IoError::MissingImages { folder: "images".into(), count: 7, first };
        assert_eq!(
            error.to_string(),
            "images: half of the scene's photographs or more are missing there, 7: é.jpg, b.jpg, …; give their folder with --images"
        );
    }
}
