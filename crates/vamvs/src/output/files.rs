//! Files and folders that vamvs writes, whatever is in them.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use vamvs_io::{IoError, atomic};

use crate::VamvsError;

/// Writes a value as JSON, whole or not at all.
///
/// # Errors
/// If the file cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), VamvsError> {
    let text = serde_json::to_string_pretty(value).map_err(|error| {
        VamvsError::Request(format!("{}: cannot be written as JSON: {error}", path.display()))
    })?;
    Ok(atomic::write(path, |out| writeln!(out, "{text}"))?)
}

/// Reads a value from JSON.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, VamvsError> {
    let folder = |problem: String| VamvsError::Folder { path: path.to_owned(), problem };
    let text = std::fs::read_to_string(path).map_err(|error| folder(format!("cannot be read: {error}")))?;
    serde_json::from_str(&text).map_err(|error| folder(format!("is not what vamvs wrote: {error}")))
}

/// The folder that a file is in, `.` for a bare name.
#[must_use]
pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether both paths exist and lead to the same file or folder.
#[must_use]
pub fn is_same(a: &Path, b: &Path) -> bool {
    a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
}

/// Makes a folder and those that it is in.
pub(crate) fn make_folder(folder: &Path) -> Result<(), IoError> {
    let failed = |source| IoError::System { action: "make the folder", path: folder.to_owned(), source };
    std::fs::create_dir_all(folder).map_err(failed)
}

/// Removes the unfinished files of a killed run.
pub(crate) fn remove_unfinished(folder: &Path) -> Result<(), VamvsError> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let unfinished = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(atomic::PREFIX));
    unfinished.into_iter().try_for_each(|entry| remove(&entry.path()))
}

/// Removes a file if it is there.
pub(crate) fn remove(path: &Path) -> Result<(), VamvsError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(IoError::System { action: "remove", path: path.to_owned(), source }.into())
        }
        _ => Ok(()),
    }
}
