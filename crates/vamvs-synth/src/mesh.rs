//! Triangle meshes with normals and texture coordinates.

/// A triangle mesh. Each vertex has a position, a normal and texture coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions in the object's frame.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals for shading, pointing outwards.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates; (0, 0) is the lower left corner of the image, which repeats beyond [0, 1].
    pub uvs: Vec<[f32; 2]>,
    /// Vertex indices of each triangle, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
