//! Reads meshes from OBJ files with their MTL files.

use std::cell::RefCell;
use std::fs;
use std::io::{self, BufRead, Cursor, Read};
use std::path::{Path, PathBuf};

use tobj::{LoadError, LoadOptions};

use super::AssetError;
use crate::Mesh;
use crate::smoothing::Facets;

/// Edges whose triangles differ in direction by more than this (radians) stay sharp.
const CREASE: f32 = 0.8;

/// The part of a mesh that has one texture, or the part that has none.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    /// The shape. Where it has no texture, its texture coordinates are in metres.
    pub mesh: Mesh,
    /// The file of its texture, if it has one.
    pub texture: Option<PathBuf>,
}

/// Reads a mesh in metres, one part per texture. Normals are always computed: those of scans are often missing
/// or wrong.
pub(super) fn load(path: &Path) -> Result<Vec<Part>, AssetError> {
    let text = fs::read(path).map_err(AssetError::system(path))?;
    let mut reader = Lines { inner: Cursor::new(&text), count: 0 };
    let options = LoadOptions { triangulate: true, single_index: true, ..Default::default() };
    let library = RefCell::new(path.to_owned());
    let loaded = tobj::load_obj_buf(&mut reader, &options, |name| {
        library.replace(path.with_file_name(name));
        let text = fs::read(&*library.borrow()).map_err(|_| LoadError::OpenFileFailed)?;
        tobj::load_mtl_buf(&mut Cursor::new(text))
    });
    let (models, materials) = loaded.map_err(|error| malformed(path, reader.count, error))?;
    let library = library.into_inner();
    let materials = materials.map_err(|error| bad_library(path, &library, error))?;
    check_finite(path, &models)?;
    parts(path, &models, &textures(&library, &materials)?)
}

/// The texture file of each material, where it names one.
fn textures(library: &Path, materials: &[tobj::Material]) -> Result<Vec<Option<PathBuf>>, AssetError> {
    materials.iter().map(|material| texture(library, material)).collect()
}

fn texture(library: &Path, material: &tobj::Material) -> Result<Option<PathBuf>, AssetError> {
    let Some(name) = material.diffuse_texture.as_deref().filter(|name| !name.is_empty()) else {
        return Ok(None);
    };
    let file = library.with_file_name(name.replace('\\', "/"));
    if file.is_file() {
        return Ok(Some(file));
    }
    let problem = format!(
        "material {:?} names the texture {}, which is not there; add it, or remove the line \"map_Kd\"",
        material.name,
        file.display()
    );
    Err(AssetError::mesh(library, problem))
}

/// Joins the models that share a texture, in the order of the file. Models without a texture, or without texture
/// coordinates, are joined too; these get projected texture coordinates.
fn parts(path: &Path, models: &[tobj::Model], textures: &[Option<PathBuf>]) -> Result<Vec<Part>, AssetError> {
    let mut joined: Vec<(Option<PathBuf>, Facets)> = Vec::new();
    for model in models.iter().filter(|model| !model.mesh.indices.is_empty()) {
        let mut facets = facets(&model.mesh);
        let texture = model.mesh.material_id.and_then(|id| textures[id].clone());
        let texture = texture.filter(|_| !facets.uvs.is_empty());
        if texture.is_none() {
            facets = project(&facets);
        }
        match joined.iter_mut().find(|(known, _)| *known == texture) {
            Some((_, all)) => append(all, &facets),
            None => joined.push((texture, facets)),
        }
    }
    let smooth = |(texture, facets): (_, Facets)| Part { mesh: facets.smooth(CREASE), texture };
    let parts: Vec<Part> =
        joined.into_iter().map(smooth).filter(|part| !part.mesh.triangles.is_empty()).collect();
    if parts.is_empty() {
        return Err(AssetError::mesh(path, "expected triangles, found none; is the file complete?"));
    }
    Ok(parts)
}

fn check_finite(path: &Path, models: &[tobj::Model]) -> Result<(), AssetError> {
    let numbers = models.iter().flat_map(|model| model.mesh.positions.iter().chain(&model.mesh.texcoords));
    match numbers.into_iter().find(|number| !number.is_finite()) {
        Some(odd) => Err(AssetError::mesh(path, format!("expected finite coordinates, found {odd}"))),
        None => Ok(()),
    }
}

fn facets(mesh: &tobj::Mesh) -> Facets {
    Facets {
        positions: mesh.positions.as_chunks::<3>().0.to_vec(),
        uvs: mesh.texcoords.as_chunks::<2>().0.to_vec(),
        triangles: mesh.indices.as_chunks::<3>().0.to_vec(),
    }
}

fn append(all: &mut Facets, more: &Facets) {
    let first = all.positions.len() as u32;
    all.positions.extend(&more.positions);
    all.uvs.extend(&more.uvs);
    all.triangles.extend(more.triangles.iter().map(|triangle| triangle.map(|vertex| first + vertex)));
}

/// Box projection: each triangle's texture coordinates are its positions along the two axes it faces least.
fn project(facets: &Facets) -> Facets {
    let mut projected = Facets::default();
    for triangle in &facets.triangles {
        let corners = triangle.map(|vertex| facets.positions[vertex as usize]);
        let axis = facing_axis(&corners);
        let first = projected.positions.len() as u32;
        projected.positions.extend(corners);
        projected.uvs.extend(corners.map(|corner| [corner[(axis + 1) % 3], corner[(axis + 2) % 3]]));
        projected.triangles.push([first, first + 1, first + 2]);
    }
    projected
}

fn facing_axis([a, b, c]: &[[f32; 3]; 3]) -> usize {
    let edge = |to: &[f32; 3]| nalgebra::Vector3::from(*to) - nalgebra::Vector3::from(*a);
    edge(b).cross(&edge(c)).iamax()
}

fn malformed(path: &Path, line: usize, error: LoadError) -> AssetError {
    AssetError::mesh(path, format!("line {line}: {error}"))
}

fn bad_library(path: &Path, library: &Path, error: LoadError) -> AssetError {
    if matches!(error, LoadError::OpenFileFailed) {
        let problem = format!(
            "the material file {} is not there; add it, or remove the line \"mtllib\"",
            library.display()
        );
        return AssetError::mesh(path, problem);
    }
    AssetError::mesh(library, error.to_string())
}

/// A reader that counts the lines read from it.
struct Lines<R> {
    inner: R,
    count: usize,
}

impl<R: BufRead> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut available = self.fill_buf()?;
        let taken = available.read(buffer)?;
        self.consume(taken);
        Ok(taken)
    }
}

impl<R: BufRead> BufRead for Lines<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        // This returns the buffer that the caller already has, so it cannot fail.
        let seen = self.inner.fill_buf().unwrap_or_default();
        self.count += seen[..amount.min(seen.len())].iter().filter(|&&byte| byte == b'\n').count();
        self.inner.consume(amount);
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use vamvs_io::atomic;

    use super::*;

    const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 2 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

    fn write(folder: &Path, name: &str, content: &str) -> PathBuf {
        let path = folder.join(name);
        atomic::write(&path, |out: &mut dyn Write| out.write_all(content.as_bytes())).unwrap();
        path
    }

    fn load_text(text: &str) -> Result<Vec<Part>, AssetError> {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "paint.mtl", "newmtl a\nmap_Kd a.png\nnewmtl b\nKd 1 0 0\n");
        write(folder.path(), "a.png", "");
        write(folder.path(), "broken.mtl", "newmtl a\nmap_Kd lost.png\n");
        load(&write(folder.path(), "mesh.obj", text))
    }

    fn problem(text: &str) -> String {
        load_text(text).unwrap_err().to_string()
    }

    #[test]
    fn polygons_become_triangles_with_normals_and_texture_coordinates() {
        let text = format!("mtllib paint.mtl\n{QUAD}usemtl a\nf 1/1 2/2 3/3 4/4\n");
        let parts = load_text(&text).unwrap();
        let mesh = &parts[0].mesh;
        assert_eq!((parts.len(), mesh.triangles.len(), mesh.positions.len()), (1, 2, 4));
        assert!(parts[0].texture.as_ref().unwrap().ends_with("a.png"));
        assert!(mesh.normals.iter().all(|&normal| normal == [0.0, 0.0, 1.0]));
        for (position, uv) in mesh.positions.iter().zip(&mesh.uvs) {
            assert_eq!([position[0], position[1] / 2.0], *uv);
        }
    }

    #[test]
    fn each_texture_is_one_part_and_the_rest_is_projected() {
        let faces = "usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 3/3 4/4\nusemtl a\nf 3/3 2/2 1/1\n";
        let parts = load_text(&format!("mtllib paint.mtl\n{QUAD}{faces}")).unwrap();
        assert_eq!(parts.len(), 2);
        assert_eq!((parts[0].mesh.triangles.len(), parts[1].mesh.triangles.len()), (2, 1));
        assert_eq!(parts[1].texture, None);
        for (position, uv) in parts[1].mesh.positions.iter().zip(&parts[1].mesh.uvs) {
            assert_eq!(position[..2], uv[..], "metres along the surface");
        }
    }

    #[test]
    fn missing_texture_coordinates_leave_the_texture_unused() {
        let parts = load_text(&format!("mtllib paint.mtl\n{QUAD}usemtl a\nf 1 2 3\n")).unwrap();
        assert_eq!((parts[0].texture.as_ref(), parts[0].mesh.uvs.len()), (None, 3));
    }

    #[test]
    fn missing_files_are_named() {
        let message = problem(&format!("mtllib broken.mtl\n{QUAD}f 1/1 2/2 3/3\n"));
        assert!(message.contains("broken.mtl") && message.contains("lost.png"), "{message}");
        let message = problem(&format!("mtllib none.mtl\n{QUAD}f 1/1 2/2 3/3\n"));
        assert!(message.contains("mesh.obj") && message.contains("none.mtl"), "{message}");
        let error = load(Path::new("no/such.obj")).unwrap_err();
        assert!(error.to_string().contains("no/such.obj"), "{error}");
    }

    #[test]
    fn truncated_and_odd_files_are_refused() {
        assert!(problem("v 0 0 0\nv 1 0 0\nv 0 1").contains("line 2"), "cut in a vertex");
        assert!(problem(QUAD).contains("expected triangles"), "cut before the faces");
        assert!(problem(&format!("{QUAD}f 1 2 9\n")).contains("out of bounds"));
        assert!(problem(&format!("{QUAD}f 1 2 x\n")).contains("line 9: face"));
        assert!(problem("v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n").contains("finite"));
    }
}
