//! Writes triangle meshes: PLY, OBJ and GLB (binary glTF 2.0). PLY files are read again.
//!
//! Meshes far from the origin keep their coordinates in PLY (as `double`) and OBJ files. A GLB file has single precision
//! only; there the mesh's origin is the translation of its node.

mod glb;
mod obj;
mod ply;

use std::path::Path;

use vamvs_core::Mesh;

use crate::IoError;
use crate::atomic;

/// A format of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stanford's polygon file format, binary little-endian.
    Ply,
    /// Wavefront's text format, with the widespread extension of colours behind the coordinates.
    Obj,
    /// Binary glTF 2.0: browsers, Blender, Windows, phones.
    Glb,
}

impl MeshFormat {
    /// The format of a file with this name.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_ascii_lowercase().to_str()? {
            "ply" => Some(Self::Ply),
            "obj" => Some(Self::Obj),
            "glb" => Some(Self::Glb),
            _ => None,
        }
    }

    /// Whether a file that begins with these bytes may be of the format.
    #[must_use]
    pub fn may_begin(self, begin: &[u8]) -> bool {
        match self {
            Self::Ply => begin.starts_with(b"ply"),
            Self::Obj => begin.starts_with(b"#") || begin.starts_with(b"v ") || begin.starts_with(b"mtllib"),
            Self::Glb => begin.starts_with(b"glTF"),
        }
    }
}

/// Writes a mesh; the file appears when it is complete.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write(path: &Path, mesh: &Mesh, format: MeshFormat) -> Result<(), IoError> {
    atomic::write(path, |to| match format {
        MeshFormat::Ply => ply::write(to, mesh),
        MeshFormat::Obj => obj::write(to, mesh),
        MeshFormat::Glb => glb::write(to, mesh),
    })
}
