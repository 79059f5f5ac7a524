//! Things: objects small enough to pick up.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use nalgebra::{Similarity3, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

use super::obj::{self, Part};
use super::surface::coated;
use super::{AssetError, Assets, Look, shape};
use crate::solid::Solid;
use crate::{Material, Mesh, Object};

/// Smallest radius of a thing, metres: a smaller mesh is not to scale and is enlarged to it.
const SMALLEST: f32 = 0.02;

/// Largest radius of a thing, metres: a larger mesh is not to scale and is reduced to it.
const LARGEST: f32 = 0.25;

/// A thing: its visible parts and its collision body, all in one frame.
#[derive(Clone, Debug)]
pub(crate) struct Thing {
    pub parts: Vec<(Arc<Mesh>, Material)>,
    pub solid: Arc<Solid>,
    /// Scale from its frame to metres: brings it to a plausible size, varied at random.
    pub scale: f64,
}

impl Thing {
    fn new(parts: Vec<(Arc<Mesh>, Material)>, solid: Arc<Solid>, rng: &mut Pcg64) -> Self {
        let radius = solid.radius();
        let natural = radius.clamp(SMALLEST, LARGEST) / radius;
        Self { parts, solid, scale: f64::from(natural) * rng.random_range(0.9..1.15) }
    }

    /// Radius of the smallest ball around its middle that contains it, after scaling, metres.
    pub fn radius(&self) -> f64 {
        f64::from(self.solid.radius()) * self.scale
    }

    /// Centre of its bounding box, in its own frame before scaling.
    pub fn middle(&self) -> Vector3<f64> {
        self.solid.middle().cast()
    }

    /// Its parts as objects, placed in the world.
    pub fn objects(self, world_from_thing: Similarity3<f64>) -> impl Iterator<Item = Object> {
        let object = move |(mesh, material)| Object { mesh, material, world_from_object: world_from_thing };
        self.parts.into_iter().map(object)
    }
}

/// A mesh file; its content is kept in memory once it has been read.
#[derive(Debug)]
pub(super) struct MeshFile {
    path: PathBuf,
    loaded: OnceLock<Arc<Loaded>>,
}

#[derive(Debug)]
struct Loaded {
    parts: Vec<(Arc<Mesh>, Option<PathBuf>)>,
    solid: Arc<Solid>,
}

impl MeshFile {
    pub fn new(path: PathBuf) -> Self {
        Self { path, loaded: OnceLock::new() }
    }

    /// The thing with its own textures; parts without a texture get a random surface.
    pub fn thing(&self, assets: &Assets, rng: &mut Pcg64) -> Result<Thing, AssetError> {
        let loaded = self.loaded()?;
        let extent = 2.0 * loaded.solid.radius();
        let paint = |(mesh, texture): &(Arc<Mesh>, Option<PathBuf>)| {
            let material = match texture {
                Some(file) => coated(Arc::new(vamvs_io::image::load_rgb(file)?), [1.0; 2], rng),
                None => assets.material(Look::Any, extent, rng)?,
            };
            Ok((mesh.clone(), material))
        };
        let parts = loaded.parts.iter().map(paint).collect::<Result<_, AssetError>>()?;
        Ok(Thing::new(parts, loaded.solid.clone(), rng))
    }

    fn loaded(&self) -> Result<Arc<Loaded>, AssetError> {
        if let Some(loaded) = self.loaded.get() {
            return Ok(loaded.clone());
        }
        let parts = obj::load(&self.path)?;
        let solid = Arc::new(Solid::of(&parts.iter().map(|part| &part.mesh).collect::<Vec<_>>()));
        let parts = parts.into_iter().map(|Part { mesh, texture }| (Arc::new(mesh), texture)).collect();
        Ok(self.loaded.get_or_init(|| Arc::new(Loaded { parts, solid })).clone())
    }
}

/// A thing of a random shape with a random surface.
pub(super) fn procedural(assets: &Assets, rng: &mut Pcg64) -> Result<Thing, AssetError> {
    let mesh = shape::random(rng);
    let solid = Solid::of(&[&mesh]);
    let material = assets.material(Look::Any, 2.0 * solid.radius(), rng)?;
    Ok(Thing::new(vec![(Arc::new(mesh), material)], Arc::new(solid), rng))
}
