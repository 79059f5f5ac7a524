//! A source view's own depth map, compared with a reference pixel.

use vamvs_core::depth_map::is_valid;
use vamvs_core::{DepthMap, Grid, Pinhole, Pose, Size};

use crate::matching::SourceDepths;
use crate::transfer::{Four, TOGETHER, Transfer, Transfers, Views, indices, lanes};

/// Neighbouring inverse depths belong to two surfaces if they differ by more than this share.
pub(crate) const JUMP: f32 = 0.02;

/// A source's depth map, with the projection back to the reference view.
pub(crate) struct Geometry {
    /// Inverse depth; 0 where there is none. The last column and row are there twice.
    inverse: Grid<f32>,
    /// Factor and offset, for x and for y, from image coordinates of the source's photograph to those of the map.
    to_map: [[f32; 2]; 2],
    to_reference: Transfer,
}

/// The depth maps of at most four source views.
pub(crate) struct Geometries {
    inverse: [Option<Grid<f32>>; TOGETHER],
    /// Width and height of the maps; 0 where there is none.
    size: [Four; 2],
    to_map: [[Four; 2]; 2],
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
            inverse: inverse_with_edge(&map.depth),
            to_map: [
                along(of_map.fx, of_map.cx, of_photo.fx, of_photo.cx),
                along(of_map.fy, of_map.cy, of_photo.fy, of_photo.cy),
            ],
            to_reference: Transfer::new(source, reference),
        }
    }
}

/// Inverse depths, 0 where there is none, with the last column and row once more.
fn inverse_with_edge(depth: &Grid<f32>) -> Grid<f32> {
    let (width, height) = (depth.width(), depth.height());
    Grid::from_fn(Size::new(width + 1, height + 1), |x, y| {
        let depth = depth[(x.min(width - 1), y.min(height - 1))];
        if is_valid(depth) { 1.0 / depth } else { 0.0 }
    })
}

impl Geometries {
    /// The geometries of at most four views, `None` for those without a depth map.
    pub fn new(views: impl IntoIterator<Item = Option<Geometry>>) -> Self {
        let (mut inverse, mut to_reference) = ([const { None }; TOGETHER], [Transfer::default(); TOGETHER]);
        let (mut size, mut to_map) = ([[0.0; TOGETHER]; 2], [[[0.0; TOGETHER]; 2]; 2]);
        for (i, view) in views.into_iter().enumerate() {
            let Some(view) = view else { continue };
            (size[0][i], size[1][i]) =
                ((view.inverse.width() - 1) as f32, (view.inverse.height() - 1) as f32);
            let numbers = to_map.iter_mut().flatten().zip(view.to_map.iter().flatten());
            numbers.for_each(|(to, from)| to[i] = *from);
            (inverse[i], to_reference[i]) = (Some(view.inverse), view.to_reference);
        }
        Self {
            inverse,
            size: size.map(Four::new),
            to_map: to_map.map(|numbers| numbers.map(Four::new)),
            to_reference: Transfers::new(to_reference.iter().map(|transfer| (transfer, Size::new(0, 0)))),
        }
    }

    /// One of the maps.
    pub fn of(&self, view: usize) -> Option<SourceDepths<'_>> {
        let of = |value: &Four| value.as_array()[view];
        Some(SourceDepths {
            inverse: self.inverse[view].as_ref()?,
            to_map: self.to_map.each_ref().map(|numbers| numbers.each_ref().map(of)),
            back: self.to_reference.projection(view),
        })
    }

    /// Inverse depths of those maps that are `wanted`, at image coordinates of the sources' photographs: bilinear on one
    /// surface, else that of the nearest pixel. 0 where there is none, as outside of a map.
    #[inline]
    pub fn at(&self, wanted: Views, (u, v): (Four, Four)) -> Four {
        let [[scale_x, shift_x], [scale_y, shift_y]] = self.to_map;
        let (u, v) = (u * scale_x + shift_x, v * scale_y + shift_y);
        let [width, height] = self.size;
        let (zero, half) = (Four::ZERO, Four::HALF);
        let in_map = u.simd_ge(zero) & v.simd_ge(zero) & u.simd_lt(width) & v.simd_lt(height);
        let inside = lanes(in_map) & wanted;
        let (left, top) = ((u - half).fast_max(zero), (v - half).fast_max(zero));
        let (column, row) = (left.fast_trunc_int(), top.fast_trunc_int());
        let mut corners = [[0.0; TOGETHER]; 4];
        for i in indices(inside) {
            // A view without a map has none of its pixels inside.
            let Some(map) = &self.inverse[i] else { continue };
            let (column, row) = (column.as_array()[i] as usize, row.as_array()[i] as usize);
            let around = &map.data()[row * map.width() + column..][..map.width() + 2];
            let [a, b, c, d] = &mut corners;
            (a[i], b[i]) = (around[0], around[1]);
            (c[i], d[i]) = (around[map.width()], around[map.width() + 1]);
        }
        let [a, b, c, d] = corners.map(Four::new);
        let (fx, fy) = (left - column.round_float(), top - row.round_float());
        let (low, high) = (a.fast_min(b).fast_min(c.fast_min(d)), a.fast_max(b).fast_max(c.fast_max(d)));
        let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
        let between = upper + fy * (lower - upper);
        let is_left = fx.simd_lt(half);
        let nearest = fy.simd_lt(half).select(is_left.select(a, b), is_left.select(c, d));
        // Where coordinates are NaN, as behind a source's camera, so is `between` on processors whose maximum passes NaN on.
        in_map & low.simd_lt(Four::splat(1.0 - JUMP) * high).select(nearest, between)
    }

    /// The reprojection errors of those sources that are `wanted`, as [`Geometries::seen`] gives them, at most `most`; 0 of
    /// sources without a depth map.
    #[inline]
    pub fn errors(&self, wanted: Views, at: (Four, Four), pixel: (f32, f32), most: f32) -> Four {
        let there = self.size[0].simd_gt(Four::ZERO);
        there & self.seen(wanted, at, pixel).way.fast_min(Four::splat(most))
    }

    /// Projects the depths of those sources that are `wanted` at `(u, v)`, in their photographs, back to the reference
    /// view, where `(x, y)` is the centre of the pixel that the sources see there.
    #[inline]
    pub fn seen(&self, wanted: Views, (u, v): (Four, Four), (x, y): (f32, f32)) -> Seen {
        let in_source = self.at(wanted, (u, v));
        let back = self.to_reference.seen(&self.to_reference.rays_of(u, v), in_source);
        let (dx, dy) = (back[0] / back[2] - Four::splat(x), back[1] / back[2] - Four::splat(y));
        let is_there = in_source.simd_gt(Four::ZERO) & back[2].simd_gt(Four::ZERO);
        let way = is_there.select((dx * dx + dy * dy).sqrt(), Four::splat(f32::INFINITY));
        Seen { way, w: in_source / back[2] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::ALL_TOGETHER;
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
            let found = geometry.seen(ALL_TOGETHER, (Four::splat(x - 100.0 * w), Four::splat(y)), (x, y));
            let [a, way, c, d] = found.way.to_array();
            assert_eq!([a, c, d], [f32::INFINITY; 3], "there is one map");
            (way, found.w.to_array()[1])
        };
        let (way, w) = seen(60.5, 20.5, 0.24);
        assert!((way - 1.0).abs() < 1e-4 && (w - 0.25).abs() < 1e-6);
        assert!(seen(60.5, 20.5, 0.25).0 < 1e-4);
        assert_eq!(seen(20.5, 20.5, 0.25).0, f32::INFINITY, "outside of the source's image, on the left");
        let unwanted = geometry.seen(0, (Four::splat(35.5), Four::splat(20.5)), (60.5, 20.5));
        assert_eq!(unwanted.way.to_array(), [f32::INFINITY; TOGETHER]);
        // The same map, now as one of half the size of a larger photograph.
        let twice = CAMERA.resized(Size::new(160, 120));
        let smaller = alone(Geometry::new(&map, (&twice, &at(1.0)), (&CAMERA, &at(0.0))));
        let found = smaller.seen(ALL_TOGETHER, (Four::splat(71.0), Four::splat(41.0)), (60.5, 20.5));
        assert!(found.way.to_array()[1] < 1e-4);
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
        let geometries = Geometries::new([None, Some(geometry)]);
        let w = |u: f32, v: f32| geometries.at(ALL_TOGETHER, (Four::splat(u), Four::splat(v))).to_array()[1];
        assert!((w(20.75, 30.2) - (0.25 + 1e-4 * 20.25)).abs() < 1e-6, "{}", w(20.75, 30.2));
        assert_eq!(w(39.9, 30.2), w(39.5, 30.5), "the pixel's own");
        assert!(w(40.1, 30.2) > 0.49);
        assert!((w(0.1, 59.9) - 0.25).abs() < 1e-6, "{}", w(0.1, 59.9));
        for outside in [(80.5, 30.2), (-0.1, 30.2), (20.0, 60.1), (f32::NAN, 30.2)] {
            assert_eq!(w(outside.0, outside.1), 0.0);
        }
    }
}
