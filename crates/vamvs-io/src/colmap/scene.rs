//! Reads a sparse model and its image folder as a scene.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use vamvs_core::face::of_wide_fisheye;
use vamvs_core::{Camera, Scene, SparsePoint, View};

use super::model::{Image, Model, Point};
use super::workspace;
use crate::masks::Masks;
use crate::trackless::give_points;
use crate::{IoError, Loaded, Place, broken, faces, folder, names};

/// Reads the model in the folder `model`, as [`Model::read`] does, with the photographs in the folder `images`, or else in
/// `images` in the folder of the model or up to two above, as in `images` and `sparse/0`. Views are sorted by name and keep
/// COLMAP's image ids, unless a photograph becomes several views ([`View::faces`]).
///
/// # Errors
/// If the model cannot be read (see [`Model::read`]) or has no images, or half of the photographs are missing; views of fewer
/// missing ones remain, with a warning.
pub fn read_scene(model: &Path, images: Option<&Path>) -> Result<Loaded, IoError> {
    let model = &workspace::model(model)?;
    let images = &images.map_or_else(|| workspace::images(model), |images| Ok(images.to_owned()))?;
    let Model { cameras, images: mut registered, points, broken } = Model::read_without_keypoints(model)?;
    if registered.is_empty() {
        let problem = "expected registered images, found none";
        return Err(IoError::malformed(model, Place::Whole, problem));
    }
    let (points, without_place) = broken::finite_points(points, |point| &point.x_in_world, model)?;
    registered.sort_by(|a, b| a.name.cmp(&b.name));
    let found = folder::images(images)?;
    let mut warnings: Vec<String> =
        broken::warning(&broken, registered.len() + broken.len()).into_iter().chain(without_place).collect();
    warnings.extend(rename_nearly_named(images, &found, &mut registered));
    let names: Vec<&str> = registered.iter().map(|image| image.name.as_str()).collect();
    warnings.extend(folder::warn_of_missing(images, &names)?);
    warnings.extend(folder::warn_of_unused(&found, names.iter().copied()));
    let trackless: Vec<_> = match points.iter().all(|point| point.track.is_empty()) {
        true => points.iter().map(|point| point.x_in_world).collect(),
        false => Vec::new(),
    };
    let index_of = registered.iter().enumerate().map(|(index, image)| (image.id, index)).collect();
    let (points, dangling) = sparse_points(&index_of, &points);
    if dangling > 0 && broken.is_empty() {
        warnings.push(format!(
            "{}: {dangling} observation(s) of points are in images that the model does not have, and are not used",
            model.display()
        ));
    }
    let view = |image: Image| view(cameras[&image.camera_id], image);
    let views = registered.into_iter().map(view).collect();
    let mut scene = faces::cut(Scene { views, points, pairs: None });
    if !trackless.is_empty() {
        warnings.push(give_points(&mut scene, &trackless, model));
    }
    Ok(Loaded { scene, images: images.to_owned(), masks: Masks::None, warnings, broken })
}

/// Gives images that are missing the name of the only file that is nearly called like them; returns a warning.
fn rename_nearly_named(folder: &Path, found: &BTreeSet<String>, registered: &mut [Image]) -> Option<String> {
    let taken: BTreeSet<String> = registered.iter().map(|image| image.name.clone()).collect();
    let mut renamed = Vec::new();
    for image in registered.iter_mut().filter(|image| !found.contains(&image.name)) {
        if folder.join(&image.name).is_file() {
            continue;
        }
        if let Some(file) = names::near(found, &image.name).filter(|file| !taken.contains(*file)) {
            renamed.push((std::mem::replace(&mut image.name, file.to_owned()), file.to_owned()));
        }
    }
    names::warn_of_renamed(folder, &renamed)
}

fn view(camera: Camera, image: Image) -> View {
    let camera = of_wide_fisheye(camera);
    View { id: image.id, name: image.name, camera, cam_from_world: image.cam_from_world, depth_range: None }
}

/// The points, each with the indices, by image id, of the images that saw it (each image once), and the number of
/// observations in images that do not exist. Points that no image saw are left out.
fn sparse_points(index_of: &HashMap<u32, usize>, points: &[Point]) -> (Vec<SparsePoint>, usize) {
    let mut dangling = 0;
    let mut sparse = Vec::with_capacity(points.len());
    for point in points {
        let mut views: Vec<usize> =
            point.track.iter().filter_map(|(image, _)| index_of.get(image).copied()).collect();
        dangling += point.track.len() - views.len();
        views.sort_unstable();
        views.dedup();
        if !views.is_empty() {
            sparse.push(SparsePoint { x_in_world: point.x_in_world, views });
        }
    }
    (sparse, dangling)
}
