//! The supported layouts of scenes with ground-truth depth.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use vamvs_core::{Pinhole, Scene, view_selection};
use vamvs_io::{IoError, image, mvsnet};

use super::{TrainingScene, TrainingView, required};
use crate::TrainError;

/// The most source views kept for each reference view.
const SOURCES: usize = 10;

/// The folders of images and depths in a scene's folder.
const SCENES: [(&str, &str); 2] = [
    ("images", "depths"),                      // `vamvs synth`
    ("blended_images", "rendered_depth_maps"), // BlendedMVS
];

/// In DTU's training set each view was taken in 7 lights, and the cameras are those of images at 1/4.
const DTU_LIGHTS: usize = 7;
const DTU_CAMERA_SCALE: f64 = 4.0;

/// The scene in `folder` itself, or the scenes in its subfolders.
pub fn scenes(folder: &Path) -> Result<Vec<TrainingScene>, TrainError> {
    if let Some(scene) = scene(folder)? {
        return Ok(vec![scene]);
    }
    if folder.join("Cameras/train").is_dir() {
        return dtu(folder);
    }
    let found = subfolders(folder)?.iter().map(|folder| scene(folder)).collect::<Result<Vec<_>, _>>()?;
    Ok(found.into_iter().flatten().collect())
}

/// The subfolders of a folder, sorted by name.
fn subfolders(folder: &Path) -> Result<Vec<PathBuf>, TrainError> {
    let system = |source| TrainError::Io(IoError::System { action: "list", path: folder.to_owned(), source });
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(system)? {
        let path = entry.map_err(system)?.path();
        if path.is_dir() {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads the folder as one scene; `None` if it does not have the folders of a scene.
fn scene(folder: &Path) -> Result<Option<TrainingScene>, TrainError> {
    let is_scene = |(images, depths): &&(&str, &str)| {
        folder.join(images).is_dir() && folder.join(depths).is_dir() && folder.join("cams").is_dir()
    };
    let Some((images, depths)) = SCENES.iter().find(is_scene) else { return Ok(None) };
    let (images, depths) = (folder.join(images), folder.join(depths));
    let loaded = mvsnet::read_scene(&folder.join("cams"), &images, None, &mvsnet::Options::default())?;
    let is_complete = folder.join("scene.json").is_file(); // that of `vamvs synth`
    let files = |name: &str| {
        let stem = Path::new(name).with_extension("");
        let visibility = folder.join("visibility").join(stem.with_extension("png"));
        let depth = required(depths.join(stem.with_extension("pfm")), "depth map", folder)?;
        Ok((images.join(name), depth, visibility.is_file().then_some(visibility)))
    };
    training_scene(folder, &loaded.scene, is_complete, files).map(Some)
}

/// A training scene from views and the files of each: image, depth, visibility.
fn training_scene(
    folder: &Path,
    scene: &Scene,
    is_complete: bool,
    files: impl Fn(&str) -> Result<(PathBuf, PathBuf, Option<PathBuf>), TrainError>,
) -> Result<TrainingScene, TrainError> {
    let pinholes: Vec<_> = scene
        .views
        .iter()
        .map(|view| Pinhole { size: view.camera.size, intrinsics: view.camera.intrinsics })
        .collect();
    let views = scene.views.iter().zip(&pinholes).map(|(view, &camera)| {
        let (image, depth, visibility) = files(&view.name)?;
        Ok(TrainingView {
            image,
            depth,
            is_complete,
            visibility,
            camera,
            cam_from_world: view.cam_from_world,
        })
    });
    Ok(TrainingScene {
        name: folder.file_name().and_then(OsStr::to_str).unwrap_or("scene").to_owned(),
        views: views.collect::<Result<_, TrainError>>()?,
        sources: view_selection::select(scene, &pinholes, SOURCES),
    })
}

/// DTU's training set as prepared by MVSNet's authors. Each scan in each light is a scene. The files are
/// `Cameras/train/0000000N_cam.txt`, `Cameras/pair.txt`, `Rectified/scanS_train/rect_NNN_L_r5000.png` with N counted
/// from 1, and `Depths/scanS_train/depth_map_000N.pfm` with N counted from 0.
fn dtu(folder: &Path) -> Result<Vec<TrainingScene>, TrainError> {
    let mut found = Vec::new();
    for scan in subfolders(&folder.join("Rectified"))? {
        for light in 0..DTU_LIGHTS {
            found.push(dtu_scene(folder, &scan, light)?);
        }
    }
    Ok(found)
}

fn dtu_scene(folder: &Path, scan: &Path, light: usize) -> Result<TrainingScene, TrainError> {
    let cameras = folder.join("Cameras/train");
    let name = scan.file_name().unwrap_or_default();
    let mut views = Vec::new();
    for index in 0.. {
        let cam = cameras.join(format!("{index:08}_cam.txt"));
        if !cam.is_file() {
            break;
        }
        let cam = mvsnet::read_cam(&cam, &mvsnet::Options::default())?;
        let image = scan.join(format!("rect_{:03}_{light}_r5000.png", index + 1));
        let image = required(image, "photograph", folder)?;
        let depth = folder.join("Depths").join(name).join(format!("depth_map_{index:04}.pfm"));
        let intrinsics = cam.intrinsics.scaled(DTU_CAMERA_SCALE, DTU_CAMERA_SCALE);
        views.push(TrainingView {
            camera: Pinhole { size: image::stored_size(&image)?, intrinsics },
            image,
            depth: required(depth, "depth map", folder)?,
            is_complete: false,
            visibility: None,
            cam_from_world: cam.cam_from_world,
        });
    }
    let ids: Vec<u32> = (0..views.len() as u32).collect();
    let sources = mvsnet::read_pairs(&folder.join("Cameras/pair.txt"), &ids)?.sources;
    Ok(TrainingScene { name: format!("{} light {light}", name.display()), views, sources })
}
