//! Triangles with normals and texture coordinates.

/// A triangle mesh. Positions, normals and texture coordinates are one per vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertices in the object's frame.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals for shading, outwards.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates; (0, 0) is the lower left corner of the image, which repeats beyond [0, 1].
    pub uvs: Vec<[f32; 2]>,
    /// Vertices of each triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
