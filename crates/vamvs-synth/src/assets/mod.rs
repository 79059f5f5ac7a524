//! What scenes are made of: meshes, textures and environments, from a user's folders or procedural.

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

/// Share of procedural things and of patterns among those from files.
const PROCEDURAL: f64 = 0.2;

/// Share of surfaces with next to no texture.
const PLAIN: f64 = 0.15;

/// Where a user's assets lie; folders are searched with their subfolders.
#[derive(Clone, Debug, Default)]
pub struct AssetFolders {
    /// Meshes: `.obj` with `.mtl` and textures; one unit is a metre.
    pub meshes: Option<PathBuf>,
    /// Photographs for surfaces.
    pub textures: Option<PathBuf>,
    /// Equirectangular maps: `.hdr`, `.exr`.
    pub environments: Option<PathBuf>,
}

/// The things, textures and environments that scenes are made of. What a kind has no folder for is
/// made procedurally.
#[derive(Debug)]
pub struct Assets {
    meshes: Vec<MeshFile>,
    textures: Vec<PathBuf>,
    environments: Vec<PathBuf>,
    fingerprint: String,
}

impl Assets {
    /// Lists the files of `folders` that `filter` admits. They are read when they are first used.
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

    /// Assets without any file.
    #[must_use]
    pub fn procedural() -> Self {
        let fingerprint = blake3::hash(&[]).to_hex().to_string();
        Self { meshes: Vec::new(), textures: Vec::new(), environments: Vec::new(), fingerprint }
    }

    /// Tells sets of assets apart: a hash over names and lengths of all files and which of them are
    /// used, 64 hexadecimal digits.
    #[must_use]
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// A random thing that one can pick up.
    pub(crate) fn thing(&self, rng: &mut Pcg64) -> Result<Thing, AssetError> {
        let procedural = rng.random_bool(PROCEDURAL);
        match self.meshes.choose(rng) {
            Some(mesh) if !procedural => mesh.thing(self, rng),
            _ => thing::procedural(self, rng),
        }
    }

    /// A random surface with a random coat, for something of about `extent` metres whose texture
    /// coordinates are metres.
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

    /// A random environment, randomly turned, that lights level ground with an irradiance of π.
    pub(crate) fn environment(&self, rng: &mut Pcg64) -> Result<Environment, AssetError> {
        let map = match self.environments.choose(rng) {
            Some(file) => environment::load(file)?,
            None => sky::random(rng),
        };
        Ok(environment::normalised(map, rng))
    }
}
