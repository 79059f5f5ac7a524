//! The surface that a pixel sees, in eight bytes.

use nalgebra::Vector3;

/// The number of a standard deviation of 1.
const ONE: u32 = 64;

/// The bit that marks pixels at a jump of depth.
const AT_JUMP: u8 = 128;

/// The surface that a pixel sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PixelSurface {
    /// 0: there is no surface; negative: it is not known.
    pub depth: f32,
    /// Unit normal in the camera's frame, towards the camera, in 127ths.
    normal: [i8; 3],
    /// The standard deviation of the depth, as a multiple of the pixel's size: an exponent and two digits of a float; the
    /// highest bit says that the pixel is at a jump of depth.
    sigma: u8,
}

impl PixelSurface {
    /// `sigma` is a multiple of the pixel's size, the normal is of unit length.
    pub fn new(depth: f32, normal: Vector3<f32>, sigma: f32) -> Self {
        let number = ((sigma.to_bits() >> 21) + ONE).saturating_sub(1.0_f32.to_bits() >> 21).clamp(1, 127);
        let in_127ths = |x: f32| (127.0 * x).round() as i8;
        Self { depth, normal: [normal.x, normal.y, normal.z].map(in_127ths), sigma: number as u8 }
    }

    /// That of a pixel of which nothing is known.
    pub fn unknown() -> Self {
        Self { depth: -1.0, ..Self::default() }
    }

    /// The depth, and the rest in 32 bits, of which the highest says that the pixel is at a jump of depth.
    #[inline]
    pub fn parts(self) -> (f32, u32) {
        let [x, y, z] = self.normal.map(|x| x as u8);
        (self.depth, u32::from_le_bytes([x, y, z, self.sigma]))
    }

    /// The standard deviation of the depth, as a multiple of the pixel's size, to 13 %.
    pub fn sigma(self) -> f32 {
        sigma_of(self.parts().1)
    }

    /// The normal, in the camera's frame.
    pub fn normal(self) -> Vector3<f32> {
        let (_, packed) = self.parts();
        Vector3::from([0, 1, 2].map(|axis| normal_of(packed, axis)))
    }

    /// Notes that the pixel is at a jump of depth.
    pub fn mark_jump(&mut self) {
        self.sigma |= AT_JUMP;
    }

    /// Whether the pixel is at a jump of depth.
    pub fn is_at_jump(self) -> bool {
        self.sigma & AT_JUMP != 0
    }
}

/// A coordinate of the normal of [`PixelSurface::parts`].
#[inline]
pub(crate) fn normal_of(packed: u32, axis: usize) -> f32 {
    let highest = (packed << (24 - 8 * axis)) as i32;
    (highest >> 24) as f32 * (1.0 / 127.0)
}

/// The standard deviation of [`PixelSurface::parts`].
#[inline]
pub(crate) fn sigma_of(packed: u32) -> f32 {
    let number = (packed >> 24 & u32::from(!AT_JUMP)) + (1.0_f32.to_bits() >> 21) - ONE;
    f32::from_bits(number << 21 | 1 << 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_keeps_what_it_is_made_of() {
        let normal = Vector3::new(0.48, -0.6, -0.64);
        for sigma in [1e-3_f32, 0.3, 1.0, 7.5, 100.0] {
            let mut surface = PixelSurface::new(4.5, normal, sigma);
            assert!(!surface.is_at_jump());
            surface.mark_jump();
            assert!(surface.is_at_jump() && surface.depth == 4.5);
            assert!((surface.sigma() / sigma - 1.0).abs() <= 0.125, "{sigma}: {}", surface.sigma());
            assert!((surface.normal() - normal).amax() < 0.004);
        }
        assert!(PixelSurface::new(1.0, normal, 0.0).sigma() < 1e-4);
    }
}
