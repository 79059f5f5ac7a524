//! Reads and writes models, as binary or text files.

use std::path::Path;

use super::model::{Keypoints, Model};
use super::{binary, text, workspace};
use crate::IoError;

impl Model {
    /// Reads the model in `folder`: the binary files if there is a `cameras.bin`, else the text files. `folder` may also be
    /// a workspace with one model, in `sparse` or in a numbered folder such as `sparse/0`.
    ///
    /// Quaternions are normalised. A model without a `points3D` file has no points. Images whose pose is none are left out, with a
    /// warning.
    ///
    /// # Errors
    /// If there is no model or more than one, a file cannot be read or is malformed, a camera's model is not supported, a camera or half of the poses are
    /// invalid, an image's camera does not exist, an image's id or name occurs twice, or a name leads out of the
    /// image folder.
    pub fn read(folder: &Path) -> Result<Self, IoError> {
        Self::read_with(folder, Keypoints::Read)
    }

    /// Reads the model in `folder` as [`Model::read`] does, but skips the images' keypoints. They
    /// make up most of a model, and the points' tracks already say which image sees which point.
    ///
    /// # Errors
    /// As [`Model::read`].
    pub fn read_without_keypoints(folder: &Path) -> Result<Self, IoError> {
        Self::read_with(folder, Keypoints::Skip)
    }

    fn read_with(folder: &Path, keypoints: Keypoints) -> Result<Self, IoError> {
        let folder = &workspace::model(folder)?;
        let is_binary = folder.join("cameras.bin").is_file();
        let model = if is_binary { binary::read(folder, keypoints)? } else { text::read(folder, keypoints)? };
        model.check(&folder.join(if is_binary { "images.bin" } else { "images.txt" }))?;
        Ok(model)
    }

    /// Writes `cameras.txt`, `images.txt` and `points3D.txt` into `folder`, which must exist.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_text(&self, folder: &Path) -> Result<(), IoError> {
        text::write(self, folder)
    }

    /// Writes `cameras.bin`, `images.bin` and `points3D.bin` into `folder`, which must exist.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_binary(&self, folder: &Path) -> Result<(), IoError> {
        binary::write(self, folder)
    }
}
