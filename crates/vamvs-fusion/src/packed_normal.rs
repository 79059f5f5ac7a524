//! Unit normals in four bytes.

use vamvs_core::widened;

/// A unit normal or none, in octahedral encoding (Cigolle et al. 2014), exact to 0.006°: two coordinates of 16 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PackedNormal(u32);

/// The coordinates of no normal: no point of the square has them.
const NONE: i16 = i16::MIN;

/// The largest coordinate.
const SCALE: f32 = i16::MAX as f32;

widened! {
    /// Packs vectors of any length.
    pub(crate) fn pack(vectors: &[[f32; 3]], normals: &mut [PackedNormal]) = pack_any;
}

#[inline(always)]
fn pack_any(vectors: &[[f32; 3]], normals: &mut [PackedNormal]) {
    for (normal, vector) in normals.iter_mut().zip(vectors) {
        *normal = PackedNormal::new(*vector);
    }
}

impl PackedNormal {
    /// No normal.
    pub const NONE: Self = Self::of([NONE; 2]);

    #[inline(always)]
    const fn of([u, v]: [i16; 2]) -> Self {
        Self(u as u16 as u32 | (v as u16 as u32) << 16)
    }

    /// The nearest normal that can be packed; none for a vector without length.
    // Without branches, so that many at once are compiled for the widest vectors.
    #[inline(always)]
    pub fn new([x, y, z]: [f32; 3]) -> Self {
        let sum = x.abs() + y.abs() + z.abs();
        // 1 over a smaller sum would be infinite.
        let has_length = (sum > f32::MIN_POSITIVE) & (sum < f32::INFINITY);
        let per_sum = if has_length { 1.0 / sum } else { 0.0 };
        let (x, y, z) = if has_length { (x, y, z) } else { (0.0, 0.0, 0.0) };
        let (u, v) = (x * per_sum, y * per_sum);
        let (u, v) = if z < 0.0 { folded(u, v) } else { (u, v) };
        let packed = [rounded(u * SCALE), rounded(v * SCALE)];
        if has_length { Self::of(packed) } else { Self::NONE }
    }

    /// The components of the unit normal; 0 if there is none.
    #[inline(always)]
    pub fn components(self) -> [f32; 3] {
        let (first, second) = ((self.0 << 16) as i32 >> 16, self.0 as i32 >> 16);
        let (u, v) = (first as f32 * (1.0 / SCALE), second as f32 * (1.0 / SCALE));
        let z = 1.0 - u.abs() - v.abs();
        let (x, y) = if z < 0.0 { folded(u, v) } else { (u, v) };
        let per_length = if first == NONE as i32 { 0.0 } else { 1.0 / (x * x + y * y + z * z).sqrt() };
        [x * per_length, y * per_length, z * per_length]
    }
}

/// The nearest whole number.
#[inline(always)]
fn rounded(coordinate: f32) -> i16 {
    // SAFETY: coordinates are finite and at most `SCALE` and some rounding, far below 2³¹.
    let whole: i32 = unsafe { (coordinate + 0.5_f32.copysign(coordinate)).to_int_unchecked() };
    whole.clamp(-(SCALE as i32), SCALE as i32) as i16
}

/// Swaps the lower half of the octahedron with the corners of the square, where it is stored.
#[inline(always)]
fn folded(u: f32, v: f32) -> (f32, f32) {
    ((1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn normals_in_all_directions_come_back() {
        for i in 0..2000 {
            let [a, b] = [0.618_034, 0.754_877].map(|step: f32| (i as f32 * step).fract());
            let (z, angle) = (2.0 * a - 1.0, std::f32::consts::TAU * b);
            let radius = (1.0 - z * z).sqrt();
            let normal = Vector3::new(radius * angle.cos(), radius * angle.sin(), z);
            let back = Vector3::from(PackedNormal::new((3.0 * normal).into()).components());
            assert!((back - normal).norm() < 1e-4, "{normal} became {back}");
        }
        for none in [[0.0; 3], [f32::NAN, 0.0, 1.0], [f32::INFINITY, 0.0, 0.0], [1e-40, 0.0, 0.0]] {
            assert_eq!(PackedNormal::new(none).components(), [0.0; 3]);
        }
    }
}
