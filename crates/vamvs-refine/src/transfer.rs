//! The projection of a reference pixel's window into a source view, for any plane.

use vamvs_core::homography::PixelTransfer;
use vamvs_core::{Pinhole, Pose};

use crate::plane::Plane;

/// [`PixelTransfer`] in single precision and for inverse depth: the reference pixel p at inverse depth w projects to
/// the homogeneous source pixel `linear · p + w · offset`, whose third entry is the ratio of source depth to
/// reference depth.
///
/// It holds no world coordinates, so single precision is sufficient wherever the scene lies.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Transfer {
    linear: [[f32; 3]; 3],
    offset: [f32; 3],
}

/// The affine warp of a window into the source image: `(u, v)` is the centre, `(ux, vx)` its change per pixel to the
/// right and `(uy, vy)` its change per pixel down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Affine {
    pub u: f32,
    pub v: f32,
    pub ux: f32,
    pub uy: f32,
    pub vx: f32,
    pub vy: f32,
}

impl Transfer {
    pub fn new(reference: (&Pinhole, &Pose), source: (&Pinhole, &Pose)) -> Self {
        let source_from_reference = source.1.compose(&reference.1.inverse());
        let transfer = PixelTransfer::new(reference.0, source.0, &source_from_reference);
        let linear = transfer.linear.cast::<f32>();
        let row = |r: usize| [linear[(r, 0)], linear[(r, 1)], linear[(r, 2)]];
        Self { linear: [row(0), row(1), row(2)], offset: transfer.offset.cast::<f32>().into() }
    }

    /// `linear · (x, y, 1)`.
    #[inline]
    pub fn ray(&self, x: f32, y: f32) -> [f32; 3] {
        let along = |row: &[f32; 3]| row[0] * x + row[1] * y + row[2];
        let [first, second, third] = &self.linear;
        [along(first), along(second), along(third)]
    }

    /// The homogeneous source pixel of a reference pixel, given its [`Transfer::ray`], at inverse depth `w`.
    #[inline]
    pub fn seen(&self, ray: [f32; 3], w: f32) -> [f32; 3] {
        let o = &self.offset;
        [ray[0] + o[0] * w, ray[1] + o[1] * w, ray[2] + o[2] * w]
    }

    /// The source image coordinates of the pixel with this [`Transfer::ray`]; `None` behind the source camera.
    #[inline]
    pub fn place(&self, ray: [f32; 3], w: f32) -> Option<(f32, f32)> {
        let seen = self.seen(ray, w);
        (seen[2] > 0.0).then(|| (seen[0] / seen[2], seen[1] / seen[2]))
    }

    /// The warp of the window of the pixel with this [`Transfer::ray`]: the plane's homography, linearised at the
    /// window's centre. `None` if the point is not in front of the source camera.
    #[inline]
    pub fn affine(&self, ray: [f32; 3], plane: &Plane) -> Option<Affine> {
        let seen = self.seen(ray, plane.w);
        if seen[2] <= 0.0 {
            return None;
        }
        let scale = 1.0 / seen[2];
        let (u, v) = (seen[0] * scale, seen[1] * scale);
        let row = |row: usize, c: usize, g: f32| self.linear[row][c] + self.offset[row] * g;
        let along = |c: usize, g: f32| [row(0, c, g), row(1, c, g), row(2, c, g)];
        let (right, down) = (along(0, plane.gx), along(1, plane.gy));
        Some(Affine {
            u,
            v,
            ux: (right[0] - u * right[2]) * scale,
            uy: (down[0] - u * down[2]) * scale,
            vx: (right[1] - v * right[2]) * scale,
            vy: (down[1] - v * down[2]) * scale,
        })
    }

    /// The derivative of the source image coordinates with respect to inverse depth, source pixels per unit; 0 behind
    /// the source camera.
    #[inline]
    pub fn speed(&self, ray: [f32; 3], w: f32) -> [f32; 2] {
        let seen = self.seen(ray, w);
        if seen[2] <= 0.0 {
            return [0.0; 2];
        }
        let scale = 1.0 / seen[2];
        let along = |c: usize| (self.offset[c] - seen[c] * scale * self.offset[2]) * scale;
        [along(0), along(1)]
    }

    /// The length of [`Transfer::speed`]: source pixels per unit of inverse depth.
    #[inline]
    pub fn disparity(&self, ray: [f32; 3], w: f32) -> f32 {
        let [u, v] = self.speed(ray, w);
        (u * u + v * v).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};
    use vamvs_core::{Intrinsics, Size};

    const CAMERA: Pinhole = Pinhole {
        size: Size::new(640, 480),
        intrinsics: Intrinsics { fx: 700.0, fy: 710.0, cx: 310.0, cy: 250.0 },
    };

    fn pose(eye: [f64; 3]) -> Pose {
        Pose::look_at(&Vector3::from(eye), &Vector3::new(0.0, 0.1, 4.0), &-Vector3::y())
    }

    #[test]
    fn the_affine_warp_is_the_homography_and_its_derivative() {
        let (here, there) = (pose([0.0; 3]), pose([0.6, 0.2, -0.3]));
        let transfer = Transfer::new((&CAMERA, &here), (&CAMERA, &there));
        let exact = PixelTransfer::new(&CAMERA, &CAMERA, &there.compose(&here.inverse()));
        let plane = Plane { w: 0.25, gx: 2e-4, gy: -1e-4 };
        let warp = transfer.affine(transfer.ray(200.5, 300.5), &plane).unwrap();
        for (dx, dy) in [(0.0_f32, 0.0_f32), (2.0, 0.0), (0.0, 2.0), (-3.0, 3.0)] {
            let pixel = Vector2::new(200.5 + f64::from(dx), 300.5 + f64::from(dy));
            let depth = 1.0 / f64::from(plane.seen_from(dx, dy).w);
            let (seen, _) = exact.project(&pixel, depth).unwrap();
            let u = warp.u + warp.ux * dx + warp.uy * dy;
            let v = warp.v + warp.vx * dx + warp.vy * dy;
            assert!((f64::from(u) - seen.x).abs() < 6e-3 && (f64::from(v) - seen.y).abs() < 6e-3);
        }
    }

    #[test]
    fn disparity_is_the_speed_of_the_source_pixel() {
        let (here, there) = (pose([0.0; 3]), pose([0.6, 0.2, -0.3]));
        let transfer = Transfer::new((&CAMERA, &here), (&CAMERA, &there));
        let ray = transfer.ray(120.5, 80.5);
        let at = |w: f32| transfer.affine(ray, &Plane { w, gx: 0.0, gy: 0.0 }).unwrap();
        let (a, b) = (at(0.249), at(0.251));
        let speed = ((b.u - a.u).powi(2) + (b.v - a.v).powi(2)).sqrt() / 0.002;
        assert!((transfer.disparity(ray, 0.25) / speed - 1.0).abs() < 2e-3);
    }
}
