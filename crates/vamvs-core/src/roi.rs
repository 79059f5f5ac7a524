//! A region of interest: a box in the world, with the pixels and the depths that it covers in a
//! view.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::{Grid, Pinhole, Pose, Size};

/// An axis-aligned box in the world, in scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Bounds")]
pub struct Roi {
    /// The corner with the smallest coordinates.
    pub min: Vector3<f64>,
    /// The corner with the largest coordinates.
    pub max: Vector3<f64>,
}

/// The bounds do not span a box.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "a region of interest needs finite bounds with min < max on each axis; on {axis} got min {min}, max {max}"
)]
pub struct RoiError {
    /// The axis at fault: x, y or z.
    pub axis: char,
    /// As given.
    pub min: f64,
    /// As given.
    pub max: f64,
}

/// A rectangle of pixels, half-open: `x0 ≤ x < x1` and `y0 ≤ y < y1`, never empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PixelBox {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// The column after the last one.
    pub x1: usize,
    /// The row after the last one.
    pub y1: usize,
}

impl PixelBox {
    /// The smallest box around all pixels that are `true`; `None` if there are none.
    #[must_use]
    pub fn around(mask: &Grid<bool>) -> Option<Self> {
        let wanted = |(x, y): &(usize, usize)| mask[(*x, *y)];
        let all = (0..mask.height()).flat_map(|y| (0..mask.width()).map(move |x| (x, y)));
        let one = |(x, y): (usize, usize)| Self { x0: x, y0: y, x1: x + 1, y1: y + 1 };
        all.filter(wanted).map(one).reduce(|a, b| Self {
            x0: a.x0.min(b.x0),
            y0: a.y0.min(b.y0),
            x1: a.x1.max(b.x1),
            y1: a.y1.max(b.y1),
        })
    }

    /// Its width and height.
    #[must_use]
    pub fn size(self) -> Size {
        Size::new(self.width(), self.height())
    }

    /// The same part of the image at 1/`factor` of its size.
    #[must_use]
    pub fn reduced(self, factor: usize) -> Self {
        Self { x0: self.x0 / factor, y0: self.y0 / factor, x1: self.x1 / factor, y1: self.y1 / factor }
    }

    /// The intersection of two boxes; `None` if it is empty.
    #[must_use]
    pub fn common(self, other: Self) -> Option<Self> {
        let [x0, y0] = [self.x0.max(other.x0), self.y0.max(other.y0)];
        let [x1, y1] = [self.x1.min(other.x1), self.y1.min(other.y1)];
        (x0 < x1 && y0 < y1).then_some(Self { x0, y0, x1, y1 })
    }
}

/// Depths below this share of the box's farthest depth are cut off.
const NEAREST: f64 = 1e-3;

impl Roi {
    /// Checks that the bounds are finite and span a volume.
    ///
    /// # Errors
    /// If a bound is not finite or min ≥ max; the error names the first such axis.
    pub fn try_new(min: Vector3<f64>, max: Vector3<f64>) -> Result<Self, RoiError> {
        for (i, axis) in ['x', 'y', 'z'].into_iter().enumerate() {
            let (min, max) = (min[i], max[i]);
            if !(min.is_finite() && max.is_finite() && min < max) {
                return Err(RoiError { axis, min, max });
            }
        }
        Ok(Self { min, max })
    }

    /// Whether a point lies in the box, its faces included.
    #[must_use]
    pub fn contains(&self, x_in_world: &Vector3<f64>) -> bool {
        (0..3).all(|i| self.min[i] <= x_in_world[i] && x_in_world[i] <= self.max[i])
    }

    /// The eight corners; bit `i` of a corner's index tells whether coordinate `i` is the maximum.
    #[must_use]
    pub fn corners(&self) -> [Vector3<f64>; 8] {
        std::array::from_fn(|corner| {
            Vector3::from_fn(|i, _| if corner >> i & 1 == 1 { self.max[i] } else { self.min[i] })
        })
    }

    /// The nearest and the farthest depth of the box; `None` if the whole box is behind the camera.
    ///
    /// The nearest depth is at least a thousandth of the farthest, so it is positive even if the box
    /// contains the camera or reaches behind it.
    #[must_use]
    pub fn depth_range(&self, cam_from_world: &Pose) -> Option<(f64, f64)> {
        let depths = self.corners().map(|corner| cam_from_world.transform(&corner).z);
        let near = depths.into_iter().fold(f64::INFINITY, f64::min);
        let far = depths.into_iter().fold(f64::NEG_INFINITY, f64::max);
        (far > 0.0).then(|| (near.max(NEAREST * far), far))
    }

    /// The pixels that can see the box; `None` if it is outside of the image or behind the camera.
    ///
    /// The rectangle bounds the projection of the box, clipped at the nearest depth of
    /// [`Roi::depth_range`].
    #[must_use]
    pub fn pixel_box(&self, camera: &Pinhole, cam_from_world: &Pose) -> Option<PixelBox> {
        let (near, _) = self.depth_range(cam_from_world)?;
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = Vector2::repeat(f64::NEG_INFINITY);
        for x_in_cam in self.vertices_beyond(near, cam_from_world) {
            let pixel = camera.intrinsics.project(&x_in_cam);
            low = low.inf(&pixel);
            high = high.sup(&pixel);
        }
        let (x0, x1) = span(low.x, high.x, camera.size.width)?;
        let (y0, y1) = span(low.y, high.y, camera.size.height)?;
        Some(PixelBox { x0, y0, x1, y1 })
    }

    /// The vertices, in the camera's frame, of the box clipped to depths of at least `near`: its
    /// corners beyond that plane, and the points where edges cross it. The clipped box is convex, so
    /// its projection is the convex hull of the projected vertices.
    fn vertices_beyond(&self, near: f64, cam_from_world: &Pose) -> Vec<Vector3<f64>> {
        let corners = self.corners().map(|corner| cam_from_world.transform(&corner));
        let mut vertices: Vec<_> = corners.into_iter().filter(|corner| corner.z >= near).collect();
        for (a, b) in edges().map(|(a, b)| (corners[a], corners[b])) {
            if (a.z < near) != (b.z < near) {
                let mut crossing = a.lerp(&b, (near - a.z) / (b.z - a.z));
                crossing.z = near;
                vertices.push(crossing);
            }
        }
        vertices
    }
}

impl PixelBox {
    /// Number of columns.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.x1 - self.x0
    }

    /// Number of rows.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.y1 - self.y0
    }
}

/// The twelve edges as pairs of corner indices, which differ in one bit.
fn edges() -> impl Iterator<Item = (usize, usize)> {
    (0..8).flat_map(|a| (0..3).map(move |bit| (a, a | 1 << bit))).filter(|(a, b)| a != b)
}

/// The range of pixels of `0..count` that the interval `[low, high]` touches; `None` if there are
/// none.
fn span(low: f64, high: f64, count: usize) -> Option<(usize, usize)> {
    let first = low.floor().max(0.0);
    let end = high.ceil().min(count as f64);
    (first < end).then_some((first as usize, end as usize))
}

/// The bounds as read from a file, not checked yet.
#[derive(Deserialize)]
struct Bounds {
    min: Vector3<f64>,
    max: Vector3<f64>,
}

impl TryFrom<Bounds> for Roi {
    type Error = RoiError;

    fn try_from(bounds: Bounds) -> Result<Self, RoiError> {
        Self::try_new(bounds.min, bounds.max)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Intrinsics, Size};

    const CAMERA: Pinhole = Pinhole {
        size: Size::new(200, 150),
        intrinsics: Intrinsics { fx: 180.0, fy: 170.0, cx: 96.0, cy: 80.0 },
    };

    fn roi(min: [f64; 3], max: [f64; 3]) -> Roi {
        Roi::try_new(Vector3::from(min), Vector3::from(max)).unwrap()
    }

    #[test]
    fn a_box_around_a_mask_touches_it_on_all_sides() {
        let mask =
            |pixels: &[(usize, usize)]| Grid::from_fn(Size::new(9, 7), |x, y| pixels.contains(&(x, y)));
        let around = PixelBox::around(&mask(&[(5, 2), (3, 4), (4, 6)]));
        assert_eq!(around, Some(PixelBox { x0: 3, y0: 2, x1: 6, y1: 7 }));
        assert_eq!(PixelBox::around(&mask(&[])), None);
        let (a, b) = (PixelBox { x0: 0, y0: 0, x1: 4, y1: 5 }, PixelBox { x0: 2, y0: 3, x1: 9, y1: 9 });
        assert_eq!(a.common(b), Some(PixelBox { x0: 2, y0: 3, x1: 4, y1: 5 }));
        assert_eq!(a.common(PixelBox { x0: 4, ..b }), None);
    }

    #[test]
    fn a_box_ahead_takes_the_pixels_of_its_near_face() {
        // The near face, at depth 2, spans 96 + 90 · [−0.5, 0.5] by 80 + 85 · [−0.2, 0.3].
        let roi = roi([-0.5, -0.2, 2.0], [0.5, 0.3, 4.0]);
        let expected = PixelBox { x0: 51, y0: 63, x1: 141, y1: 106 };
        assert_eq!(roi.pixel_box(&CAMERA, &Pose::identity()), Some(expected));
        assert_eq!((expected.width(), expected.height()), (90, 43));
        assert_eq!(roi.depth_range(&Pose::identity()), Some((2.0, 4.0)));
    }

    #[test]
    fn a_box_behind_or_aside_is_not_seen() {
        let behind = roi([-1.0, -1.0, -3.0], [1.0, 1.0, -1.0]);
        assert_eq!(behind.depth_range(&Pose::identity()), None);
        assert_eq!(behind.pixel_box(&CAMERA, &Pose::identity()), None);
        let aside = roi([5.0, -1.0, 1.0], [6.0, 1.0, 3.0]);
        assert_eq!(aside.pixel_box(&CAMERA, &Pose::identity()), None);
    }

    #[test]
    fn a_camera_in_the_box_sees_it_everywhere() {
        let around = roi([-1.0; 3], [2.0; 3]);
        let whole = PixelBox { x0: 0, y0: 0, x1: 200, y1: 150 };
        assert_eq!(around.pixel_box(&CAMERA, &Pose::identity()), Some(whole));
        let (near, far) = around.depth_range(&Pose::identity()).unwrap();
        assert!(near > 0.0 && near <= 2e-3 && (far - 2.0).abs() < 1e-15);
    }

    #[test]
    fn bounds_that_span_no_box_are_refused() {
        let one = Vector3::repeat(1.0);
        assert_eq!(Roi::try_new(one, Vector3::new(2.0, 1.0, 2.0)).unwrap_err().axis, 'y');
        assert_eq!(Roi::try_new(one, Vector3::new(2.0, 2.0, f64::NAN)).unwrap_err().axis, 'z');
        assert_eq!(Roi::try_new(one * f64::NEG_INFINITY, one).unwrap_err().axis, 'x');
    }

    #[test]
    fn corners_and_faces_belong_to_the_box() {
        let roi = roi([0.0, 1.0, 2.0], [3.0, 5.0, 7.0]);
        assert!(roi.corners().iter().all(|corner| roi.contains(corner)));
        assert_eq!(roi.corners()[5], Vector3::new(3.0, 1.0, 7.0));
        assert!(!roi.contains(&Vector3::new(1.0, 1.0, 7.1)));
        assert_eq!(edges().count(), 12);
    }

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        proptest::array::uniform3(-3.0..3.0).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn every_point_of_the_box_is_seen_within_the_pixels(
            (eye, target, low) in (vector(), vector(), vector()),
            size in proptest::array::uniform3(0.1..3.0),
            samples in proptest::collection::vec(proptest::array::uniform3(0.0..=1.0), 300),
        ) {
            prop_assume!((target - eye).xy().norm() > 0.1);
            let cam_from_world = Pose::look_at(&eye, &target, &Vector3::z());
            let size = Vector3::from(size);
            let roi = Roi::try_new(low, low + size).unwrap();
            let pixels = roi.pixel_box(&CAMERA, &cam_from_world);
            if let Some((near, _)) = roi.depth_range(&cam_from_world) {
                let grown = Roi { min: roi.min.add_scalar(-1e-9), max: roi.max.add_scalar(1e-9) };
                for vertex in roi.vertices_beyond(near, &cam_from_world) {
                    prop_assert!(vertex.z >= near && grown.contains(&cam_from_world.inverse().transform(&vertex)));
                }
            }
            for sample in samples {
                let x_in_world = low + size.component_mul(&Vector3::from(sample));
                let x_in_cam = cam_from_world.transform(&x_in_world);
                let Some(pixel) = CAMERA.project_inside(&x_in_cam) else { continue };
                let (near, far) = roi.depth_range(&cam_from_world).unwrap();
                prop_assert!(x_in_cam.z <= far + 1e-12);
                if x_in_cam.z < near { continue }
                let b = pixels.unwrap();
                let (x, y) = (pixel.x as usize, pixel.y as usize);
                prop_assert!(b.x0 <= x && x < b.x1 && b.y0 <= y && y < b.y1, "{:?} in {:?}", pixel, b);
            }
        }
    }
}
