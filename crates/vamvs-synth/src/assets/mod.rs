//! The assets of scenes: meshes, textures and environment maps, from a user's folders or procedural.

mod environment;
mod error;
mod filter;
mod obj;
mod scan;
mod shape;
mod sky;
mod surface;
mod thing;

pub use error::AssetError;
pub use filter::AssetFilter;
pub(crate) use surface::Look;
pub(crate) use thing::Thing;

use std::path::PathBuf;

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_pcg::Pcg64;
use surface::Surface;
use thing::MeshFile;

use crate::{Environment, Material};

/// Where there are files, the probability that a thing or a texture is procedural all the same.
const PROCEDURAL: f64 = 0.2;

/// The probability that a scene that shows the sky has a procedural one, whatever files there are.
const PROCEDURAL_SKY: f64 = 0.8;

/// Probability that a surface of [`Look::Any`] is almost textureless.
const PLAIN: f64 = 0.15;

/// The folders of a user's assets. Subfolders are searched too.
#[derive(Clone, Debug, Default)]
pub struct AssetFolders {
    /// Meshes: `.obj` with `.mtl` and textures; one unit is a metre.
    pub meshes: Option<PathBuf>,
    /// Photographs to use as textures.
    pub textures: Option<PathBuf>,
    /// Equirectangular environment maps: `.hdr`, `.exr`.
    pub environments: Option<PathBuf>,
}

/// The things, textures and environment maps that scenes are made of. A kind without a folder is made
/// procedurally.
#[derive(Debug)]
pub struct Assets {
    meshes: Vec<MeshFile>,
    textures: Vec<PathBuf>,
    environments: Vec<PathBuf>,
    fingerprint: String,
}

impl Assets {
    /// Lists the files of `folders` that `filter` admits. Files are read when they are needed.
    ///
    /// # Errors
    /// If a folder cannot be listed, or holds no file of its kind that the filter admits.
    pub fn load(folders: &AssetFolders, filter: &AssetFilter) -> Result<Self, AssetError> {
        let mut hasher = blake3::Hasher::new();
        let mut files = |folder: &Option<PathBuf>, kind| match folder {
            Some(folder) => scan::scan(folder, kind, filter, &mut hasher),
            None => Ok(Vec::new()),
        };
        let meshes = files(&folders.meshes, &scan::MESHES)?;
        let textures = files(&folders.textures, &scan::TEXTURES)?;
        let environments = files(&folders.environments, &scan::ENVIRONMENTS)?;
        let meshes = meshes.into_iter().map(MeshFile::new).collect();
        Ok(Self { meshes, textures, environments, fingerprint: hasher.finalize().to_hex().to_string() })
    }

    /// Procedural assets only.
    #[must_use]
    pub fn procedural() -> Self {
        let fingerprint = blake3::hash(&[]).to_hex().to_string();
        Self { meshes: Vec::new(), textures: Vec::new(), environments: Vec::new(), fingerprint }
    }

    /// A hash that tells sets of assets apart, 64 hexadecimal digits: over the names and lengths of all files
    /// and which of them are used. The files' content is not read.
    #[must_use]
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// A random thing, small enough to pick up.
    pub(crate) fn thing(&self, rng: &mut Pcg64) -> Result<Thing, AssetError> {
        let procedural = rng.random_bool(PROCEDURAL);
        match self.meshes.choose(rng) {
            Some(mesh) if !procedural => mesh.thing(self, rng),
            _ => thing::procedural(self, rng),
        }
    }

    /// A random surface with a random coat, for an object about `extent` metres large whose texture
    /// coordinates are in metres.
    pub(crate) fn material(&self, look: Look, extent: f32, rng: &mut Pcg64) -> Result<Material, AssetError> {
        let procedural = rng.random_bool(PROCEDURAL);
        let plain = look == Look::Any && rng.random_bool(PLAIN);
        let surface = if plain {
            Surface::plain(extent, rng)
        } else if procedural || self.textures.is_empty() {
            Surface::pattern(look, extent, rng)
        } else {
            Surface::photograph(&self.textures, extent, rng)?
        };
        Ok(surface.material(rng))
    }

    /// A random environment, turned at random, that lights level ground with an irradiance of π.
    pub(crate) fn environment(&self, rng: &mut Pcg64) -> Result<Environment, AssetError> {
        let map = match self.environments.choose(rng) {
            Some(file) => environment::load(file)?,
            None => sky::random(sky::LIGHT, rng),
        };
        Ok(environment::normalised(map, rng))
    }

    /// As [`Self::environment`], but mostly a procedural sky, for scenes that show it.
    pub(crate) fn outdoors(&self, rng: &mut Pcg64) -> Result<Environment, AssetError> {
        match rng.random_bool(PROCEDURAL_SKY) {
            true => Ok(environment::normalised(sky::random(sky::SEEN, rng), rng)),
            false => self.environment(rng),
        }
    }
}
