//! The mark of folders that vamvs writes to, so that it never overwrites files that are not its own, and that only one run
//! at a time writes to a folder.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use vamvs_io::IoError;

use super::files::make_folder;
use crate::VamvsError;

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
        return Err(IoError::Foreign { path }.into());
    }
    make_folder(folder)?;
    make_mark(&folder.join(MARK))
}

/// Makes the mark unless it is there: another run may have made it, and may hold a lock on it, since it was looked for.
fn make_mark(mark: &Path) -> Result<(), VamvsError> {
    let written = match File::options().write(true).create_new(true).open(mark) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        made => made.and_then(|mut mark| writeln!(mark, "{TEXT}")),
    };
    let failed = |source| IoError::System { action: "write", path: mark.to_owned(), source };
    Ok(written.map_err(failed)?)
}

/// Whether vamvs has marked the folder.
pub(crate) fn is_claimed(folder: &Path) -> bool {
    folder.join(MARK).is_file()
}

/// Keeps other processes from writing to a marked folder. The system gives it back however the process ends. Where the file
/// system knows no locks, it keeps nobody from anything.
pub(crate) struct Lock(#[expect(dead_code, reason = "holds the lock until it is closed")] Option<File>);

impl Lock {
    /// For a run that must have the folder for itself.
    pub fn alone(folder: &Path) -> Result<Self, VamvsError> {
        Self::of(folder, File::try_lock)
    }

    /// For one of several tasks that share the folder.
    pub fn shared(folder: &Path) -> Result<Self, VamvsError> {
        Self::of(folder, File::try_lock_shared)
    }

    fn of(folder: &Path, lock: fn(&File) -> Result<(), TryLockError>) -> Result<Self, VamvsError> {
        // Network file systems want a file that can be written, for a lock of one process alone.
        let mark = File::options().read(true).write(true).open(folder.join(MARK));
        let Ok(mark) = mark else { return Ok(Self(None)) };
        match lock(&mark) {
            Ok(()) => Ok(Self(Some(mark))),
            Err(TryLockError::Error(_)) => Ok(Self(None)),
            Err(TryLockError::WouldBlock) => {
                let problem =
                    "another run of vamvs writes to this folder: wait for it, or choose another --out";
                Err(VamvsError::Folder { path: folder.to_owned(), problem: problem.to_owned() })
            }
        }
    }
}

/// Removes the folder if it has nothing but its mark.
pub(crate) fn release(folder: &Path) {
    let is_mark = |entry: std::fs::DirEntry| entry.file_name() == MARK;
    if folder.read_dir().is_ok_and(|entries| entries.flatten().all(is_mark)) {
        std::fs::remove_file(folder.join(MARK)).ok();
        std::fs::remove_dir(folder).ok();
    }
}
