//! The real scenes below a folder: their layouts, and what is known of those that this project is measured on.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use serde::Serialize;

use super::sky::SkyRule;

/// A real scene.
pub struct RealScene {
    /// The name of its folder.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// The layout of its files.
    pub layout: SceneLayout,
    /// What is known of it.
    pub known: Known,
}

/// The layout of a scene's files.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneLayout {
    /// A COLMAP model in this folder, and `images/`.
    Colmap(PathBuf),
    /// `cams/`, `images/` and perhaps `pair.txt`.
    Mvsnet,
    /// Photographs with cameras in Middlebury's `NAME_par.txt`.
    Middlebury,
    /// RGB-D frames of 7-Scenes.
    Frames,
}

/// What a scene is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Choices are made on it.
    Choose,
    /// It is measured once, at the end. Nothing is chosen on it, and no network is trained with it.
    Last,
}

/// What is known of a scene.
#[derive(Clone, Copy)]
pub struct Known {
    /// What it is used for.
    pub role: Role,
    /// Flags of `vamvs reconstruct` that it needs.
    pub flags: &'static [&'static str],
    /// How its sky is found in its photographs, if it has one.
    pub sky: Option<SkyRule>,
    /// Errors that count as small in it, as shares of the depth. Depth of an asteroid varies by a few per cent.
    pub thresholds: [f64; 5],
}

/// Shares of the depth for most scenes.
const THRESHOLDS: [f64; 5] = [0.001, 0.002, 0.005, 0.01, 0.02];

const LAST: Known = Known { role: Role::Last, flags: &[], sky: None, thresholds: THRESHOLDS };
const CHOOSE: Known = Known { role: Role::Choose, ..LAST };

/// The dinosaur's bounding box, from the benchmark's readme. The background is black.
const DINO: &[&str] = &[
    "--roi",
    "-0.061897",
    "-0.018874",
    "-0.057845",
    "0.010897",
    "0.068227",
    "0.015495",
    "--min-brightness",
    "20",
];

/// The depth range is the sensor's nominal one, metres. Estimated from the cameras alone, which rotate more than they
/// translate, it would be 1.3 to 20 m and miss near surfaces. Poses are inaccurate, so more views help. Planes are
/// uniform in depth, as in the paper.
const ROOM: &[&str] =
    &["--depth-range", "0.5", "4.5", "--views", "7", "--spacing", "depth", "--planes", "96"];

/// The scenes that are known, by the names of their folders. Others are only measured.
const KNOWN: [(&str, Known); 32] = [
    ("alexander", CHOOSE),
    ("baby3", LAST),
    ("banana", CHOOSE),
    ("boruszyn", Known { sky: Some(SkyRule { step: 6, least: 130, blue: -8 }), ..CHOOSE }),
    ("brighton", CHOOSE),
    ("buddha", CHOOSE),
    ("caliterra", CHOOSE),
    ("castle-p19", Known { sky: Some(SkyRule { step: 6, least: 130, blue: -8 }), ..CHOOSE }),
    ("copr", LAST),
    ("cyprus", Known { sky: Some(SkyRule { step: 6, least: 130, blue: -8 }), ..CHOOSE }),
    ("dino_sparse_ring", Known { flags: DINO, ..LAST }),
    ("dtu_scan37", CHOOSE),
    ("eth3d-terrace", LAST),
    ("fox", CHOOSE),
    ("gold-cape", LAST),
    ("herz_jesus_p8", CHOOSE),
    ("kermit", CHOOSE),
    ("kitchen", CHOOSE),
    ("lund-door", CHOOSE),
    ("middlebury-aloe", CHOOSE),
    ("middlebury-books", CHOOSE),
    ("middlebury-dolls", CHOOSE),
    ("middlebury-moebius", CHOOSE),
    ("middlebury-motorcycle", CHOOSE),
    ("middlebury-reindeer", CHOOSE),
    ("mobilebrick", CHOOSE),
    ("mug-board", CHOOSE),
    ("red_kitchen", Known { flags: ROOM, thresholds: [0.005, 0.01, 0.02, 0.05, 0.1], ..CHOOSE }),
    ("redkitchen", LAST),
    ("sacre-coeur", Known { sky: Some(SkyRule { step: 6, least: 130, blue: -8 }), ..LAST }),
    ("statue", LAST),
    ("vesta", Known { thresholds: [0.0002, 0.0005, 0.001, 0.002, 0.005], ..LAST }),
];

/// The scenes in a folder's subfolders, by name. Of those only with these names, if there are any.
pub fn find(folder: &Path, wanted: &[String]) -> Result<Vec<RealScene>> {
    let entries =
        std::fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let mut scenes: Vec<RealScene> = entries.flatten().filter_map(|entry| scene(&entry.path())).collect();
    scenes.sort_by(|a, b| a.name.cmp(&b.name));
    let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
    ensure!(
        !names.is_empty(),
        "{} has no subfolder with sparse/0 and images, cams and images, or a *_par.txt",
        folder.display()
    );
    for name in wanted {
        ensure!(
            names.contains(&name.as_str()),
            "there is no scene {name}: expected one of {}",
            names.join(", ")
        );
    }
    scenes.retain(|scene| wanted.is_empty() || wanted.contains(&scene.name));
    Ok(scenes)
}

fn scene(folder: &Path) -> Option<RealScene> {
    let layout = layout(folder)?;
    let name = folder.file_name()?.to_string_lossy().into_owned();
    let known = KNOWN.iter().find(|(known, _)| *known == name).map_or(LAST, |(_, known)| *known);
    Some(RealScene { name, folder: folder.to_owned(), layout, known })
}

fn layout(folder: &Path) -> Option<SceneLayout> {
    let is_dir = |name: &str| folder.join(name).is_dir();
    if is_dir("images") {
        let is_model =
            |model: &PathBuf| ["cameras.bin", "cameras.txt"].iter().any(|file| model.join(file).is_file());
        let models = ["sparse/0", "sparse"].map(|model| folder.join(model));
        if let Some(model) = models.into_iter().find(is_model) {
            return Some(SceneLayout::Colmap(model));
        }
        return is_dir("cams").then_some(SceneLayout::Mvsnet);
    }
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    let names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    if names.iter().any(|name| name.ends_with("_par.txt")) {
        return Some(SceneLayout::Middlebury);
    }
    names.iter().any(|name| name.ends_with(".pose.txt")).then_some(SceneLayout::Frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_are_told_apart_and_known_scenes_have_their_flags() {
        let folder = tempfile::tempdir().unwrap();
        let file = |path: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            crate::files::save(&path, "x").unwrap();
        };
        let of_scenes = [
            "a/images/1.png",
            "a/sparse/0/cameras.bin",
            "b/images/1.png",
            "b/cams/1_cam.txt",
            "c/images/1.png",
            "c/sparse/cameras.txt",
            "dino_sparse_ring/d_par.txt",
            "f/frame-1.pose.txt",
            "none/readme.md",
        ];
        of_scenes.iter().for_each(|path| file(path));
        let scenes = find(folder.path(), &[]).unwrap();
        let found: Vec<_> = scenes.iter().map(|scene| (scene.name.as_str(), scene.layout.clone())).collect();
        let model = |path: &str| SceneLayout::Colmap(folder.path().join(path));
        assert_eq!(found[0], ("a", model("a/sparse/0")));
        assert_eq!(found[1], ("b", SceneLayout::Mvsnet));
        assert_eq!(found[2], ("c", model("c/sparse")));
        assert_eq!(found[3], ("dino_sparse_ring", SceneLayout::Middlebury));
        assert_eq!(found[4], ("f", SceneLayout::Frames));
        assert_eq!(found.len(), 5);
        assert_eq!(scenes[3].known.flags, DINO);
        assert!(find(folder.path(), &["g".to_owned()]).is_err());
        assert!(KNOWN.is_sorted_by_key(|(name, _)| *name));
    }
}
