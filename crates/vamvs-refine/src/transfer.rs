//! The projection of a reference pixel's window into a source view, for any plane.

use vamvs_core::homography::PixelTransfer;
use vamvs_core::{Pinhole, Pose, Size};
use wide::f32x4;

use crate::matching::Projection;
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

    pub fn projection(&self) -> Projection {
        Projection { linear: self.linear, offset: self.offset }
    }
}

/// Source views whose projections and correlations are computed together.
pub(crate) const TOGETHER: usize = 4;

/// A number for each of these views.
pub(crate) type Four = f32x4;

/// A set of source views, one bit per view.
pub(crate) type Views = u16;

/// All views of a group.
pub(crate) const ALL_TOGETHER: Views = (1 << TOGETHER) - 1;

/// The indices of the views of a set, ascending.
#[inline]
pub(crate) fn indices(views: Views) -> impl Iterator<Item = usize> {
    let next = |left: &Views| Some(left & (left - 1)).filter(|_| *left != 0);
    std::iter::successors((views != 0).then_some(views), move |left| next(left).filter(|left| *left != 0))
        .map(|left| left.trailing_zeros() as usize)
}

/// The views of a set that are in a group of [`TOGETHER`], the first of the group in the lowest bit.
pub(crate) fn of_group(views: Views, group: usize) -> Views {
    (views >> (group * TOGETHER)) & ALL_TOGETHER
}

/// The [`Transfer`]s to at most four source views.
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
    /// The images in which the centre lies; of others it may be behind the camera and the rest meaningless.
    pub inside: Views,
}

impl Warps {
    /// The same warp into all images.
    #[cfg(test)]
    pub fn all(warp: &Affine) -> Self {
        let Affine { u, v, ux, uy, vx, vy } = *warp;
        let [u, v, ux, uy, vx, vy] = [u, v, ux, uy, vx, vy].map(Four::splat);
        Self { u, v, ux, uy, vx, vy, inside: ALL_TOGETHER }
    }

    /// The warp into one of the images; `None` if the pixel projects outside of it.
    #[inline]
    pub fn of(&self, view: usize) -> Option<Affine> {
        let of = |values: &Four| values.as_array()[view];
        (self.inside >> view & 1 == 1).then(|| Affine {
            u: of(&self.u),
            v: of(&self.v),
            ux: of(&self.ux),
            uy: of(&self.uy),
            vx: of(&self.vx),
            vy: of(&self.vy),
        })
    }
}

/// The set of lanes in which a comparison holds.
#[inline]
pub(crate) fn lanes(mask: Four) -> Views {
    mask.to_bitmask() as Views
}

impl Transfers {
    /// The transfers to views whose images have these sizes, at most four.
    pub fn new<'a>(views: impl IntoIterator<Item = (&'a Transfer, Size)>) -> Self {
        let mut all = Self::default();
        let set = |to: &mut Four, view: usize, value: f32| to.as_mut_array()[view] = value;
        for (view, (transfer, size)) in views.into_iter().enumerate() {
            let linear = all.linear.iter_mut().flatten().zip(transfer.linear.iter().flatten());
            linear.for_each(|(to, value)| set(to, view, *value));
            all.offset.iter_mut().zip(&transfer.offset).for_each(|(to, value)| set(to, view, *value));
            set(&mut all.size[0], view, size.width as f32);
            set(&mut all.size[1], view, size.height as f32);
        }
        all
    }

    /// The transfer to one of the views.
    pub fn projection(&self, view: usize) -> Projection {
        let of = |value: &Four| value.as_array()[view];
        Projection {
            linear: self.linear.each_ref().map(|row| row.each_ref().map(of)),
            offset: self.offset.each_ref().map(of),
        }
    }

    /// `linear · (x, y, 1)` for each view.
    #[inline]
    pub fn rays(&self, x: f32, y: f32) -> [Four; 3] {
        self.rays_of(Four::splat(x), Four::splat(y))
    }

    /// The same for a position in each view.
    #[inline]
    pub fn rays_of(&self, x: Four, y: Four) -> [Four; 3] {
        self.linear.map(|row| row[0] * x + row[1] * y + row[2])
    }

    /// The homogeneous source pixels of a reference pixel, given its [`Transfers::rays`], at inverse depth `w`.
    #[inline]
    pub fn seen(&self, rays: &[Four; 3], w: Four) -> [Four; 3] {
        let ([a, b, c], [x, y, z]) = (rays, &self.offset);
        [*a + *x * w, *b + *y * w, *c + *z * w]
    }

    /// The warps of the window of the pixel with these [`Transfers::rays`]: the plane's homographies, linearised at the
    /// window's centre.
    #[inline]
    pub fn warps(&self, rays: &[Four; 3], plane: &Plane) -> Warps {
        let (l, o) = (&self.linear, &self.offset);
        let (gx, gy) = (Four::splat(plane.gx), Four::splat(plane.gy));
        let [x, y, z] = self.seen(rays, Four::splat(plane.w));
        let scale = Four::ONE / z;
        let (u, v) = (x * scale, y * scale);
        let right_z = l[2][0] + o[2] * gx;
        let down_z = l[2][1] + o[2] * gy;
        let in_image =
            u.simd_ge(Four::ZERO) & v.simd_ge(Four::ZERO) & u.simd_lt(self.size[0]) & v.simd_lt(self.size[1]);
        Warps {
            u,
            v,
            ux: (l[0][0] + o[0] * gx - u * right_z) * scale,
            uy: (l[0][1] + o[0] * gy - u * down_z) * scale,
            vx: (l[1][0] + o[1] * gx - v * right_z) * scale,
            vy: (l[1][1] + o[1] * gy - v * down_z) * scale,
            inside: lanes(z.simd_gt(Four::ZERO) & in_image),
        }
    }

    /// The derivatives of the source image coordinates with respect to inverse depth, source pixels per unit; 0 behind a
    /// source camera.
    #[inline]
    pub fn speeds(&self, rays: &[Four; 3], w: f32) -> [Four; 2] {
        let ([x, y, z], o) = (self.seen(rays, Four::splat(w)), &self.offset);
        let scale = z.simd_gt(Four::ZERO) & (Four::ONE / z);
        [(o[0] - x * scale * o[2]) * scale, (o[1] - y * scale * o[2]) * scale]
    }

    /// The lengths of [`Transfers::speeds`]: source pixels per unit of inverse depth, summed over the views.
    #[inline]
    pub fn disparity(&self, rays: &[Four; 3], w: f32) -> f32 {
        let [u, v] = self.speeds(rays, w);
        let [a, b, c, d] = (u * u + v * v).sqrt().to_array();
        a + b + c + d
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
    fn views_are_listed() {
        assert_eq!(indices(0).count(), 0);
        assert_eq!(indices(0b1001_0000_0000_0101).collect::<Vec<_>>(), [0, 2, 12, 15]);
        assert_eq!([0, 3].map(|group| of_group(0b1001_0000_0000_0101, group)), [0b0101, 0b1001]);
    }

    #[test]
    fn the_affine_warp_is_the_homography_and_its_derivative() {
        let (transfers, exact) = transfers();
        let plane = Plane { w: 0.25, gx: 2e-4, gy: -1e-4 };
        let warps = transfers.warps(&transfers.rays(200.5, 300.5), &plane);
        assert_eq!(warps.inside, 0b0011, "there are two views");
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
            assert_eq!(transfers.warps(&transfers.rays(200.5, 300.5), &plane).inside, 0);
        }
    }

    #[test]
    fn disparity_is_the_speed_of_the_source_pixels() {
        let (transfers, _) = transfers();
        let rays = transfers.rays(120.5, 80.5);
        let at = |w: f32| transfers.warps(&rays, &Plane { w, gx: 0.0, gy: 0.0 });
        let (a, b) = (at(0.249), at(0.251));
        let speed = |view: usize| {
            let (du, dv) = ((b.u - a.u).to_array()[view], (b.v - a.v).to_array()[view]);
            du.hypot(dv) / 0.002
        };
        assert!((transfers.disparity(&rays, 0.25) / (speed(0) + speed(1)) - 1.0).abs() < 2e-3);
    }
}
