//! The projection of a reference pixel's window into a source view, for any plane.

use vamvs_core::homography::PixelTransfer;
use vamvs_core::{Pinhole, Pose, Size};

use crate::plane::Plane;

/// [`PixelTransfer`] in single precision and for inverse depth: the reference pixel p at inverse depth w projects to
/// the homogeneous source pixel `linear · p + w · offset`, whose third entry is the ratio of source depth to
/// reference depth.
///
/// It holds no world coordinates, so single precision is sufficient wherever the scene lies.
#[derive(Clone, Copy, Debug, Default)]
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
}

/// A value for each of four source views, whose projections are computed together.
pub(crate) type Four<T = f32> = [T; TOGETHER];

/// Source views whose projections and correlations are computed together.
pub(crate) const TOGETHER: usize = 4;

/// The [`Transfer`]s to at most four source views. Each operation is done for all of them, in vector registers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Transfers {
    linear: [[Four; 3]; 3],
    offset: [Four; 3],
    /// Width and height of the images, pixels; 0 where there is no view.
    size: [Four; 2],
}

/// The [`Affine`] warps of a window into four source images.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Warps {
    pub u: Four,
    pub v: Four,
    pub ux: Four,
    pub uy: Four,
    pub vx: Four,
    pub vy: Four,
    /// Whether the centre lies in the image; if not, it may be behind the camera and the rest meaningless.
    pub inside: Four<bool>,
}

impl Warps {
    /// The same warp into all images.
    #[cfg(test)]
    pub fn all(warp: &Affine) -> Self {
        let Affine { u, v, ux, uy, vx, vy } = *warp;
        let [u, v, ux, uy, vx, vy] = [u, v, ux, uy, vx, vy].map(|value| [value; TOGETHER]);
        Self { u, v, ux, uy, vx, vy, inside: [true; TOGETHER] }
    }

    /// The warp into one of the images; `None` if the pixel projects outside of it.
    #[inline]
    pub fn of(&self, view: usize) -> Option<Affine> {
        self.inside[view].then(|| Affine {
            u: self.u[view],
            v: self.v[view],
            ux: self.ux[view],
            uy: self.uy[view],
            vx: self.vx[view],
            vy: self.vy[view],
        })
    }
}

// Loops over four values, which the compiler turns into vector instructions.
impl Transfers {
    /// The transfers to views whose images have these sizes, at most four.
    pub fn new<'a>(views: impl IntoIterator<Item = (&'a Transfer, Size)>) -> Self {
        let mut all = Self::default();
        for (view, (transfer, size)) in views.into_iter().enumerate() {
            for (row, values) in all.linear.iter_mut().zip(&transfer.linear) {
                row.iter_mut().zip(values).for_each(|(to, value)| to[view] = *value);
            }
            all.offset.iter_mut().zip(&transfer.offset).for_each(|(to, value)| to[view] = *value);
            (all.size[0][view], all.size[1][view]) = (size.width as f32, size.height as f32);
        }
        all
    }

    /// `linear · (x, y, 1)` for each view.
    #[inline]
    pub fn rays(&self, x: f32, y: f32) -> [Four; 3] {
        self.rays_of(&[x; TOGETHER], &[y; TOGETHER])
    }

    /// The same for a position in each view.
    #[inline]
    pub fn rays_of(&self, x: &Four, y: &Four) -> [Four; 3] {
        let mut rays = [[0.0; TOGETHER]; 3];
        for (ray, row) in rays.iter_mut().zip(&self.linear) {
            for i in 0..TOGETHER {
                ray[i] = row[0][i] * x[i] + row[1][i] * y[i] + row[2][i];
            }
        }
        rays
    }

    /// The homogeneous source pixels of a reference pixel, given its [`Transfers::rays`], at inverse depth `w`.
    #[inline]
    pub fn seen(&self, rays: &[Four; 3], w: &Four) -> [Four; 3] {
        let mut seen = [[0.0; TOGETHER]; 3];
        for (seen, (ray, offset)) in seen.iter_mut().zip(rays.iter().zip(&self.offset)) {
            for i in 0..TOGETHER {
                seen[i] = ray[i] + offset[i] * w[i];
            }
        }
        seen
    }

    /// The warps of the window of the pixel with these [`Transfers::rays`]: the plane's homographies, linearised at the
    /// window's centre.
    #[inline]
    pub fn warps(&self, rays: &[Four; 3], plane: &Plane) -> Warps {
        let (mut warps, l, o) = (Warps::default(), &self.linear, &self.offset);
        let seen = self.seen(rays, &[plane.w; TOGETHER]);
        for i in 0..TOGETHER {
            let scale = 1.0 / seen[2][i];
            let (u, v) = (seen[0][i] * scale, seen[1][i] * scale);
            let right_z = l[2][0][i] + o[2][i] * plane.gx;
            let down_z = l[2][1][i] + o[2][i] * plane.gy;
            warps.ux[i] = (l[0][0][i] + o[0][i] * plane.gx - u * right_z) * scale;
            warps.uy[i] = (l[0][1][i] + o[0][i] * plane.gy - u * down_z) * scale;
            warps.vx[i] = (l[1][0][i] + o[1][i] * plane.gx - v * right_z) * scale;
            warps.vy[i] = (l[1][1][i] + o[1][i] * plane.gy - v * down_z) * scale;
            (warps.u[i], warps.v[i]) = (u, v);
            let in_image = (u >= 0.0) & (v >= 0.0) & (u < self.size[0][i]) & (v < self.size[1][i]);
            warps.inside[i] = (seen[2][i] > 0.0) & in_image;
        }
        warps
    }

    /// The derivatives of the source image coordinates with respect to inverse depth, source pixels per unit; 0 behind a
    /// source camera.
    #[inline]
    pub fn speeds(&self, rays: &[Four; 3], w: f32) -> [Four; 2] {
        let (seen, o) = (self.seen(rays, &[w; TOGETHER]), &self.offset);
        let mut speeds = [[0.0; TOGETHER]; 2];
        for i in 0..TOGETHER {
            let scale = if seen[2][i] > 0.0 { 1.0 / seen[2][i] } else { 0.0 };
            speeds[0][i] = (o[0][i] - seen[0][i] * scale * o[2][i]) * scale;
            speeds[1][i] = (o[1][i] - seen[1][i] * scale * o[2][i]) * scale;
        }
        speeds
    }

    /// The lengths of [`Transfers::speeds`]: source pixels per unit of inverse depth, summed over the views.
    #[inline]
    pub fn disparity(&self, rays: &[Four; 3], w: f32) -> f32 {
        let [u, v] = self.speeds(rays, w);
        let mut lengths = [0.0; TOGETHER];
        for i in 0..TOGETHER {
            lengths[i] = (u[i] * u[i] + v[i] * v[i]).sqrt();
        }
        lengths[0] + lengths[1] + lengths[2] + lengths[3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};
    use vamvs_core::Intrinsics;

    const CAMERA: Pinhole = Pinhole {
        size: Size::new(640, 480),
        intrinsics: Intrinsics { fx: 700.0, fy: 710.0, cx: 310.0, cy: 250.0 },
    };

    fn pose(eye: [f64; 3]) -> Pose {
        Pose::look_at(&Vector3::from(eye), &Vector3::new(0.0, 0.1, 4.0), &-Vector3::y())
    }

    /// Transfers from a camera at the origin to two others, and their exact counterparts.
    fn transfers() -> (Transfers, [PixelTransfer; 2]) {
        let (here, there) = (pose([0.0; 3]), [pose([0.6, 0.2, -0.3]), pose([-0.4, 0.1, 0.2])]);
        let each = there.map(|there| Transfer::new((&CAMERA, &here), (&CAMERA, &there)));
        let exact = there.map(|there| PixelTransfer::new(&CAMERA, &CAMERA, &there.compose(&here.inverse())));
        (Transfers::new(each.iter().map(|transfer| (transfer, CAMERA.size))), exact)
    }

    #[test]
    fn the_affine_warp_is_the_homography_and_its_derivative() {
        let (transfers, exact) = transfers();
        let plane = Plane { w: 0.25, gx: 2e-4, gy: -1e-4 };
        let warps = transfers.warps(&transfers.rays(200.5, 300.5), &plane);
        assert_eq!(warps.inside, [true, true, false, false], "there are two views");
        for (view, exact) in exact.iter().enumerate() {
            let warp = warps.of(view).unwrap();
            for (dx, dy) in [(0.0_f32, 0.0_f32), (2.0, 0.0), (0.0, 2.0), (-3.0, 3.0)] {
                let pixel = Vector2::new(200.5 + f64::from(dx), 300.5 + f64::from(dy));
                let depth = 1.0 / f64::from(plane.seen_from(dx, dy).w);
                let (seen, _) = exact.project(&pixel, depth).unwrap();
                let u = warp.u + warp.ux * dx + warp.uy * dy;
                let v = warp.v + warp.vx * dx + warp.vy * dy;
                assert!((f64::from(u) - seen.x).abs() < 6e-3 && (f64::from(v) - seen.y).abs() < 6e-3);
            }
        }
        let (beside, behind) = (Plane { w: 5.0, ..plane }, Plane { w: -5.0, ..plane });
        for plane in [beside, behind] {
            assert_eq!(transfers.warps(&transfers.rays(200.5, 300.5), &plane).inside, [false; TOGETHER]);
        }
    }

    #[test]
    fn disparity_is_the_speed_of_the_source_pixels() {
        let (transfers, _) = transfers();
        let rays = transfers.rays(120.5, 80.5);
        let at = |w: f32| transfers.warps(&rays, &Plane { w, gx: 0.0, gy: 0.0 });
        let (a, b) = (at(0.249), at(0.251));
        let speed =
            |view: usize| ((b.u[view] - a.u[view]).powi(2) + (b.v[view] - a.v[view]).powi(2)).sqrt() / 0.002;
        assert!((transfers.disparity(&rays, 0.25) / (speed(0) + speed(1)) - 1.0).abs() < 2e-3);
    }
}
