//! Meshes as OBJ files.

use std::io::{self, Write};

use vamvs_core::Mesh;

/// Writes an OBJ file: `v x y z r g b` with colours in [0, 1], `vn`, and `f`.
pub(super) fn write(to: &mut dyn Write, mesh: &Mesh) -> io::Result<()> {
    writeln!(to, "# by vamvs")?;
    for (vertex, colour) in mesh.colours.iter().enumerate() {
        let [x, y, z]: [f64; 3] = mesh.x_in_world(vertex as u32).into();
        let [r, g, b] = colour.map(|value| f32::from(value) / 255.0);
        writeln!(to, "v {x:.8} {y:.8} {z:.8} {r:.4} {g:.4} {b:.4}")?;
    }
    for [x, y, z] in &mesh.normals {
        writeln!(to, "vn {x:.5} {y:.5} {z:.5}")?;
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| vertex + 1);
        writeln!(to, "f {a}//{a} {b}//{b} {c}//{c}")?;
    }
    Ok(())
}
