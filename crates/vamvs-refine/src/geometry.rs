//! A source view's own depth map, compared with a reference pixel.

use vamvs_core::depth_map::is_valid;
use vamvs_core::{DepthMap, Grid, Pinhole, Pose};

use crate::transfer::Transfer;

/// Neighbouring inverse depths belong to two surfaces if they differ by more than this share.
const JUMP: f32 = 0.02;

/// A source's depth map, with the projection back to the reference view.
pub(crate) struct Geometry {
    /// Inverse depth; 0 where there is none.
    inverse: Grid<f32>,
    /// Factor and offset, for x and for y, from image coordinates of the source's photograph to those of the map.
    to_map: [[f32; 2]; 2],
    to_reference: Transfer,
}

/// The surface of a source's own depth map at the position where the source sees a reference pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// The forward-backward reprojection error: the distance from the reference pixel's centre to the projection of
    /// the source's surface, pixels.
    pub way: f32,
    /// The surface's inverse depth in the reference view.
    pub w: f32,
}

impl Geometry {
    /// The geometry of a depth map of the view `source`, whose camera has the photograph's size; the map may have any
    /// size.
    pub fn new(map: &DepthMap, source: (&Pinhole, &Pose), reference: (&Pinhole, &Pose)) -> Self {
        let (of_map, of_photo) = (&map.camera.intrinsics, &source.0.intrinsics);
        let along = |f_map: f64, c_map: f64, f_photo: f64, c_photo: f64| {
            let factor = f_map / f_photo;
            [factor as f32, (c_map - factor * c_photo) as f32]
        };
        Self {
            inverse: map.depth.map(|&depth| if is_valid(depth) { 1.0 / depth } else { 0.0 }),
            to_map: [
                along(of_map.fx, of_map.cx, of_photo.fx, of_photo.cx),
                along(of_map.fy, of_map.cy, of_photo.fy, of_photo.cy),
            ],
            to_reference: Transfer::new(source, reference),
        }
    }

    /// Projects the source's depth at `(u, v)`, in its photograph, back to the reference view, where `(x, y)` is the
    /// centre of the pixel that the source sees there. `None` if the source has no depth there, or the point is
    /// behind the reference camera.
    #[inline]
    pub fn seen(&self, (u, v): (f32, f32), (x, y): (f32, f32)) -> Option<Seen> {
        let [[scale_x, shift_x], [scale_y, shift_y]] = self.to_map;
        let w_in_source = self.at(u * scale_x + shift_x, v * scale_y + shift_y).filter(|&w| w > 0.0)?;
        let back = self.to_reference.seen(self.to_reference.ray(u, v), w_in_source);
        if back[2] <= 0.0 {
            return None;
        }
        let (dx, dy) = (back[0] / back[2] - x, back[1] / back[2] - y);
        Some(Seen { way: (dx * dx + dy * dy).sqrt(), w: w_in_source / back[2] })
    }

    /// Inverse depth at image coordinates of the map: bilinear on one surface, else that of the nearest pixel. `None`
    /// outside of the map.
    #[inline]
    fn at(&self, u: f32, v: f32) -> Option<f32> {
        if u < 0.0 || v < 0.0 {
            return None;
        }
        let (x, y) = (u as usize, v as usize);
        let nearest = *self.inverse.get(x, y)?;
        let (left, top) = ((u - 0.5).max(0.0), (v - 0.5).max(0.0));
        let (x, y) = (left as usize, top as usize);
        if x + 1 >= self.inverse.width() || y + 1 >= self.inverse.height() {
            return Some(nearest);
        }
        let (upper, lower) = (&self.inverse.row(y)[x..x + 2], &self.inverse.row(y + 1)[x..x + 2]);
        let low = upper[0].min(upper[1]).min(lower[0]).min(lower[1]);
        let high = upper[0].max(upper[1]).max(lower[0]).max(lower[1]);
        if low < (1.0 - JUMP) * high {
            return Some(nearest);
        }
        let (fx, fy) = (left - x as f32, top - y as f32);
        let (upper, lower) = (upper[0] + fx * (upper[1] - upper[0]), lower[0] + fx * (lower[1] - lower[0]));
        Some(upper + fy * (lower - upper))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use vamvs_core::{Grid, Intrinsics, Size};

    const CAMERA: Pinhole = Pinhole {
        size: Size::new(80, 60),
        intrinsics: Intrinsics { fx: 100.0, fy: 100.0, cx: 40.0, cy: 30.0 },
    };

    fn at(x: f64) -> Pose {
        Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() }
    }

    #[test]
    fn the_way_back_is_the_disparity_between_the_depths() {
        let map = DepthMap {
            camera: CAMERA,
            cam_from_world: at(1.0),
            depth: Grid::filled(CAMERA.size, 4.0),
            confidence: Grid::filled(CAMERA.size, 1.0),
            coarse_confidence: None,
        };
        let geometry = Geometry::new(&map, (&CAMERA, &at(1.0)), (&CAMERA, &at(0.0)));
        let transfer = Transfer::new((&CAMERA, &at(0.0)), (&CAMERA, &at(1.0)));
        let seen = |x: f32, y: f32, w: f32| {
            let place = transfer.place(transfer.ray(x, y), w).unwrap();
            geometry.seen(place, (x, y))
        };
        // The disparity is 100 w: 25 pixels at the source's depth of 4.
        let near = seen(60.5, 20.5, 0.24).unwrap();
        assert!((near.way - 1.0).abs() < 1e-4 && (near.w - 0.25).abs() < 1e-6);
        assert!(seen(60.5, 20.5, 0.25).unwrap().way < 1e-4);
        assert_eq!(seen(20.5, 20.5, 0.25), None, "outside of the source's image, on the left");
        // The same map, now as one of half the size of a larger photograph.
        let twice = CAMERA.resized(Size::new(160, 120));
        let smaller = Geometry::new(&map, (&twice, &at(1.0)), (&CAMERA, &at(0.0)));
        assert!(smaller.seen((71.0, 41.0), (60.5, 20.5)).unwrap().way < 1e-4);
    }

    #[test]
    fn depth_between_pixels_is_interpolated_on_a_surface_and_not_over_an_edge() {
        let at_x = |x: usize| if x < 40 { 0.25 + 1e-4 * x as f32 } else { 0.5 };
        let map = DepthMap {
            camera: CAMERA,
            cam_from_world: at(0.0),
            depth: Grid::from_fn(CAMERA.size, |x, _| 1.0 / at_x(x)),
            confidence: Grid::filled(CAMERA.size, 1.0),
            coarse_confidence: None,
        };
        let geometry = Geometry::new(&map, (&CAMERA, &at(0.0)), (&CAMERA, &at(0.0)));
        let w = geometry.at(20.75, 30.2).unwrap();
        assert!((w - (0.25 + 1e-4 * 20.25)).abs() < 1e-6, "{w}");
        assert_eq!(geometry.at(39.9, 30.2), geometry.at(39.5, 30.5), "the pixel's own");
        assert!(geometry.at(40.1, 30.2).unwrap() > 0.49);
        assert_eq!(geometry.at(80.5, 30.2), None);
    }
}
