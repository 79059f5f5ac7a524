//! Where a model and its photographs are: COLMAP's mapper puts models into `sparse/0`, `sparse/1`, …, its undistorter one
//! into `sparse`, beside the folder `images`.

use std::path::{Path, PathBuf};

use crate::{IoError, Place};

/// The folder of a model's files: `folder`, or in the workspace `folder` the one in `sparse` or in a numbered folder there.
///
/// # Errors
/// If there is none or several.
pub fn model(folder: &Path) -> Result<PathBuf, IoError> {
    if !folder.exists() {
        let problem = "there is no such folder: expected that of a COLMAP model";
        return Err(IoError::malformed(folder, Place::Whole, problem));
    }
    let sparse = folder.join("sparse");
    if let Some(found) = [folder, &sparse].into_iter().find(|place| has_model(place)) {
        return Ok(found.to_owned());
    }
    let mut found: Vec<PathBuf> = [folder, &sparse].into_iter().flat_map(numbered).collect();
    let problem = match found.len() {
        0 => "expected a COLMAP model with cameras.bin or cameras.txt, here, in sparse or in sparse/0, found none".into(),
        1 => return Ok(found.remove(0)),
        count => {
            found.sort();
            let name = |model: &PathBuf| model.display().to_string();
            let names: Vec<String> = found.iter().map(name).collect();
            format!("expected one COLMAP model, found {count}; give the folder of one: {}", names.join(", "))
        }
    };
    Err(IoError::malformed(folder, Place::Whole, problem))
}

/// The folder `images` of the workspace of the model in `model`: there, or up to two folders above.
///
/// # Errors
/// If there is none.
pub fn images(model: &Path) -> Result<PathBuf, IoError> {
    let places = model.ancestors().take(3).map(|folder| folder.join("images"));
    places.into_iter().find(|place| place.is_dir()).ok_or_else(|| {
        let problem =
            "expected the photographs in images, in this folder or up to two above, found no such folder: give their folder with --images";
        IoError::malformed(model, Place::Whole, problem)
    })
}

fn has_model(folder: &Path) -> bool {
    ["cameras.bin", "cameras.txt"].iter().any(|file| folder.join(file).is_file())
}

/// The folders named by a number that hold a model.
fn numbered(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = folder.read_dir() else { return Vec::new() };
    let is_number = |path: &PathBuf| {
        path.file_name().and_then(|name| name.to_str()).is_some_and(|name| name.parse::<u32>().is_ok())
    };
    entries.flatten().map(|entry| entry.path()).filter(is_number).filter(|path| has_model(path)).collect()
}
