//! Meshes as PLY files.

use std::io::{self, Write};

use vamvs_core::Mesh;

use crate::ply::Coordinates;

/// Writes a binary little-endian PLY file: `x y z nx ny nz red green blue` of each vertex, and `vertex_indices` of each face.
pub(super) fn write(to: &mut dyn Write, mesh: &Mesh) -> io::Result<()> {
    let coordinates = coordinates(mesh);
    let kind = if coordinates == Coordinates::Double { "double" } else { "float" };
    let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
    write!(
        to,
        "ply\nformat binary_little_endian 1.0\ncomment by vamvs\nelement vertex {vertices}\nproperty {kind} x\nproperty {kind} y\n\
         property {kind} z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )?;
    for (vertex, (normal, colour)) in mesh.normals.iter().zip(&mesh.colours).enumerate() {
        for x in mesh.x_in_world(vertex as u32).iter() {
            match coordinates {
                Coordinates::Double => to.write_all(&x.to_le_bytes())?,
                Coordinates::Float => to.write_all(&(*x as f32).to_le_bytes())?,
            }
        }
        normal.iter().try_for_each(|x| to.write_all(&x.to_le_bytes()))?;
        to.write_all(colour)?;
    }
    for triangle in &mesh.triangles {
        to.write_all(&[3])?;
        triangle.iter().try_for_each(|vertex| to.write_all(&vertex.to_le_bytes()))?;
    }
    Ok(())
}

/// Double if floats are too coarse for coordinates in the world.
fn coordinates(mesh: &Mesh) -> Coordinates {
    let largest = mesh.origin.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let extent = mesh.positions.iter().flatten().fold(0.0_f32, |most, x| most.max(x.abs()));
    Coordinates::at_distance(largest, f64::from(extent))
}
