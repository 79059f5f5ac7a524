//! Scenes with true depth: where their files are, and what is known of their views.

mod layout;

use std::path::{Path, PathBuf};

use vamvs_core::{Pinhole, Pose, Source};

use crate::TrainError;

/// One view of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingView {
    /// The photograph.
    pub image: PathBuf,
    /// The true depth, PFM, of any size that shows the same as the photograph.
    pub depth: PathBuf,
    /// The visibility in all views of the scene (see [`vamvs_io::visibility`]), if there is one.
    pub visibility: Option<PathBuf>,
    /// The photograph's camera.
    pub camera: Pinhole,
    /// Its pose.
    pub cam_from_world: Pose,
}

/// A scene.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingScene {
    /// The folder's name, for messages.
    pub name: String,
    /// The views.
    pub views: Vec<TrainingView>,
    /// For each view those that overlap with it, best first; views without any are no references.
    pub sources: Vec<Vec<Source>>,
}

/// Scenes to train or to validate with.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// The scenes, in the order of their names.
    pub scenes: Vec<TrainingScene>,
}

impl Dataset {
    /// Finds the scenes in folders, each of which is one itself or holds some.
    ///
    /// # Errors
    /// If a folder holds no scene, none of its views overlap, or a scene's files are missing or malformed.
    pub fn open(folders: &[PathBuf]) -> Result<Self, TrainError> {
        let mut scenes = Vec::new();
        for folder in folders {
            let found = layout::scenes(folder)?;
            if found.is_empty() {
                let problem = "no scene with true depths in it".to_owned();
                return Err(TrainError::NoScenes { folder: folder.clone(), problem });
            }
            if found.iter().flat_map(|scene| &scene.sources).all(Vec::is_empty) {
                let problem =
                    "expected views that overlap (two at least, with sources in pair.txt), found none";
                return Err(TrainError::NoScenes { folder: folder.clone(), problem: problem.to_owned() });
            }
            scenes.extend(found);
        }
        Ok(Self { scenes })
    }

    /// All views with sources, as pairs of a scene's and a view's index.
    #[must_use]
    pub fn references(&self) -> Vec<(usize, usize)> {
        let of_scene = |(index, scene): (usize, &TrainingScene)| {
            let with_sources: Vec<_> =
                (0..scene.views.len()).filter(|&view| !scene.sources[view].is_empty()).collect();
            with_sources.into_iter().map(move |view| (index, view))
        };
        self.scenes.iter().enumerate().flat_map(of_scene).collect()
    }
}

/// A file that must be there.
fn required(path: PathBuf, what: &str, scene: &Path) -> Result<PathBuf, TrainError> {
    if path.is_file() {
        return Ok(path);
    }
    let problem = format!("the {what} {} is missing", path.display());
    Err(TrainError::NoScenes { folder: scene.to_owned(), problem })
}
