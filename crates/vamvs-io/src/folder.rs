//! Lists the images of a folder and compares them with those that a scene's files name.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::{Component, Path};

use crate::image::EXTENSIONS;
use crate::{IoError, names};

/// How many missing images an error message names.
const NAMED: usize = 5;

/// The names of all images in `folder` and its subfolders, relative to it, with `/` between folders.
///
/// Symbolic links to files are followed, those to folders are not. Files whose names are not UTF-8
/// are left out, because no scene can name them.
pub(crate) fn images(folder: &Path) -> Result<BTreeSet<String>, IoError> {
    let mut names = BTreeSet::new();
    collect(folder, "", &mut names)?;
    Ok(names)
}

fn collect(folder: &Path, prefix: &str, names: &mut BTreeSet<String>) -> Result<(), IoError> {
    for entry in fs::read_dir(folder).map_err(IoError::system("list", folder))? {
        let entry = entry.map_err(IoError::system("list", folder))?;
        let Ok(name) = entry.file_name().into_string() else { continue };
        let name = format!("{prefix}{name}");
        if entry.file_type().map_err(IoError::system("inspect", &entry.path()))?.is_dir() {
            collect(&entry.path(), &format!("{name}/"), names)?;
        } else if is_image(Path::new(&name)) {
            names.insert(name);
        }
    }
    Ok(())
}

fn is_image(path: &Path) -> bool {
    let extension = path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
    extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str()))
}

/// A warning that some of `names` are not files in `folder`; fails if it is not a folder or half of them are not.
pub(crate) fn warn_of_missing(folder: &Path, names: &[&str]) -> Result<Option<String>, IoError> {
    fs::metadata(folder).map_err(IoError::system("open the folder of photographs", folder))?;
    let missing: Vec<&str> = names.iter().copied().filter(|name| !folder.join(name).is_file()).collect();
    warn_of_those_missing(folder, &missing, names.len())
}

/// A warning that of `all` images those called `missing` are not in `folder`; fails if these are half of all.
pub(crate) fn warn_of_those_missing(
    folder: &Path,
    missing: &[&str],
    all: usize,
) -> Result<Option<String>, IoError> {
    let Some(first) = missing.first() else { return Ok(None) };
    if 2 * missing.len() >= all {
        missing_images(folder, missing)?;
    }
    Ok(Some(format!(
        "{}: {} of the scene's {all} photographs are missing, and their views are left out ({}{})",
        folder.display(),
        missing.len(),
        names::shown(first),
        and_more(missing.len())
    )))
}

/// What follows the first of `count` names in a message.
fn and_more(count: usize) -> &'static str {
    if count > 1 { ", …" } else { "" }
}

/// Fails if there are `missing` images; the error names the first few of them.
fn missing_images(folder: &Path, missing: &[&str]) -> Result<(), IoError> {
    if missing.is_empty() {
        return Ok(());
    }
    let first = missing.iter().take(NAMED).map(|&name| name.to_owned()).collect();
    Err(IoError::MissingImages { folder: folder.to_owned(), count: missing.len(), first })
}

/// A warning about the images in `found` that the scene does not use, if there are any.
pub(crate) fn warn_of_unused<'a>(
    found: &BTreeSet<String>,
    used: impl Iterator<Item = &'a str>,
) -> Option<String> {
    let used: BTreeSet<&str> = used.collect();
    let unused: Vec<&String> = found.iter().filter(|name| !used.contains(name.as_str())).collect();
    let first = unused.first()?;
    let more = and_more(unused.len());
    Some(format!("{} photographs have no camera and are not used ({first}{more})", unused.len()))
}

/// Whether `name` is a relative path that stays inside its folder.
pub(crate) fn is_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_leave_the_folder_are_told_apart() {
        assert!(is_inside("a b/ü.jpg"));
        for name in ["", "/etc/passwd", "../a.jpg", "a/../../b.jpg"] {
            assert!(!is_inside(name), "{name}");
        }
    }

    #[test]
    fn subfolders_are_searched_and_other_files_left_out() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("left")).unwrap();
        for name in ["b.JPG", "left/a é.png", "notes.txt", "jpg"] {
            crate::atomic::write(&folder.path().join(name), |_| Ok(())).unwrap();
        }
        let found = images(folder.path()).unwrap();
        assert_eq!(found.iter().map(String::as_str).collect::<Vec<_>>(), ["b.JPG", "left/a é.png"]);
        assert_eq!(warn_of_unused(&found, ["b.JPG", "left/a é.png"].into_iter()), None);
        assert!(
            warn_of_unused(&found, ["b.JPG"].into_iter())
                .unwrap()
                .contains("1 photographs have no camera and are not used (left/a é.png)")
        );
    }

    #[test]
    fn few_missing_images_are_a_warning_and_half_of_them_an_error() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "b.png"] {
            crate::atomic::write(&folder.path().join(name), |_| Ok(())).unwrap();
        }
        let missing = |names: &[&str]| warn_of_missing(folder.path(), names);
        assert_eq!(missing(&["a.png", "b.png"]).unwrap(), None);
        assert!(
            missing(&["a.png", "c.png", "b.png"])
                .unwrap()
                .unwrap()
                .contains("1 of the scene's 3 photographs")
        );
        assert!(missing(&["b.png", "c.png"]).unwrap_err().to_string().contains("c.png"));
        assert!(
            warn_of_missing(&folder.path().join("d"), &["a.png"]).unwrap_err().to_string().contains("folder")
        );
    }
}
