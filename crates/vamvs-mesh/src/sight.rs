//! Which places a view may say something of, without its pixels.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use vamvs_core::{Pinhole, Pose};

use crate::band::deepest_behind;
use crate::rays::Rays;

/// How much longer a way to a surface may be along the ray than along the normal.
const MOST_OBLIQUE: f32 = 12.0;

/// Pixels to each side of a tile, of which the largest depth is known.
const TILE: usize = 16;

/// Where a view is, and how far it sees.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Sight {
    pub cam_from_world: Pose,
    pub camera: Pinhole,
    pub rays: Rays,
    /// The largest depth of each tile of 16×16 pixels, 0 where there is none, row after row.
    farthest: Vec<f32>,
}

impl Sight {
    /// That of a view with these depths, row after row; those that are not positive are none.
    pub fn new(camera: Pinhole, cam_from_world: Pose, depths: impl Iterator<Item = f32>) -> Self {
        let columns = camera.size.width.div_ceil(TILE);
        let mut farthest = vec![0.0_f32; columns * camera.size.height.div_ceil(TILE)];
        for (pixel, depth) in depths.enumerate() {
            let (x, y) = (pixel % camera.size.width, pixel / camera.size.width);
            let tile = &mut farthest[y / TILE * columns + x / TILE];
            *tile = depth.max(*tile);
        }
        Self { cam_from_world, camera, rays: Rays::new(&camera), farthest }
    }

    /// Whether the view may say something of places in a ball; `near` is what is near a surface, sizes of a pixel.
    pub fn may_see(&self, (centre, radius): (&Vector3<f64>, f64), near: f32) -> bool {
        let c = self.cam_from_world.transform(centre);
        let intrinsics = &self.camera.intrinsics;
        if c.z + radius <= 0.0 {
            return false;
        }
        if c.z <= 2.0 * radius {
            return true;
        }
        let (u, v) = (intrinsics.fx * c.x / c.z + intrinsics.cx, intrinsics.fy * c.y / c.z + intrinsics.cy);
        // How far a ray's place in the photograph moves with a step to the side and one along the axis.
        let longest = 1.0 + (c.x.abs() + c.y.abs()) / c.z;
        let reach = intrinsics.fx.max(intrinsics.fy) * radius * longest / (c.z - radius);
        let size = self.camera.size;
        let (Some(columns), Some(mut rows)) = (tiles(u, reach, size.width), tiles(v, reach, size.height))
        else {
            return false;
        };
        let reaches = |depth: &f32| *depth > 0.0 && f64::from(self.last_depth(*depth, near)) >= c.z - radius;
        let width = size.width.div_ceil(TILE);
        rows.any(|row| self.farthest[row * width..][columns.clone()].iter().any(reaches))
    }

    /// The largest depth of places of which a view that sees a surface at a depth may say something: as far as the weight
    /// reaches behind the surface, seen at up to 85° from its normal.
    pub fn last_depth(&self, depth: f32, near: f32) -> f32 {
        depth + MOST_OBLIQUE * deepest_behind(near) * self.rays.pixel_size(depth)
    }

    /// The pixel that a place in the view's frame is seen in.
    #[inline]
    pub fn pixel(&self, x: &Vector3<f64>) -> Option<(usize, usize)> {
        let intrinsics = &self.camera.intrinsics;
        if x.z <= 0.0 {
            return None;
        }
        let w = 1.0 / x.z;
        let (u, v) = (intrinsics.fx * (x.x * w) + intrinsics.cx, intrinsics.fy * (x.y * w) + intrinsics.cy);
        let size = self.camera.size;
        let is_inside = u >= 0.0 && v >= 0.0 && u < size.width as f64 && v < size.height as f64;
        is_inside.then_some((u as usize, v as usize))
    }
}

/// The tiles along an axis that what is within `reach` of `centre` may fall into.
fn tiles(centre: f64, reach: f64, length: usize) -> Option<std::ops::Range<usize>> {
    let (first, last) = ((centre - reach - 1.0).max(0.0), (centre + reach + 1.0).min(length as f64 - 1.0));
    (first <= last).then(|| first as usize / TILE..last as usize / TILE + 1)
}
