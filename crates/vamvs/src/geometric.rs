//! Refinement of a view's depth map with those of its source views, as they lie in a folder.

use std::rc::Rc;

use nalgebra::Vector3;
use vamvs_core::{DepthMap, Photo, Pose, Size};
use vamvs_refine::{RefineOptions, Refined, Surface, refine_geometric};

use crate::output::LoadedMap;
use crate::{OutputFolder, VamvsError};

/// Photographs with fewer pixels on the shorter side are too small for a first pass at half their size.
const SMALL: usize = 600;

/// How a depth map is refined that will be refined once more.
pub(crate) fn first_pass(options: &RefineOptions, photograph: Size) -> RefineOptions {
    let halvings = usize::from(photograph.width.min(photograph.height) >= SMALL);
    RefineOptions { halvings: options.halvings.max(halvings), ..*options }
}

/// Refines the depth map that `first` has of the view `name` with those that it has of the source views; a source view
/// that has none is compared by its photograph alone.
///
/// # Errors
/// If the view's own files cannot be read, or there is no source view.
pub(crate) fn refined(
    first: &OutputFolder,
    name: &str,
    reference: &Photo,
    sources: &[(&str, Rc<Photo>)],
    options: &RefineOptions,
) -> Result<Refined, VamvsError> {
    let LoadedMap { map, normals } = first.load(name)?;
    let normals = normals.ok_or_else(|| {
        let problem = "is missing; remove the folder and run again".to_owned();
        VamvsError::Folder { path: first.normals(name), problem }
    })?;
    let normals = normals.map(|normal| in_camera(normal, &map.cam_from_world));
    let maps: Vec<Option<DepthMap>> =
        sources.iter().map(|(name, _)| first.load(name).ok().map(|loaded| loaded.map)).collect();
    let maps: Vec<Option<&DepthMap>> = maps.iter().map(Option::as_ref).collect();
    let photos: Vec<&Photo> = sources.iter().map(|(_, photo)| photo.as_ref()).collect();
    Ok(refine_geometric(reference, &photos, &Surface { map: &map, normals: &normals }, &maps, options)?)
}

fn in_camera(normal: &[f32; 3], cam_from_world: &Pose) -> [f32; 3] {
    (cam_from_world.rotation.cast::<f32>() * Vector3::from(*normal)).into()
}
