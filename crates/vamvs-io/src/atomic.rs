//! Writes files atomically: into a temporary file in the target's folder, which is renamed once it is
//! complete. All files of vamvs are written through this module.
//!
//! If anything goes wrong (a folder that cannot be written, a full disk, an error of the caller), the
//! temporary file is removed and an existing file of the target's name is untouched. A killed process may
//! leave a file named `.vamvs-*`, but never a half-written target.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::NamedTempFile;

use crate::IoError;

/// The paths of this process's unfinished temporary files. Files are created and renamed while this lock is
/// held.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The prefix of temporary files' names.
pub const PREFIX: &str = ".vamvs-";

/// Writes the file `path`; `fill` writes its content.
///
/// # Errors
/// If the folder cannot be written, the disk is full or `fill` fails; then nothing has changed.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), IoError> {
    let mut file = AtomicFile::create(path)?;
    fill(&mut file).map_err(IoError::system("write", path))?;
    file.commit()
}

/// Refuses to replace a folder, or a file that is not of the kind that will be written: `is_same_kind` looks at its first
/// bytes. A file that is empty or cannot be read may be replaced.
///
/// # Errors
/// If there is such a file or folder.
pub fn expect_kind(path: &Path, is_same_kind: impl Fn(&[u8]) -> bool) -> Result<(), IoError> {
    if path.is_dir() {
        return Err(IoError::system("write", path)(io::ErrorKind::IsADirectory.into()));
    }
    let mut begin = Vec::new();
    let read = File::open(path).and_then(|file| file.take(4096).read_to_end(&mut begin));
    if read.is_err() || begin.is_empty() || is_same_kind(&begin) {
        return Ok(());
    }
    Err(IoError::Foreign { path: path.to_owned() })
}

/// Ends all writing, for a process that is about to exit: removes the unfinished files and prevents that
/// any more are created or completed. A thread that tries, or that drops an [`AtomicFile`], blocks for ever.
pub fn end() {
    let unfinished = unfinished();
    unfinished.iter().for_each(|path| drop(fs::remove_file(path)));
    std::mem::forget(unfinished);
}

fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file that appears under its name when it is committed. If it is dropped before, nothing remains of it.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    temporary: BufWriter<NamedTempFile>,
    listed: Listed,
}

/// A temporary file's entry in [`UNFINISHED`], removed on drop.
#[derive(Debug)]
struct Listed(PathBuf);

impl Drop for Listed {
    fn drop(&mut self) {
        unfinished().remove(&self.0);
    }
}

impl AtomicFile {
    /// Begins the file `path`; its folder must exist.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn create(path: &Path) -> Result<Self, IoError> {
        let mut unfinished = unfinished();
        let temporary = temporary_beside(path).map_err(IoError::system("write", path))?;
        unfinished.insert(temporary.path().to_owned());
        let listed = Listed(temporary.path().to_owned());
        Ok(Self { path: path.to_owned(), temporary: BufWriter::with_capacity(1 << 18, temporary), listed })
    }

    /// The path that the file will have.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Renames the complete temporary file to its final name.
    ///
    /// # Errors
    /// If the last bytes cannot be written or the file cannot be renamed; then nothing has changed.
    pub fn commit(self) -> Result<(), IoError> {
        let Self { path, temporary, listed } = self;
        let rename = |file: NamedTempFile| {
            let _lock = unfinished();
            file.persist(&path).map_err(|refused| refused.error)
        };
        let renamed = temporary.into_inner().map_err(io::IntoInnerError::into_error).and_then(rename);
        drop(listed);
        renamed.map(|_: File| ()).map_err(IoError::system("write", &path))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temporary.write(bytes)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.temporary.write_all(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temporary.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.temporary.seek(position)
    }
}

/// A temporary file in the folder of `path`, with the permissions of an ordinary new file.
fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        let problem = format!("there is no folder {}", folder.display());
        return Err(io::Error::new(io::ErrorKind::NotFound, problem));
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    let builder = builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_written_file_is_complete_and_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("naïve name.txt");
        write(&path, |out| out.write_all(b"one")).unwrap();
        write(&path, |out| out.write_all(b"two")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(names(folder.path()), ["naïve name.txt"]);
    }

    #[test]
    fn a_full_disk_leaves_the_old_file_and_no_temporary_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.pfm");
        write(&path, |out| out.write_all(b"old")).unwrap();
        let error = write(&path, |out| {
            out.write_all(&[0; 1 << 20])?;
            Err(io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert!(error.to_string().contains("depth.pfm"), "{error}");
        let IoError::System { source, .. } = error else { panic!("{error}") };
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["depth.pfm"]);
    }

    #[test]
    fn files_of_another_kind_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let expect = |name: &str| expect_kind(&folder.path().join(name), |begin| begin.starts_with(b"ply"));
        for (name, content) in [("own", "ply\nformat"), ("empty", ""), ("foreign", "plain text")] {
            write(&folder.path().join(name), |out| out.write_all(content.as_bytes())).unwrap();
        }
        assert!(["own", "empty", "absent"].into_iter().all(|name| expect(name).is_ok()));
        let error = expect("foreign").unwrap_err().to_string();
        assert!(error.contains("foreign: was not written by vamvs"), "{error}");
    }

    #[test]
    fn a_dropped_file_never_was() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = AtomicFile::create(&folder.path().join("cloud.ply")).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file_as_folder = folder.path().join("plain");
        fs::File::open(folder.path()).unwrap();
        write(&file_as_folder, |_| Ok(())).unwrap();
        for path in [file_as_folder.join("x.pfm"), folder.path().join("absent/x.pfm")] {
            let error = write(&path, |_| Ok(())).unwrap_err();
            assert!(error.to_string().contains("x.pfm"), "{error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_any_other_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write(&path, |_| Ok(())).unwrap();
        let plain = folder.path().join("b");
        fs::OpenOptions::new().write(true).create_new(true).open(&plain).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&plain));
    }
}
