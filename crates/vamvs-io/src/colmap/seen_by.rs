//! COLMAP's `fused.ply.vis`: for each point of the cloud, the images that see it.
//!
//! The file is little-endian: the number of points (u64), then for each point the number of images (u32) and
//! their indices in the model's list of images (u32 each).

use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

use crate::IoError;
use crate::atomic::AtomicFile;

/// Writes a visibility list point by point; the file appears only with [`SeenByWriter::finish`].
#[derive(Debug)]
pub struct SeenByWriter {
    file: AtomicFile,
    count: u64,
}

impl SeenByWriter {
    /// Begins the file `path`; its folder must exist.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn create(path: &Path) -> Result<Self, IoError> {
        let mut writer = Self { file: AtomicFile::create(path)?, count: 0 };
        let written = writer.write_count();
        writer.check(written)?;
        Ok(writer)
    }

    /// Adds a point that the images with these indices in the model's list see.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn push(&mut self, images: &[u32]) -> Result<(), IoError> {
        self.count += 1;
        let count = (images.len() as u32).to_le_bytes();
        let bytes: Vec<u8> = count.into_iter().chain(images.iter().flat_map(|i| i.to_le_bytes())).collect();
        let written = self.file.write_all(&bytes);
        self.check(written)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<(), IoError> {
        let written = self.file.seek(SeekFrom::Start(0)).and_then(|_| self.write_count());
        self.check(written)?;
        self.file.commit()
    }

    fn write_count(&mut self) -> io::Result<()> {
        self.file.write_all(&self.count.to_le_bytes())
    }

    fn check(&self, written: io::Result<()>) -> Result<(), IoError> {
        written.map_err(IoError::system("write", self.file.path()))
    }
}
