//! Reads meshes.

use std::path::Path;

use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use vamvs_core::Cloud;

use super::reader::{PART, malformed, open_vertices, read_parts};
use super::vertex::{self, Vertex};
use crate::{IoError, Place};

/// The name of the element that holds the faces.
const NAME: &str = "face";

/// Reads the vertices of a PLY file as [`super::read`], and its faces, as triangles; no faces if it is a cloud. Vertices stay
/// where they are, also if their position is not finite.
///
/// # Errors
/// As [`super::read`], or if a face names a vertex that is not there.
pub fn read_mesh(path: &Path) -> Result<(Cloud, Vec<[u32; 3]>), IoError> {
    let (mut reader, header) = open_vertices(path)?;
    let count = header.elements.get(vertex::NAME).map_or(0, |vertices| vertices.count);
    let (mut vertices, mut triangles, mut wrong) = (Cloud::with_capacity(count), Vec::new(), None);
    for element in header.elements.values() {
        let part = (element, &header);
        let read = if element.name == vertex::NAME {
            let mut visit = |read: Vec<Vertex>| vertices.extend(read.into_iter().map(|vertex| vertex.0));
            read_parts(&mut reader, part, PART, &mut visit)
        } else {
            let is_face = element.name == NAME;
            let number = |vertex: i64| u32::try_from(vertex).ok().filter(|number| (*number as usize) < count);
            let mut visit = |faces: Vec<Face>| {
                for corners in faces.iter().filter(|_| is_face).flat_map(Face::triangles) {
                    wrong = wrong.or_else(|| corners.into_iter().find(|vertex| number(*vertex).is_none()));
                    triangles.push(corners.map(|vertex| number(vertex).unwrap_or_default()));
                }
            };
            read_parts(&mut reader, part, PART, &mut visit)
        };
        read.map_err(malformed(path))?;
    }
    if let Some(wrong) = wrong {
        let problem = format!("expected faces of the {count} vertices, found vertex {wrong}");
        return Err(IoError::malformed(path, Place::Whole, problem));
    }
    Ok((vertices, triangles))
}

/// Whether a PLY file is a mesh: its header announces faces.
///
/// # Errors
/// As [`super::read`].
pub fn is_mesh(path: &Path) -> Result<bool, IoError> {
    let (_, header) = open_vertices(path)?;
    Ok(header.elements.get(NAME).is_some_and(|faces| faces.count > 0))
}

/// A face: its vertices' numbers.
struct Face(Vec<i64>);

impl Face {
    fn triangles(&self) -> impl Iterator<Item = [i64; 3]> {
        let first = self.0.first().copied().unwrap_or_default();
        self.0.windows(2).skip(1).map(move |pair| [first, pair[0], pair[1]])
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        self.0 = match property {
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::Ignored,
        };
        PropertyAccessResult::Set
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<(Cloud, Vec<[u32; 3]>), IoError> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mesh.ply");
        crate::atomic::write(&path, |to| to.write_all(text.as_bytes())).expect("a file");
        read_mesh(&path)
    }

    #[test]
    fn polygons_become_triangles_and_clouds_have_none() {
        let begin =
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
        let vertices = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
        let faces = "element face 1\nproperty list uchar int vertex_index\nend_header\n";
        let (cloud, triangles) = read(&format!("{begin}{faces}{vertices}4 0 1 2 3\n")).expect("a mesh");
        assert_eq!((cloud.len(), triangles), (4, vec![[0, 1, 2], [0, 2, 3]]));
        let (cloud, triangles) = read(&format!("{begin}end_header\n{vertices}")).expect("a cloud");
        assert_eq!((cloud.len(), triangles.len()), (4, 0));
        let error = read(&format!("{begin}{faces}{vertices}3 0 1 4\n")).expect_err("no such vertex");
        assert!(error.to_string().contains("expected faces of the 4 vertices, found vertex 4"), "{error}");
    }
}
