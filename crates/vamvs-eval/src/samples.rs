//! Points on the triangles of a mesh.

use nalgebra::Vector3;
use vamvs_core::{Cloud, CloudPoint};

/// What a step of the sequence that places points in triangles adds: powers of the inverse of the plastic number
/// (Roberts, "The unreasonable effectiveness of quasirandom sequences").
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Points that are spread evenly over triangles: one for each square of this width, which must be positive. Colours and
/// normals are between those of the vertices.
#[must_use]
pub fn samples(vertices: &[CloudPoint], triangles: &[[u32; 3]], spacing: f64) -> Cloud {
    let mut points = Cloud::new();
    let (mut due, mut place) = (0.5, [0.5; 2]);
    for &triangle in triangles {
        let corners = triangle.map(|vertex| &vertices[vertex as usize]);
        due += area_of(corners) / (spacing * spacing);
        while due >= 1.0 {
            due -= 1.0;
            place = [0, 1].map(|axis| (place[axis] + STEPS[axis]).fract());
            // The upper half of the square is folded onto the triangle.
            let [u, v] = if place[0] + place[1] > 1.0 { place.map(|x| 1.0 - x) } else { place };
            points.push(between(corners, [1.0 - u - v, u, v]));
        }
    }
    points
}

/// The area of all triangles.
#[must_use]
pub fn area(vertices: &[CloudPoint], triangles: &[[u32; 3]]) -> f64 {
    triangles.iter().map(|triangle| area_of(triangle.map(|vertex| &vertices[vertex as usize]))).sum()
}

/// The area of a triangle; 0 if it is not finite.
fn area_of(corners: [&CloudPoint; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| Vector3::from(corner.x_in_world));
    Some((b - a).cross(&(c - a)).norm() / 2.0).filter(|area| area.is_finite()).unwrap_or(0.0)
}

/// The point with these barycentric coordinates.
fn between(corners: [&CloudPoint; 3], shares: [f64; 3]) -> CloudPoint {
    let mean = |value: &dyn Fn(&CloudPoint) -> f64| -> f64 {
        corners.iter().zip(shares).map(|(corner, share)| share * value(corner)).sum()
    };
    CloudPoint {
        x_in_world: std::array::from_fn(|axis| mean(&|corner| corner.x_in_world[axis])),
        normal: std::array::from_fn(|axis| mean(&|corner| f64::from(corner.normal[axis])) as f32),
        colour: std::array::from_fn(|axis| mean(&|corner| f64::from(corner.colour[axis])).round() as u8),
        ..*corners[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_on_the_triangles_as_dense_as_asked_for() {
        let vertex = |x: f64, y: f64| CloudPoint {
            x_in_world: [x, y, 3.0],
            normal: [0.0, 0.0, 1.0],
            colour: [(100.0 * x) as u8, 0, 7],
            confidence: 1.0,
            sigma: 0.0,
            views: 2,
        };
        // A square of 2×1, of a large and two small triangles.
        let vertices =
            [vertex(0.0, 0.0), vertex(2.0, 0.0), vertex(2.0, 1.0), vertex(0.0, 1.0), vertex(1.0, 1.0)];
        let points = samples(&vertices, &[[0, 1, 4], [1, 2, 4], [0, 4, 3]], 0.02);
        assert!(points.len().abs_diff(5000) <= 1, "{}", points.len());
        for left in [0.0, 0.5, 1.0, 1.5] {
            let inside = |point: &&CloudPoint| (left..left + 0.5).contains(&point.x_in_world[0]);
            let count = points.iter().filter(inside).count();
            assert!(count.abs_diff(1250) < 40, "{count} at {left}");
        }
        for point in points {
            assert!((point.x_in_world[2] - 3.0).abs() < 1e-12 && (0.0..=1.0).contains(&point.x_in_world[1]));
            assert!((f64::from(point.colour[0]) - 100.0 * point.x_in_world[0]).abs() <= 0.51);
        }
    }
}
