//! A sparse model: cameras, registered images and triangulated points.

use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::path::Path;

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector2, Vector3};
use vamvs_core::{Camera, Pose, Scene, View};

use crate::{IoError, Place, broken, folder};

/// A sparse model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The cameras by id.
    pub cameras: BTreeMap<u32, Camera>,
    /// The registered images.
    pub images: Vec<Image>,
    /// The triangulated points.
    pub points: Vec<Point>,
    /// What was wrong with images that were left out when the model was read, or with their cameras.
    pub broken: Vec<String>,
}

/// Whether the images' keypoints are kept when a model is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keypoints {
    Read,
    Skip,
}

/// A registered image.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// COLMAP's image id.
    pub id: u32,
    /// The file's path relative to the image folder, with `/` between folders.
    pub name: String,
    /// The id of its camera, a key of [`Model::cameras`].
    pub camera_id: u32,
    /// The pose.
    pub cam_from_world: Pose,
    /// The keypoints; empty if they were not read.
    pub observations: Vec<Observation>,
}

/// A keypoint of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Position in the distorted image, in pixels.
    pub pixel: Vector2<f64>,
    /// The id of the triangulated point, if there is one.
    pub point_id: Option<u64>,
}

/// A triangulated point.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// COLMAP's point id.
    pub id: u64,
    /// Position.
    pub x_in_world: Vector3<f64>,
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// Mean reprojection error in pixels.
    pub error: f64,
    /// The point's observations: the image's id, and the index into that image's observations.
    pub track: Vec<(u32, u32)>,
}

impl Model {
    /// The model of a scene, with a camera for each view.
    ///
    /// A scene has no keypoints, so a point is observed where it projects, even outside the image. A view has no
    /// observation of a point behind its camera or where its lens model folds over. Colours and reprojection
    /// errors are unknown and set to 0.
    #[must_use]
    pub fn from_scene(scene: &Scene) -> Self {
        let cameras = scene.views.iter().map(|view| (view.id, view.camera)).collect();
        let mut images: Vec<Image> = scene.views.iter().map(Image::unobserved).collect();
        let mut points = Vec::with_capacity(scene.points.len());
        for (id, point) in (1..).zip(&scene.points) {
            let mut track = Vec::with_capacity(point.views.len());
            for &view in &point.views {
                let x_in_cam = scene.views[view].cam_from_world.transform(&point.x_in_world);
                if let Some(pixel) = scene.views[view].camera.project(&x_in_cam) {
                    track.push((scene.views[view].id, images[view].observations.len() as u32));
                    images[view].observations.push(Observation { pixel, point_id: Some(id) });
                }
            }
            points.push(Point { id, x_in_world: point.x_in_world, rgb: [0; 3], error: 0.0, track });
        }
        Self { cameras, images, points, broken: Vec::new() }
    }

    /// The model of what was read: an image is left out if its pose or its camera cannot be used. `file` holds the images.
    pub(super) fn of_usable(
        cameras: BTreeMap<u32, Result<Camera, IoError>>,
        images: Vec<Result<Image, IoError>>,
        points: Vec<Point>,
        file: &Path,
    ) -> Result<Self, IoError> {
        let with_camera = |image: Image| match cameras.get(&image.camera_id) {
            Some(Err(error)) => Err(IoError::malformed(file, Place::Whole, format!("{image}: {error}"))),
            _ => Ok(image),
        };
        let images = images.into_iter().map(|image| image.and_then(with_camera)).collect();
        let (images, broken) = broken::leave_out(images)?;
        let images = images.into_iter().flatten().collect();
        let cameras = cameras.into_iter().filter_map(|(id, camera)| Some((id, camera.ok()?))).collect();
        Ok(Self { cameras, images, points, broken })
    }

    /// Checks the consistency of cameras and images, which are in different files; `file` is that of the images.
    pub(super) fn check(&self, file: &Path) -> Result<(), IoError> {
        let (mut ids, mut names) = (HashSet::new(), HashSet::new());
        for image in &self.images {
            let problem = if !self.cameras.contains_key(&image.camera_id) {
                format!("its camera {} does not exist", image.camera_id)
            } else if !folder::is_inside(&image.name) {
                "its name is no path inside the image folder".to_owned()
            } else if !ids.insert(image.id) || !names.insert(&image.name) {
                "its id or its name occurs twice".to_owned()
            } else {
                continue;
            };
            return Err(IoError::malformed(file, Place::Whole, format!("{image}: {problem}")));
        }
        Ok(())
    }
}

impl Image {
    fn unobserved(view: &View) -> Self {
        Self {
            id: view.id,
            name: view.name.clone(),
            camera_id: view.id,
            cam_from_world: view.cam_from_world,
            observations: Vec::new(),
        }
    }
}

impl fmt::Display for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "image {} ({:?})", self.id, self.name)
    }
}

/// The pose, camera from world, of a quaternion (w, x, y, z), which is normalised here, and a translation.
pub(crate) fn pose(quaternion: [f64; 4], translation: [f64; 3]) -> Result<Pose, String> {
    let [w, x, y, z] = quaternion;
    let norm = Quaternion::new(w, x, y, z).norm();
    if !norm.is_normal() {
        return Err(format!("expected a rotation as a finite quaternion other than 0, found {quaternion:?}"));
    }
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)).to_rotation_matrix();
    Pose::try_new(rotation.into_inner(), translation.into()).map_err(|error| error.to_string())
}

/// The unit quaternion (w, x, y, z) of a pose's rotation.
pub(super) fn quaternion(cam_from_world: &Pose) -> [f64; 4] {
    let rotation = Rotation3::from_matrix_unchecked(cam_from_world.rotation);
    let q = UnitQuaternion::from_rotation_matrix(&rotation);
    [q.w, q.i, q.j, q.k]
}
