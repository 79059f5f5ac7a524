//! Ray-triangle intersection without cracks between neighbouring triangles (Woop, Benthin and Wald,
//! "Watertight ray/triangle intersection", 2013).

/// The corners of a triangle in the world.
pub(crate) type Corners = [[f32; 3]; 3];

/// A ray, prepared for tests against many triangles. Space is sheared so that the ray runs along an axis; then
/// each edge test is one 2D expression, which both triangles at an edge evaluate alike.
pub(crate) struct Sheared {
    origin: [f32; 3],
    axes: [usize; 3],
    shear: [f32; 3],
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Crossing {
    /// The ray's parameter, in lengths of its direction; negative behind the origin.
    pub t: f32,
    /// Weights of the three corners, with sum 1.
    pub weights: [f32; 3],
}

impl Sheared {
    pub fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        let size = direction.map(f32::abs);
        let z = if size[0] > size[1] && size[0] > size[2] {
            0
        } else if size[1] > size[2] {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let scale = 1.0 / direction[z];
        Self { origin, axes: [x, y, z], shear: [direction[x] * scale, direction[y] * scale, scale] }
    }

    /// Where the line through the ray meets the triangle, from either side.
    #[inline(always)]
    pub fn meet(&self, corners: &Corners) -> Option<Crossing> {
        let [a, b, c] = [self.along(&corners[0]), self.along(&corners[1]), self.along(&corners[2])];
        let edges = [edge(&c, &b), edge(&a, &c), edge(&b, &a)];
        if edges.iter().any(|&e| e < 0.0) && edges.iter().any(|&e| e > 0.0) {
            return None;
        }
        let sum = edges[0] + edges[1] + edges[2];
        if sum == 0.0 {
            return None;
        }
        let weights = edges.map(|e| e / sum);
        let t = self.shear[2] * (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]);
        Some(Crossing { t, weights })
    }

    /// The point in sheared coordinates relative to the origin: two across the ray and one along it.
    #[inline]
    fn along(&self, point: &[f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.axes.map(|axis| point[axis] - self.origin[axis]);
        [x - self.shear[0] * z, y - self.shear[1] * z, z]
    }
}

/// Twice the signed area of the triangle between the ray and an edge. Where it is 0 in single precision, double
/// precision decides the side.
#[inline]
fn edge(p: &[f32; 3], q: &[f32; 3]) -> f32 {
    let area = p[0] * q[1] - p[1] * q[0];
    if area != 0.0 {
        return area;
    }
    (f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0])) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: Corners = [[0.0, 0.0, 2.0], [4.0, 0.0, 2.0], [0.0, 4.0, 6.0]];

    #[test]
    fn crossings_have_the_ray_parameter_and_the_corners_weights() {
        let ray = Sheared::new([1.0, 1.0, 10.0], [0.0, 0.0, -2.0]);
        let crossing = ray.meet(&TRIANGLE).unwrap();
        assert!((crossing.t - 3.5).abs() < 1e-6);
        let expected = [0.5, 0.25, 0.25];
        assert!(crossing.weights.iter().zip(expected).all(|(w, e)| (w - e).abs() < 1e-6));
    }

    #[test]
    fn both_sides_are_met_and_rays_beside_it_miss() {
        for z in [-10.0, 10.0] {
            assert!(Sheared::new([1.0, 1.0, z], [0.0, 0.0, -z]).meet(&TRIANGLE).is_some());
            assert!(Sheared::new([2.1, 2.1, z], [0.0, 0.0, -z]).meet(&TRIANGLE).is_none());
        }
    }

    #[test]
    fn rays_through_a_shared_edge_meet_a_triangle_on_either_side() {
        let far = [0.3, 1.7, -0.4];
        let edge = [[0.1, -0.3, 1.3], [1.3, 0.9, 0.7]];
        let halves = [[edge[0], edge[1], far], [edge[1], edge[0], [0.7, -1.1, 1.9]]];
        let origin = [0.2, 0.4, 9.0];
        for step in 1..1000_u16 {
            let s = f32::from(step) / 1000.0;
            let target: [f32; 3] = std::array::from_fn(|i| edge[0][i] + s * (edge[1][i] - edge[0][i]));
            let ray = Sheared::new(origin, std::array::from_fn(|i| target[i] - origin[i]));
            assert!(halves.iter().any(|half| ray.meet(half).is_some()), "a crack at {s}");
        }
    }
}
