//! Back-projection of pixels with depth to points.

use nalgebra::{Vector2, Vector3};

use crate::{DepthMap, Pinhole, depth_map::is_valid};

/// The point, in the camera's frame, at `depth` on the ray through the image coordinates `pixel`.
#[must_use]
pub fn lift(camera: &Pinhole, pixel: &Vector2<f64>, depth: f64) -> Vector3<f64> {
    camera.intrinsics.ray(pixel) * depth
}

/// The back-projected pixel centres of a depth map, in the world, row after row; `None` where a pixel
/// has no depth.
pub fn lift_map(map: &DepthMap) -> impl Iterator<Item = Option<Vector3<f64>>> {
    let world_from_cam = map.cam_from_world.inverse();
    let width = map.depth.width();
    map.depth.data().iter().enumerate().map(move |(index, &depth)| {
        let centre = Vector2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
        is_valid(depth).then(|| world_from_cam.transform(&lift(&map.camera, &centre, f64::from(depth))))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, Intrinsics, Pose, Size};

    const CAMERA: Pinhole =
        Pinhole { size: Size::new(5, 4), intrinsics: Intrinsics { fx: 6.0, fy: 7.0, cx: 2.3, cy: 1.9 } };

    #[test]
    fn lifting_inverts_projection() {
        let x_in_cam = Vector3::new(-0.3, 0.2, 1.75);
        let pixel = CAMERA.intrinsics.project(&x_in_cam);
        assert!((lift(&CAMERA, &pixel, x_in_cam.z) - x_in_cam).norm() < 1e-14);
    }

    #[test]
    fn a_lifted_map_projects_to_its_pixel_centres_at_its_depths() {
        let cam_from_world = Pose::look_at(&Vector3::new(1.0, 2.0, -4.0), &Vector3::zeros(), &Vector3::y());
        let depth =
            Grid::from_fn(CAMERA.size, |x, y| if (x, y) == (3, 1) { 0.0 } else { (1 + x + 2 * y) as f32 });
        let confidence = Grid::filled(CAMERA.size, 1.0);
        let map = DepthMap { camera: CAMERA, cam_from_world, depth, confidence, coarse_confidence: None };
        let points: Vec<_> = lift_map(&map).collect();
        assert_eq!(points.len(), 20);
        for (index, point) in points.iter().enumerate() {
            let (x, y) = (index % 5, index / 5);
            assert_eq!(point.is_none(), (x, y) == (3, 1));
            let Some(x_in_world) = point else { continue };
            let x_in_cam = cam_from_world.transform(x_in_world);
            let centre = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
            assert!((CAMERA.intrinsics.project(&x_in_cam) - centre).norm() < 1e-12);
            assert!((x_in_cam.z - f64::from(map.depth[(x, y)])).abs() < 1e-12);
        }
    }
}
