//! Lists the files of an asset folder.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use walkdir::{DirEntry, WalkDir};

use super::{AssetError, AssetFilter};

/// A kind of asset: its name in error messages, and the extensions of its files in lower case.
pub(super) struct Kind {
    pub name: &'static str,
    pub extensions: &'static [&'static str],
}

pub(super) const MESHES: Kind = Kind { name: "meshes (.obj)", extensions: &["obj"] };

pub(super) const TEXTURES: Kind = Kind {
    name: "pictures (.jpg, .png, .tif, .bmp, .webp)",
    extensions: &["jpg", "jpeg", "png", "tif", "tiff", "bmp", "webp"],
};

pub(super) const ENVIRONMENTS: Kind = Kind { name: "environments (.hdr, .exr)", extensions: &["hdr", "exr"] };

/// The files of `kind` in `folder` and its subfolders that `filter` admits, in the order of their paths. Every
/// file there, of any kind, goes into `hasher`: its path in the folder, whether it is used, and its length.
pub(super) fn scan(
    folder: &Path,
    kind: &Kind,
    filter: &AssetFilter,
    hasher: &mut blake3::Hasher,
) -> Result<Vec<PathBuf>, AssetError> {
    let refused = |source| AssetError::Folder { folder: folder.to_owned(), source };
    let mut all = 0;
    let mut files = Vec::new();
    for entry in WalkDir::new(folder).follow_links(true).sort_by_file_name() {
        let entry = entry.map_err(refused)?;
        if !entry.file_type().is_file() {
            continue;
        }
        all += 1;
        let name = entry.path().strip_prefix(folder).unwrap_or(entry.path()).to_owned();
        let length = entry.metadata().map_err(refused)?.len();
        let is_used = is_of(kind, &entry) && filter.admits(&name);
        hasher.update(name.as_os_str().as_encoded_bytes()).update(&[0, is_used.into()]);
        hasher.update(&length.to_le_bytes());
        if is_used {
            files.push(entry.into_path());
        }
    }
    if files.is_empty() {
        return Err(AssetError::Empty { folder: folder.to_owned(), expected: kind.name, found: all });
    }
    Ok(files)
}

fn is_of(kind: &Kind, entry: &DirEntry) -> bool {
    let extension = entry.path().extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
    extension.is_some_and(|extension| kind.extensions.contains(&extension.as_str()))
}

#[cfg(test)]
mod tests {
    use vamvs_io::atomic;

    use super::*;

    fn folder_with(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            atomic::write(&path, |_| Ok(())).unwrap();
        }
        folder
    }

    fn names(folder: &Path, kind: &Kind, filter: &AssetFilter) -> Result<Vec<String>, AssetError> {
        let files = scan(folder, kind, filter, &mut blake3::Hasher::new())?;
        Ok(files.iter().map(|f| f.strip_prefix(folder).unwrap().to_str().unwrap().to_owned()).collect())
    }

    #[test]
    fn files_are_found_in_order_and_by_kind() {
        let folder = folder_with(&["b/textured.OBJ", "a/textured.obj", "a/textured.mtl", "c.png", "d.hdr"]);
        let all = AssetFilter::default();
        let found = |kind| names(folder.path(), kind, &all).unwrap();
        assert_eq!(found(&MESHES), ["a/textured.obj", "b/textured.OBJ"]);
        assert_eq!(found(&TEXTURES), ["c.png"]);
        assert_eq!(found(&ENVIRONMENTS), ["d.hdr"]);
        let not_a = AssetFilter::new(&[], &["a"]).unwrap();
        assert_eq!(names(folder.path(), &MESHES, &not_a).unwrap(), ["b/textured.OBJ"]);
    }

    #[test]
    fn folders_without_use_are_refused() {
        let folder = folder_with(&["a.png", "b.png"]);
        let message = names(folder.path(), &MESHES, &AssetFilter::default()).unwrap_err().to_string();
        assert!(message.contains("meshes (.obj)") && message.contains("2 files"), "{message}");
        let none = AssetFilter::new(&["x*"], &[]).unwrap();
        assert!(matches!(names(folder.path(), &TEXTURES, &none), Err(AssetError::Empty { .. })));
        let missing =
            scan(Path::new("no/such"), &MESHES, &AssetFilter::default(), &mut blake3::Hasher::new());
        assert!(missing.unwrap_err().to_string().contains("no/such"));
    }

    #[test]
    fn the_hash_knows_names_and_lengths() {
        let hash = |names: &[&str]| {
            let mut hasher = blake3::Hasher::new();
            scan(folder_with(names).path(), &TEXTURES, &AssetFilter::default(), &mut hasher).unwrap();
            hasher.finalize()
        };
        assert_eq!(hash(&["a.png"]), hash(&["a.png"]));
        assert_ne!(hash(&["a.png"]), hash(&["b.png"]));
        assert_ne!(hash(&["a.png"]), hash(&["a.png", "a.txt"]));
    }
}
