//! Verifies wheels and unpacks parts of them.

use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use sha2::{Digest, Sha256};
use zip::ZipArchive;

/// Whether a file exists and its SHA-256 is `expected`, lower-case hexadecimal.
pub fn has_sha256(file: &Path, expected: &str) -> Result<bool> {
    if !file.exists() {
        return Ok(false);
    }
    let mut hash = Sha256::new();
    let read = File::open(file).and_then(|file| io::copy(&mut BufReader::new(file), &mut hash));
    read.with_context(|| format!("{} cannot be read", file.display()))?;
    Ok(format!("{:x}", hash.finalize()) == expected)
}

/// Unpacks parts of a zip file into a folder. A part is a pair: a file in the archive, or a folder with a final `/`,
/// and its path in the folder. Fails if the archive lacks a part.
pub fn unpack(archive: &Path, parts: &[(&str, &str)], folder: &Path) -> Result<()> {
    let file = File::open(archive).with_context(|| format!("{} cannot be opened", archive.display()))?;
    let mut zip = ZipArchive::new(BufReader::new(file))
        .with_context(|| format!("{} is not a zip file", archive.display()))?;
    let mut found = vec![false; parts.len()];
    for index in 0..zip.len() {
        let mut entry = zip.by_index(index).with_context(|| format!("in {}", archive.display()))?;
        let Some((part, target)) = destination(entry.name(), parts) else { continue };
        found[part] = true;
        let target = folder.join(target);
        write(&mut entry, &target).with_context(|| {
            format!("{} could not be written (the set-up needs 1.2 GB of disk)", target.display())
        })?;
    }
    let missing: Vec<_> =
        parts.iter().zip(found).filter(|(_, found)| !found).map(|((part, _), _)| *part).collect();
    ensure!(missing.is_empty(), "{} lacks {}", archive.display(), missing.join(", "));
    Ok(())
}

/// The number of the part to which an entry of the archive belongs, and the entry's path in the folder; `None` if it
/// belongs to no part, is a folder, or has `..` in its path.
fn destination(entry: &str, parts: &[(&str, &str)]) -> Option<(usize, PathBuf)> {
    if entry.ends_with('/') || entry.split('/').any(|name| name == "..") {
        return None;
    }
    parts.iter().enumerate().find_map(|(index, (from, to))| {
        let rest = entry.strip_prefix(from)?;
        let wanted = rest.is_empty() || from.ends_with('/');
        wanted.then(|| (index, PathBuf::from(format!("{to}{rest}"))))
    })
}

#[expect(clippy::disallowed_methods, reason = "the whole folder is renamed once it is complete")]
fn write(entry: &mut impl io::Read, target: &Path) -> io::Result<()> {
    if let Some(parent) = target.parent() {
        fs::create_dir_all(parent)?;
    }
    io::copy(entry, &mut File::create(target)?)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use zip::{ZipWriter, write::SimpleFileOptions};

    use super::*;

    fn archive(folder: &Path) -> PathBuf {
        let path = folder.join("some.whl");
        let mut zip = ZipWriter::new(tempfile::tempfile().unwrap());
        for name in
            ["a/include/x.h", "a/include/deep/y.h", "a/lib/z.so", "a/lib/z.so.1", "../evil", "a/include/../w"]
        {
            zip.start_file(name, SimpleFileOptions::default()).unwrap();
            zip.write_all(name.as_bytes()).unwrap();
        }
        let mut file = zip.finish().unwrap();
        io::Seek::rewind(&mut file).unwrap();
        write(&mut file, &path).unwrap();
        path
    }

    #[test]
    fn the_wanted_parts_and_nothing_else_are_unpacked() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let parts = [("a/include/", "include/"), ("a/lib/z.so", "lib/z.so"), ("../", "up/")];
        unpack(&archive(folder.path()), &parts[..2], &out).unwrap();
        assert_eq!(fs::read_to_string(out.join("include/deep/y.h")).unwrap(), "a/include/deep/y.h");
        assert_eq!(fs::read_to_string(out.join("lib/z.so")).unwrap(), "a/lib/z.so");
        assert!(
            out.join("include/x.h").exists() && !out.join("lib/z.so.1").exists() && !out.join("w").exists()
        );
        let error = unpack(&archive(folder.path()), &parts, &out).unwrap_err().to_string();
        assert!(error.ends_with("lacks ../"), "{error}");
    }

    #[test]
    fn a_file_is_known_by_its_hash() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("abc");
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert!(!has_sha256(&file, abc).unwrap(), "no file");
        write(&mut "abc".as_bytes(), &file).unwrap();
        assert!(has_sha256(&file, abc).unwrap());
        write(&mut "abd".as_bytes(), &file).unwrap();
        assert!(!has_sha256(&file, abc).unwrap());
    }
}
