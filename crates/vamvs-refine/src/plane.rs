//! A plane in space, as one pixel of the reference view sees it.

use nalgebra::Vector3;
use vamvs_core::Intrinsics;

/// A plane as inverse depth: on a plane in space, 1/z is affine in image coordinates.
///
/// `w(x + dx, y + dy) = w + gx · dx + gy · dy` with (x, y) the centre of the pixel that the plane belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Plane {
    /// Inverse depth at the pixel's centre, 1 / scene unit; 0 if the pixel has no plane.
    pub w: f32,
    /// Change of inverse depth per pixel to the right.
    pub gx: f32,
    /// Change of inverse depth per pixel down.
    pub gy: f32,
}

impl Plane {
    /// The same plane seen from a pixel `dx` to the right and `dy` below.
    #[inline]
    pub fn seen_from(&self, dx: f32, dy: f32) -> Self {
        Self { w: self.w + self.gx * dx + self.gy * dy, ..*self }
    }

    /// The same plane in an image of `ratio` times the size, as the pixel `to` of that image sees it; the plane
    /// belongs to the pixel `from`.
    #[inline]
    pub fn enlarged(&self, ratio: f32, from: (usize, usize), to: (usize, usize)) -> Self {
        let offset = |from: usize, to: usize| to as f32 + 0.5 - ratio * (from as f32 + 0.5);
        Self { gx: self.gx / ratio, gy: self.gy / ratio, ..*self }
            .seen_from(offset(from.0, to.0), offset(from.1, to.1))
    }

    /// The plane's unit normal in the camera's frame, towards the camera; `(x, y)` is the centre of the pixel.
    pub fn normal(&self, camera: &Intrinsics, x: f64, y: f64) -> Vector3<f64> {
        let [w, gx, gy] = [self.w, self.gx, self.gy].map(f64::from);
        // Points X of the plane satisfy n · X = 1, so w = n · K⁻¹ (x, y, 1).
        let n = Vector3::new(gx * camera.fx, gy * camera.fy, w - gx * (x - camera.cx) - gy * (y - camera.cy));
        -n / n.norm()
    }

    /// The plane with `normal`, in the camera's frame, through the point at `depth` on the ray of the pixel with
    /// centre `(x, y)`.
    pub fn from_normal(normal: &Vector3<f64>, depth: f64, camera: &Intrinsics, x: f64, y: f64) -> Self {
        let ray = Vector3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
        let n = normal / (normal.dot(&ray) * depth);
        let finite = |v: f64| if v.is_finite() { v as f32 } else { 0.0 };
        Self { w: (1.0 / depth) as f32, gx: finite(n.x / camera.fx), gy: finite(n.y / camera.fy) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Intrinsics = Intrinsics { fx: 900.0, fy: 880.0, cx: 320.0, cy: 250.0 };

    #[test]
    fn inverse_depth_follows_the_plane_and_the_normal_comes_back() {
        let normal = Vector3::new(0.4, -0.3, -0.8).normalize();
        let plane = Plane::from_normal(&normal, 3.0, &CAMERA, 100.5, 400.5);
        assert!((plane.normal(&CAMERA, 100.5, 400.5) - normal).norm() < 1e-5);
        let ray =
            |x: f64, y: f64| Vector3::new((x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, 1.0);
        let distance = normal.dot(&(ray(100.5, 400.5) * 3.0));
        let depth = distance / normal.dot(&ray(131.5, 380.5));
        assert!((f64::from(plane.seen_from(31.0, -20.0).w) * depth - 1.0).abs() < 1e-5);
    }

    #[test]
    fn enlarging_the_image_keeps_the_plane() {
        let plane = Plane { w: 0.5, gx: 0.01, gy: -0.02 };
        let double = plane.enlarged(2.0, (7, 3), (14, 7));
        assert_eq!(double, Plane { w: 0.5 - 0.0025 - 0.005, gx: 0.005, gy: -0.01 });
        // The centre of pixel 13 lies 1.5 pixels of the larger image left of the centre of pixel 7 · 2 + 1 / 2.
        let fourfold = plane.enlarged(4.0, (3, 3), (12, 13));
        assert_eq!(fourfold, Plane { w: 0.5 - 1.5 * 0.0025 + 0.5 * 0.005, gx: 0.0025, gy: -0.005 });
    }
}
