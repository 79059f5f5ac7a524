//! Masks of photographs: black (0) pixels are ignored, all others are used.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use vamvs_core::{Grid, Size};

use crate::image::EXTENSIONS;
use crate::{IoError, image};

/// Where the masks of a scene's photographs are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Masks {
    /// There are no masks.
    #[default]
    None,
    /// In a folder, under the photographs' names (see [`find`]).
    Folder(PathBuf),
    /// The mask files that the scene's files name, by the photographs' names.
    Files(BTreeMap<String, PathBuf>),
}

impl Masks {
    /// The folder `masks` beside the folder of photographs, if there is one.
    #[must_use]
    pub fn next_to(images: &Path) -> Self {
        // Folders such as `.` have no name in their paths.
        let named = images.file_name().is_none().then(|| images.canonicalize().ok()).flatten();
        let images = named.as_deref().unwrap_or(images);
        let folder = images.with_file_name("masks");
        if folder.is_dir() && folder != images { Self::Folder(folder) } else { Self::None }
    }

    /// The mask file of the photograph `name`, if there is one.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<PathBuf> {
        match self {
            Self::None => None,
            Self::Folder(folder) => find(folder, name),
            Self::Files(files) => files.get(name).cloned(),
        }
    }
}

/// The mask file in `folder` of the photograph `name`, if there is one: the first that exists of
/// `NAME.EXT.png` (COLMAP's naming), `NAME.png`, `NAME_mask.png` and `NAME.mask.png`, also as JPEG, TIFF, BMP or WebP and in upper case; and, for a
/// photograph in a subfolder, the same without the subfolder.
#[must_use]
pub fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let stem = Path::new(name).with_extension("");
    let (stem, last) = (stem.to_str()?, stem.file_name()?.to_str()?);
    let stems = [name, stem, last].into_iter().map(str::to_owned);
    let marked = [stem, last].into_iter().flat_map(|stem| [format!("{stem}_mask"), format!("{stem}.mask")]);
    let with_extension = |stem: &str, extension: &str| folder.join(format!("{stem}.{extension}"));
    let all: Vec<String> = stems.chain(marked).collect();
    // Masks are PNGs nearly always, and the folder may be on a slow disk.
    let kinds = ["png", "PNG"].into_iter().map(str::to_owned);
    let others = EXTENSIONS.iter().filter(|extension| **extension != "png");
    let kinds = kinds.chain(others.flat_map(|extension| [(*extension).to_owned(), extension.to_uppercase()]));
    kinds
        .flat_map(|extension| all.iter().map(move |stem| (stem, extension.clone())))
        .map(|(stem, extension)| with_extension(stem, &extension))
        .find(|path| path.is_file())
}

/// Loads the mask of a photograph of `size`; `true` where pixels are used.
///
/// A mask of another size with the same aspect ratio (within 1 %) is resized by nearest neighbour.
///
/// # Errors
/// If the file cannot be decoded or has another aspect ratio.
pub fn load(path: &Path, size: Size) -> Result<Grid<bool>, IoError> {
    let image = image::decode(path)?;
    let found = image::size_of(&image);
    if !image::aspect_agrees(found, size) {
        return Err(IoError::SizeMismatch {
            path: path.to_owned(),
            image: found,
            of: "photograph",
            expected: size,
        });
    }
    let counts = image.into_rgb16().pixels().map(|pixel| pixel.0 != [0; 3]).collect();
    let mask = Grid::from_vec(found, counts);
    Ok(if found == size { mask } else { mask.resized_nearest(size) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(folder: &Path, name: &str, image: &Grid<u16>) -> PathBuf {
        let path = folder.join(name);
        image::save_png_gray16(&path, image).unwrap();
        path
    }

    #[test]
    fn the_most_specific_name_wins() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let one = Grid::filled(Size::new(1, 1), 1);
        assert_eq!(find(folder, "left/a b.jpg"), None);
        std::fs::create_dir(folder.join("left")).unwrap();
        for name in ["a b.png", "left/a b.png", "left/a b.jpg.png"] {
            let path = grey(folder, name, &one);
            assert_eq!(find(folder, "left/a b.jpg"), Some(path));
        }
    }

    #[test]
    fn usual_names_of_masks_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["v0.jpg", "v1_mask.png", "v2.mask.png", "v3.PNG", "v4_mask.TIFF"] {
            crate::atomic::write(&path(name), |_| Ok(())).unwrap();
            let view = format!("{}.png", &name[..2]);
            assert_eq!(find(folder.path(), &view), Some(path(name)), "{view}");
            assert_eq!(find(folder.path(), &format!("left/{view}")), Some(path(name)), "{view}");
        }
        assert_eq!(find(folder.path(), "v5.png"), None);
    }

    #[test]
    fn a_folder_of_masks_beside_the_photographs_is_found() {
        let scene = tempfile::tempdir().unwrap();
        let images = scene.path().join("images");
        assert_eq!(Masks::next_to(&images), Masks::None);
        let folder = scene.path().join("masks");
        std::fs::create_dir(&folder).unwrap();
        assert_eq!(Masks::next_to(&images), Masks::Folder(folder.clone()));
        assert_eq!(Masks::next_to(&folder), Masks::None);
        let path = grey(&folder, "a.png", &Grid::filled(Size::new(1, 1), 1));
        assert_eq!(Masks::next_to(&images).find("a.jpg"), Some(path.clone()));
        let files = Masks::Files([("b.jpg".to_owned(), path.clone())].into());
        assert_eq!((files.find("a.jpg"), files.find("b.jpg")), (None, Some(path)));
    }

    #[test]
    fn only_zero_is_ignored_and_halves_are_enlarged() {
        let folder = tempfile::tempdir().unwrap();
        let path = grey(folder.path(), "m.png", &Grid::from_vec(Size::new(2, 1), vec![0, 1]));
        assert_eq!(load(&path, Size::new(2, 1)).unwrap().data(), [false, true]);
        assert_eq!(load(&path, Size::new(4, 2)).unwrap().row(1), [false, false, true, true]);
        let error = load(&path, Size::new(2, 2)).unwrap_err().to_string();
        assert!(error.contains("2×1") && error.contains("2×2"), "{error}");
    }
}
