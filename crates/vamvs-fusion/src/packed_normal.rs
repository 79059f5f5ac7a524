//! Unit normals in four bytes.

use nalgebra::Vector3;

/// A unit normal or none, in octahedral encoding (Cigolle et al. 2014), exact to 0.006°.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PackedNormal([i16; 2]);

/// No normal: no point of the square has this coordinate.
const NONE: i16 = i16::MIN;

/// The largest coordinate.
const SCALE: f32 = i16::MAX as f32;

impl PackedNormal {
    /// The nearest normal that can be packed; none for a vector without length.
    #[inline]
    pub fn new([x, y, z]: [f32; 3]) -> Self {
        let sum = x.abs() + y.abs() + z.abs();
        if !(sum > 0.0 && sum.is_finite()) {
            return Self([NONE; 2]);
        }
        let (u, v) = (x / sum, y / sum);
        let (u, v) = if z < 0.0 { folded(u, v) } else { (u, v) };
        // Rounds to the nearest: `as` truncates.
        Self([u, v].map(|c| (c * SCALE + 0.5_f32.copysign(c)) as i16))
    }

    /// The unit normal; 0 if there is none.
    #[inline]
    pub fn unpacked(self) -> Vector3<f32> {
        if self.0[0] == NONE {
            return Vector3::zeros();
        }
        let [u, v] = self.0.map(|c| f32::from(c) / SCALE);
        let z = 1.0 - u.abs() - v.abs();
        let (x, y) = if z < 0.0 { folded(u, v) } else { (u, v) };
        let normal = Vector3::new(x, y, z);
        normal / normal.norm()
    }
}

/// Swaps the lower half of the octahedron with the corners of the square, where it is stored.
#[inline]
fn folded(u: f32, v: f32) -> (f32, f32) {
    ((1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_in_all_directions_come_back() {
        for i in 0..2000 {
            let [a, b] = [0.618_034, 0.754_877].map(|step: f32| (i as f32 * step).fract());
            let (z, angle) = (2.0 * a - 1.0, std::f32::consts::TAU * b);
            let radius = (1.0 - z * z).sqrt();
            let normal = Vector3::new(radius * angle.cos(), radius * angle.sin(), z);
            let back = PackedNormal::new((3.0 * normal).into()).unpacked();
            assert!((back - normal).norm() < 1e-4, "{normal} became {back}");
        }
        for none in [[0.0; 3], [f32::NAN, 0.0, 1.0], [f32::INFINITY, 0.0, 0.0]] {
            assert_eq!(PackedNormal::new(none).unpacked(), Vector3::zeros());
        }
    }
}
