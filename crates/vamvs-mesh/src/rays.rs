//! Rays through the centres of pixels, and the normals of what they meet.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use vamvs_core::{Grid, Intrinsics, Pinhole, depth_map};

/// The rays through the centres of pixels.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Rays {
    /// What a pixel to the right and one below add to a ray.
    step: [f32; 2],
    /// The ray of the first pixel.
    first: [f32; 2],
    /// The size of a pixel at depth 1.
    pixel: f32,
}

impl Rays {
    /// Those of a camera.
    pub fn new(camera: &Pinhole) -> Self {
        let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
        let first = [((0.5 - cx) / fx) as f32, ((0.5 - cy) / fy) as f32];
        Self { step: [(1.0 / fx) as f32, (1.0 / fy) as f32], first, pixel: (2.0 / (fx + fy)) as f32 }
    }

    /// The ray of a pixel, at depth 1.
    #[inline]
    pub fn of(&self, (x, y): (usize, usize)) -> Vector3<f32> {
        let [right, down] = self.step;
        Vector3::new(self.first[0] + x as f32 * right, self.first[1] + y as f32 * down, 1.0)
    }

    /// The size of a pixel at a depth, scene units.
    #[inline]
    pub fn pixel_size(&self, depth: f32) -> f32 {
        self.pixel * depth
    }
}

/// A normal of a map in the world's frame, in the camera's; `None` if there is none.
pub(crate) fn given_normal(
    normals: &Grid<[f32; 3]>,
    rotation: &Matrix3<f32>,
    place: (usize, usize),
) -> Option<Vector3<f32>> {
    (rotation * Vector3::from(normals[place])).try_normalize(0.5)
}

/// The normal of a pixel by the inverse depths beside it, along each axis of that which differs less.
pub(crate) fn derived_normal(
    camera: &Pinhole,
    depth: &Grid<f32>,
    (x, y): (usize, usize),
) -> Option<Vector3<f32>> {
    let w = 1.0 / depth[(x, y)];
    let at = |x: usize, y: usize| {
        depth.get(x, y).copied().filter(|depth| depth_map::is_valid(*depth)).map(f32::recip)
    };
    let slope = |before: Option<f32>, behind: Option<f32>| match (before, behind) {
        (Some(before), Some(behind)) if (w - before).abs() > (behind - w).abs() => Some(behind - w),
        (Some(before), _) => Some(w - before),
        (None, Some(behind)) => Some(behind - w),
        (None, None) => None,
    };
    let gx = slope(x.checked_sub(1).and_then(|x| at(x, y)), at(x + 1, y))?;
    let gy = slope(y.checked_sub(1).and_then(|y| at(x, y)), at(x, y + 1))?;
    let intrinsics = &camera.intrinsics;
    let [fx, fy, cx, cy] =
        [intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy].map(|value| value as f32);
    // 1/z is this direction times the ray; the plane is where it is 1 times the point.
    let inwards = Vector3::new(gx * fx, gy * fy, w - gx * (x as f32 + 0.5 - cx) - gy * (y as f32 + 0.5 - cy));
    Some(-inwards.normalize())
}
