//! Local directions: those relative to a surface's normal.

use std::f32::consts::TAU;

use nalgebra::Vector3;

/// An orthonormal basis whose third axis is a normal (Duff et al., "Building an orthonormal basis,
/// revisited", 2017). Directions in it are called local.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    x: Vector3<f32>,
    y: Vector3<f32>,
    z: Vector3<f32>,
}

impl Frame {
    pub fn around(z: Vector3<f32>) -> Self {
        let sign = 1.0_f32.copysign(z.z);
        let a = -1.0 / (sign + z.z);
        let b = z.x * z.y * a;
        let x = Vector3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x);
        Self { x, y: Vector3::new(b, sign + z.y * z.y * a, -z.y), z }
    }

    pub fn normal(&self) -> &Vector3<f32> {
        &self.z
    }

    pub fn local(&self, in_world: &Vector3<f32>) -> Vector3<f32> {
        Vector3::new(self.x.dot(in_world), self.y.dot(in_world), self.z.dot(in_world))
    }

    pub fn world(&self, local: &Vector3<f32>) -> Vector3<f32> {
        self.x * local.x + self.y * local.y + self.z * local.z
    }
}

/// The local unit vector with z = `height` and an azimuth of `angle` (0 to 1) full turns.
pub(crate) fn around(height: f32, angle: f32) -> Vector3<f32> {
    let radius = (1.0 - height * height).max(0.0).sqrt();
    let (sin, cos) = (TAU * angle).sin_cos();
    Vector3::new(radius * cos, radius * sin, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_and_round_trip() {
        let v = Vector3::new(0.3, -0.5, 0.7);
        for z in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [-0.48, 0.6, 0.64]] {
            let frame = Frame::around(z.into());
            assert!((frame.world(&frame.local(&v)) - v).norm() < 1e-6);
            assert!((frame.x.cross(&frame.y) - frame.z).norm() < 1e-6);
        }
    }
}
