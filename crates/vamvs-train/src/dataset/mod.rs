//! Scenes with ground-truth depth: their files, cameras and source views.

mod layout;

use std::path::{Path, PathBuf};

use vamvs_core::{Pinhole, Pose, Source};

use crate::TrainError;

/// One view of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingView {
    /// The photograph.
    pub image: PathBuf,
    /// The ground-truth depth, a PFM file. It may have another size than the photograph, but has its field of view.
    pub depth: PathBuf,
    /// Whether pixels without depth show no surface, as in synthetic scenes; else what they show is unknown.
    pub is_complete: bool,
    /// The visibility in all views of the scene (see [`vamvs_io::visibility`]), if the scene has it.
    pub visibility: Option<PathBuf>,
    /// The photograph's camera.
    pub camera: Pinhole,
    /// The camera's pose.
    pub cam_from_world: Pose,
}

/// A scene with ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingScene {
    /// The folder's name, for messages.
    pub name: String,
    /// The views.
    pub views: Vec<TrainingView>,
    /// For each view, its source views, best first. A view without source views is not used as a reference view.
    pub sources: Vec<Vec<Source>>,
}

/// Scenes for training or validation.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// The scenes: folder by folder, and within a folder by name.
    pub scenes: Vec<TrainingScene>,
}

impl Dataset {
    /// Finds the scenes in folders. Each folder is a scene or contains scenes.
    ///
    /// # Errors
    /// If a folder contains no scene, none of its views has source views, or a scene's files are missing or malformed.
    pub fn open(folders: &[PathBuf]) -> Result<Self, TrainError> {
        let mut scenes = Vec::new();
        for folder in folders {
            let found = layout::scenes(folder)?;
            if found.is_empty() {
                let problem = "no scene with ground-truth depths in it".to_owned();
                return Err(TrainError::NoScenes { folder: folder.clone(), problem });
            }
            if found.iter().flat_map(|scene| &scene.sources).all(Vec::is_empty) {
                let problem =
                    "expected at least two overlapping views (with source views in pair.txt), found none";
                return Err(TrainError::NoScenes { folder: folder.clone(), problem: problem.to_owned() });
            }
            scenes.extend(found);
        }
        Ok(Self { scenes })
    }

    /// All views that have source views, as pairs (index of the scene, index of the view).
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

/// The path of a file, or an error if it does not exist.
fn required(path: PathBuf, what: &str, scene: &Path) -> Result<PathBuf, TrainError> {
    if path.is_file() {
        return Ok(path);
    }
    let problem = format!("the {what} {} is missing", path.display());
    Err(TrainError::NoScenes { folder: scene.to_owned(), problem })
}
