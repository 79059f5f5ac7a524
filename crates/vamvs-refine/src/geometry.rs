//! A source view's own depth map, compared with a reference pixel.

use vamvs_core::depth_map::is_valid;
use vamvs_core::{DepthMap, Grid, Pinhole, Pose, Size};

use crate::sampling::{at_least, at_most};
use crate::transfer::{Four, TOGETHER, Transfer, Transfers};

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

/// The depth maps of at most four source views.
pub(crate) struct Geometries {
    each: Four<Option<Geometry>>,
    to_reference: Transfers,
}

/// The surfaces of four sources' own depth maps at the positions where the sources see a reference pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// The forward-backward reprojection error: the distance from the reference pixel's centre to the projection of
    /// the source's surface, pixels; infinite where there is no such surface.
    pub way: Four,
    /// The surface's inverse depth in the reference view.
    pub w: Four,
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

    /// Inverse depth at image coordinates of the source's photograph: bilinear on one surface, else that of the nearest
    /// pixel. 0 where there is none, as outside of the map.
    #[inline]
    fn at(&self, u: f32, v: f32) -> f32 {
        let [[scale_x, shift_x], [scale_y, shift_y]] = self.to_map;
        let (u, v) = (u * scale_x + shift_x, v * scale_y + shift_y);
        let (width, height) = (self.inverse.width(), self.inverse.height());
        let inside = u >= 0.0 && v >= 0.0 && u < width as f32 && v < height as f32;
        if !inside {
            return 0.0;
        }
        let nearest = || self.inverse[(u as usize, v as usize)];
        let (left, top) = (at_least(u - 0.5, 0.0), at_least(v - 0.5, 0.0));
        let (x, y) = (left as usize, top as usize);
        if x + 1 >= width || y + 1 >= height {
            return nearest();
        }
        let four = &self.inverse.data()[y * width + x..][..width + 2];
        let ([a, b], [c, d]) = ([four[0], four[1]], [four[width], four[width + 1]]);
        let (low, high) = (at_most(at_most(a, b), at_most(c, d)), at_least(at_least(a, b), at_least(c, d)));
        if low < (1.0 - JUMP) * high {
            return nearest();
        }
        let (fx, fy) = (left - x as f32, top - y as f32);
        let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
        upper + fy * (lower - upper)
    }
}

impl Geometries {
    /// The geometries of at most four views, `None` for those without a depth map.
    pub fn new(views: impl IntoIterator<Item = Option<Geometry>>) -> Self {
        let mut each = Four::default();
        each.iter_mut().zip(views).for_each(|(to, view)| *to = view);
        let nowhere = Transfer::default();
        let transfers = each.each_ref().map(|view| view.as_ref().map_or(&nowhere, |view| &view.to_reference));
        let to_reference = Transfers::new(transfers.into_iter().map(|transfer| (transfer, Size::new(0, 0))));
        Self { each, to_reference }
    }

    /// The reprojection errors of those sources that are `wanted`, as [`Geometries::seen`] gives them, at most `most`; 0 of
    /// sources without a depth map.
    #[inline]
    pub fn errors(&self, wanted: &Four<bool>, at: (&Four, &Four), pixel: (f32, f32), most: f32) -> Four {
        let Seen { mut way, .. } = self.seen(wanted, at, pixel);
        for (way, geometry) in way.iter_mut().zip(&self.each) {
            *way = if geometry.is_some() { way.min(most) } else { 0.0 };
        }
        way
    }

    /// Projects the depths of those sources that are `wanted` at `(u, v)`, in their photographs, back to the reference
    /// view, where `(x, y)` is the centre of the pixel that the sources see there.
    #[inline]
    pub fn seen(&self, wanted: &Four<bool>, (u, v): (&Four, &Four), (x, y): (f32, f32)) -> Seen {
        let mut in_source = [0.0; TOGETHER];
        for (i, geometry) in self.each.iter().enumerate() {
            if wanted[i]
                && let Some(geometry) = geometry
            {
                in_source[i] = geometry.at(u[i], v[i]);
            }
        }
        let back = self.to_reference.seen(&self.to_reference.rays_of(u, v), &in_source);
        let (mut way, mut w) = ([0.0; TOGETHER], [0.0; TOGETHER]);
        for i in 0..TOGETHER {
            let (dx, dy) = (back[0][i] / back[2][i] - x, back[1][i] / back[2][i] - y);
            let is_there = (in_source[i] > 0.0) & (back[2][i] > 0.0);
            way[i] = if is_there { (dx * dx + dy * dy).sqrt() } else { f32::INFINITY };
            w[i] = in_source[i] / back[2][i];
        }
        Seen { way, w }
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
        let alone = |geometry| Geometries::new([None, Some(geometry)]);
        let geometry = alone(Geometry::new(&map, (&CAMERA, &at(1.0)), (&CAMERA, &at(0.0))));
        // The disparity is 100 w: 25 pixels at the source's depth of 4.
        let seen = |x: f32, y: f32, w: f32| {
            let found =
                geometry.seen(&[true; TOGETHER], (&[x - 100.0 * w; TOGETHER], &[y; TOGETHER]), (x, y));
            assert_eq!([found.way[0], found.way[2], found.way[3]], [f32::INFINITY; 3], "there is one map");
            (found.way[1], found.w[1])
        };
        let (way, w) = seen(60.5, 20.5, 0.24);
        assert!((way - 1.0).abs() < 1e-4 && (w - 0.25).abs() < 1e-6);
        assert!(seen(60.5, 20.5, 0.25).0 < 1e-4);
        assert_eq!(seen(20.5, 20.5, 0.25).0, f32::INFINITY, "outside of the source's image, on the left");
        let unwanted =
            geometry.seen(&[false; TOGETHER], (&[35.5; TOGETHER], &[20.5; TOGETHER]), (60.5, 20.5));
        assert_eq!(unwanted.way, [f32::INFINITY; TOGETHER]);
        // The same map, now as one of half the size of a larger photograph.
        let twice = CAMERA.resized(Size::new(160, 120));
        let smaller = alone(Geometry::new(&map, (&twice, &at(1.0)), (&CAMERA, &at(0.0))));
        let found = smaller.seen(&[true; TOGETHER], (&[71.0; TOGETHER], &[41.0; TOGETHER]), (60.5, 20.5));
        assert!(found.way[1] < 1e-4);
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
        let w = geometry.at(20.75, 30.2);
        assert!((w - (0.25 + 1e-4 * 20.25)).abs() < 1e-6, "{w}");
        assert_eq!(geometry.at(39.9, 30.2), geometry.at(39.5, 30.5), "the pixel's own");
        assert!(geometry.at(40.1, 30.2) > 0.49);
        assert_eq!(geometry.at(80.5, 30.2), 0.0);
    }
}
