//! The mark of folders that vamvs writes to, so that it never overwrites files that are not its own.

use std::path::{Path, PathBuf};

use vamvs_io::atomic;

use crate::VamvsError;
use crate::output::make_folder;

/// The file that marks a folder.
const MARK: &str = ".vamvs";

const TEXT: &str = "vamvs writes to this folder and may replace its files.";

/// Makes `folder` if need be and marks it as vamvs's own, before `files` in it are written.
///
/// # Errors
/// If the folder is not marked and one of the files exists, or it cannot be made.
pub(crate) fn claim(folder: &Path, files: impl IntoIterator<Item = PathBuf>) -> Result<(), VamvsError> {
    if is_claimed(folder) {
        return Ok(());
    }
    if let Some(path) = files.into_iter().find(|file| file.symlink_metadata().is_ok()) {
        let problem =
            "was not written by vamvs and would be overwritten: choose another --out, or move it away";
        return Err(VamvsError::Folder { path, problem: problem.to_owned() });
    }
    make_folder(folder)?;
    Ok(atomic::write(&folder.join(MARK), |out| writeln!(out, "{TEXT}"))?)
}

/// Whether vamvs has marked the folder.
pub(crate) fn is_claimed(folder: &Path) -> bool {
    folder.join(MARK).is_file()
}

/// Removes the folder if it has nothing but its mark.
pub(crate) fn release(folder: &Path) {
    let is_mark = |entry: std::fs::DirEntry| entry.file_name() == MARK;
    if folder.read_dir().is_ok_and(|entries| entries.flatten().all(is_mark)) {
        std::fs::remove_file(folder.join(MARK)).ok();
        std::fs::remove_dir(folder).ok();
    }
}
