//! The geometric pass: refinement of a view's depth map with those of its source views.

use std::rc::Rc;

use nalgebra::Vector3;
use vamvs_core::{DepthMap, Photo, Pose, Size};
use vamvs_refine::matching::Device;
use vamvs_refine::{RefineOptions, Refined, Surface, refine_geometric_on};

use crate::VamvsError;
use crate::output::{LoadedMap, OutputFolder};

/// A photograph with fewer pixels on its shorter side is too small for a first pass at half its
/// size.
const SMALL: usize = 600;

/// The options of the first of two passes.
pub(crate) fn first_pass(options: &RefineOptions, photograph: Size) -> RefineOptions {
    let halvings = usize::from(photograph.width.min(photograph.height) >= SMALL);
    let mut first = *options;
    first.halvings = first.halvings.max(halvings);
    first
}

/// What is needed of a first-pass map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Needed {
    /// Depth, of a source view.
    Depth,
    /// Depth and normals, of the view itself.
    Normals,
}

/// Refines a view's first-pass map with those of its source views; `first` gives all of them. A
/// source view that has none is compared by its photograph alone. A device, if there is one, matches planes.
///
/// # Errors
/// If a first-pass map cannot be read, the view has none, or there is no source view.
pub(crate) fn refined(
    first: impl Fn(usize, Needed) -> Result<Option<Rc<LoadedMap>>, VamvsError>,
    (view, reference): (usize, &Photo),
    sources: &[(usize, Rc<Photo>)],
    (options, device): (&RefineOptions, Option<&dyn Device>),
) -> Result<Refined, VamvsError> {
    let own = first(view, Needed::Normals)?;
    let own = own.ok_or_else(|| VamvsError::Request("it has no depth map of the first pass".to_owned()))?;
    let missing = || "the depth map of its first pass has no normals: remove photometric/ and run again";
    let normals = own.normals.as_ref().ok_or_else(|| VamvsError::Request(missing().to_owned()))?;
    let normals = normals.map(|normal| in_camera(normal, &own.map.cam_from_world));
    let maps: Vec<Option<Rc<LoadedMap>>> =
        sources.iter().map(|(source, _)| first(*source, Needed::Depth)).collect::<Result<_, _>>()?;
    let maps: Vec<Option<&DepthMap>> = maps.iter().map(|map| map.as_ref().map(|map| &map.map)).collect();
    let photos: Vec<&Photo> = sources.iter().map(|(_, photo)| photo.as_ref()).collect();
    let own = Surface { map: &own.map, normals: &normals };
    Ok(refine_geometric_on(device, reference, &photos, (&own, &maps), options)?)
}

/// A first-pass map from the folder of the first pass, if it is there.
pub(crate) fn loaded(
    folder: &OutputFolder,
    name: &str,
    needed: Needed,
) -> Result<Option<Rc<LoadedMap>>, VamvsError> {
    if folder.saved(name).is_none() {
        return Ok(None);
    }
    Ok(Some(Rc::new(match needed {
        Needed::Depth => folder.load_without_normals(name)?,
        Needed::Normals => folder.load(name)?,
    })))
}

fn in_camera(normal: &[f32; 3], cam_from_world: &Pose) -> [f32; 3] {
    (cam_from_world.rotation.cast::<f32>() * Vector3::from(*normal)).into()
}
