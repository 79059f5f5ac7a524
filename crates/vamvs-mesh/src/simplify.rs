//! Fewer triangles: edges are collapsed where that changes the surface least (Garland and Heckbert, "Surface simplification
//! using quadric error metrics"; the crate meshopt-rs).

use meshopt_rs::simplify::{simplify, simplify_sloppy};
use vamvs_core::Mesh;

/// The largest error that is allowed, as a share of the mesh's extent: the number of triangles alone decides.
const MOST_ERROR: f32 = 1.0;

/// How many times as many triangles as are wanted are left by clustering, where that goes before.
const CLUSTERED: usize = 8;

/// Reduces a mesh to about this many triangles, to look at: vertices of a large one are first clustered in cells of a grid, which
/// is quick and takes little memory, but may join pieces.
pub fn reduce_to_show(mesh: &mut Mesh, triangles: usize) {
    let clustered = CLUSTERED * triangles;
    if clustered < mesh.triangles.len() {
        let mut reduced = vec![0; 3 * clustered];
        let count =
            simplify_sloppy(&mut reduced, mesh.triangles.as_flattened(), &mesh.positions, 3 * clustered);
        mesh.triangles = reduced[..count].as_chunks().0.to_vec();
        mesh.retain(|_| true);
    }
    reduce(mesh, triangles);
}

/// Reduces a mesh to this many triangles, or to the fewest that keep its topology and its borders. Of the vertices some are
/// left, where they were.
pub(crate) fn reduce(mesh: &mut Mesh, triangles: usize) {
    if triangles >= mesh.triangles.len() {
        return;
    }
    let indices = mesh.triangles.as_flattened();
    let mut reduced = vec![0; indices.len()];
    let count = simplify(&mut reduced, indices, &mesh.positions, 3 * triangles, MOST_ERROR);
    mesh.triangles = reduced[..count].as_chunks().0.to_vec();
    mesh.retain(|_| true);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_keeps_its_border_and_its_colours() {
        const SIDE: u32 = 40;
        let places = (0..SIDE * SIDE).map(|number| [(number % SIDE) as f32, (number / SIDE) as f32, 0.0]);
        let cell = |number: u32| {
            let at = number / (SIDE - 1) * SIDE + number % (SIDE - 1);
            [[at, at + 1, at + SIDE], [at + 1, at + SIDE + 1, at + SIDE]]
        };
        let mut mesh = Mesh {
            positions: places.collect(),
            normals: vec![[0.0, 0.0, 1.0]; (SIDE * SIDE) as usize],
            colours: (0..SIDE * SIDE)
                .map(|number| [(number % SIDE) as u8, (number / SIDE) as u8, 9])
                .collect(),
            triangles: (0..(SIDE - 1) * (SIDE - 1)).flat_map(cell).collect(),
            ..Mesh::default()
        };
        reduce(&mut mesh, 300);
        assert!(mesh.triangles.len() <= 300 && mesh.triangles.len() > 100, "{}", mesh.triangles.len());
        let area: f32 = mesh
            .triangles
            .iter()
            .map(|&triangle| {
                let [a, b, c] = mesh.corners(triangle);
                (b - a).cross(&(c - a)).z / 2.0
            })
            .sum();
        let whole = ((SIDE - 1) * (SIDE - 1)) as f32;
        assert!((area / whole - 1.0).abs() < 0.01, "{area} of {whole}");
        for (position, colour) in mesh.positions.iter().zip(&mesh.colours) {
            assert_eq!(*colour, [position[0] as u8, position[1] as u8, 9]);
        }
    }
}
