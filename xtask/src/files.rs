//! File operations whose errors name the file.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// Makes a folder and its parents.
pub fn create_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("{} could not be made", folder.display()))
}

/// Renames `new` to `place`. What was at `place` is removed first.
pub fn replace(place: &Path, new: &Path) -> Result<()> {
    remove(place)?;
    fs::rename(new, place)
        .with_context(|| format!("{} could not be renamed to {}", new.display(), place.display()))
}

/// Removes a file, link or folder with its contents, if there is one.
pub fn remove(path: &Path) -> Result<()> {
    let Ok(metadata) = fs::symlink_metadata(path) else { return Ok(()) };
    let removed = if metadata.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    removed.with_context(|| format!("{} could not be removed", path.display()))
}

/// Writes a file and makes its parent folders. The write is not atomic.
#[expect(clippy::disallowed_methods, reason = "what is half-written is written again at the next start")]
pub fn write(path: &Path, text: &str) -> Result<()> {
    create_parent(path)?;
    fs::write(path, text).with_context(|| format!("{} could not be written", path.display()))
}

/// Copies a file and makes the parent folders of the copy.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    create_parent(to)?;
    let copied = fs::copy(from, to).map(drop);
    copied.with_context(|| format!("{} could not be copied to {}", from.display(), to.display()))
}

/// The paths of all entries of a folder, sorted.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    let mut paths: Vec<PathBuf> =
        entries.with_context(|| format!("{} could not be listed", folder.display()))?;
    paths.sort();
    Ok(paths)
}

fn create_parent(path: &Path) -> Result<()> {
    path.parent().map_or(Ok(()), create_folder)
}
