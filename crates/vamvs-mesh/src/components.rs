//! Connected pieces of a mesh.

use vamvs_core::Mesh;

use crate::sets::Sets;

/// Removes pieces of fewer triangles.
pub(crate) fn remove_small(mesh: &mut Mesh, least: usize) {
    let mut pieces = Sets::new(mesh.positions.len());
    for &[a, b, c] in &mesh.triangles {
        pieces.join(a, b);
        pieces.join(a, c);
    }
    let of_triangle: Vec<u32> = mesh.triangles.iter().map(|triangle| pieces.find(triangle[0])).collect();
    let mut counts = vec![0_usize; mesh.positions.len()];
    of_triangle.iter().for_each(|&piece| counts[piece as usize] += 1);
    mesh.retain(|triangle| counts[of_triangle[triangle] as usize] >= least);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_of_few_triangles_go_with_their_vertices() {
        let at = |x: u8| [f32::from(x), 0.0, 0.0];
        let mut mesh = Mesh {
            positions: (0..7).map(at).collect(),
            triangles: vec![[4, 5, 6], [0, 1, 2], [2, 1, 3]],
            ..Mesh::default()
        };
        remove_small(&mut mesh, 2);
        assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(mesh.positions, [at(0), at(1), at(2), at(3)]);
    }
}
