//! Brute-force ray casting: a ray is tested against every triangle in double precision (Möller and Trumbore).

use nalgebra::{Point3, Vector3};
use vamvs_synth::World;

/// The parameter t and the object index of the first triangle that `origin + t · direction` meets.
pub fn first_hit(world: &World, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, usize)> {
    let hits = world.objects.iter().enumerate().flat_map(|(index, object)| {
        object.mesh.triangles.iter().filter_map(move |triangle| {
            let corners = triangle.map(|vertex| {
                let in_object = Point3::from(object.mesh.positions[vertex as usize]).cast();
                object.world_from_object.transform_point(&in_object).coords
            });
            Some((crossing(&corners, origin, direction)?, index))
        })
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
}

fn crossing(corners: &[Vector3<f64>; 3], origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let (along_u, along_v) = (corners[1] - corners[0], corners[2] - corners[0]);
    let across = direction.cross(&along_v);
    let determinant = along_u.dot(&across);
    let from_corner = origin - corners[0];
    let u = from_corner.dot(&across) / determinant;
    let other = from_corner.cross(&along_u);
    let v = direction.dot(&other) / determinant;
    let t = along_v.dot(&other) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}
