//! Photographs of a world with exact depth and normals.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use vamvs_core::{Grid, Photo, Pinhole, Pose, Rgb, Size};

use crate::scene::{World, WorldHit};
use crate::shape::Ray;

/// Light of the sun on a surface that faces it: linear red, green, blue.
const SUN: Vector3<f64> = Vector3::new(0.82, 0.76, 0.65);
/// Light of the sky on a surface that faces up.
const SKY: Vector3<f64> = Vector3::new(0.24, 0.27, 0.33);
/// Colour of what no surface covers.
const BACKGROUND: Vector3<f64> = Vector3::new(0.45, 0.6, 0.85);

/// A rendered photograph and its truth, all of one size.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The photograph with its camera and pose.
    pub photo: Photo,
    /// Depth z at the pixels' centres; 0 where there is no surface.
    pub depth: Grid<f32>,
    /// Unit normal in the world at the pixels' centres, towards the camera; 0 without surface.
    pub normal: Grid<[f32; 3]>,
}

struct Pixel {
    colour: Rgb,
    depth: f32,
    normal: [f32; 3],
}

/// Renders `world` as `camera` sees it. A pixel's colour is the mean of `samples` × `samples` rays
/// spread evenly over it; depth and normal are those of the ray through its centre.
#[must_use]
pub fn render(world: &World, camera: &Pinhole, cam_from_world: &Pose, samples: usize) -> Rendered {
    let size = camera.size;
    let eye = Eye { camera, world_from_cam: cam_from_world.inverse(), samples };
    let pixels: Vec<Pixel> = (0..size.height)
        .into_par_iter()
        .flat_map_iter(|y| (0..size.width).map(move |x| (x, y)))
        .map(|(x, y)| eye.pixel(world, x as f64, y as f64))
        .collect();
    assemble(camera, cam_from_world, size, &pixels)
}

fn assemble(camera: &Pinhole, cam_from_world: &Pose, size: Size, pixels: &[Pixel]) -> Rendered {
    let image = Grid::from_vec(size, pixels.iter().map(|p| p.colour).collect());
    Rendered {
        photo: Photo { camera: *camera, cam_from_world: *cam_from_world, image, mask: None },
        depth: Grid::from_vec(size, pixels.iter().map(|p| p.depth).collect()),
        normal: Grid::from_vec(size, pixels.iter().map(|p| p.normal).collect()),
    }
}

struct Eye<'a> {
    camera: &'a Pinhole,
    world_from_cam: Pose,
    samples: usize,
}

impl Eye<'_> {
    fn pixel(&self, world: &World, x: f64, y: f64) -> Pixel {
        let colour = encode(&self.mean_light(world, x, y));
        match world.trace(&self.ray(x + 0.5, y + 0.5), 0.0) {
            Some(hit) => Pixel { colour, depth: hit.t as f32, normal: hit.normal.map(|v| v as f32).into() },
            None => Pixel { colour, depth: 0.0, normal: [0.0; 3] },
        }
    }

    /// The ray through image coordinates `(x, y)`; its parameter is the depth.
    fn ray(&self, x: f64, y: f64) -> Ray {
        let in_cam = self.camera.intrinsics.ray(&Vector2::new(x, y));
        Ray { origin: self.world_from_cam.translation, direction: self.world_from_cam.rotation * in_cam }
    }

    fn mean_light(&self, world: &World, x: f64, y: f64) -> Vector3<f64> {
        let offset = |i: usize| (i as f64 + 0.5) / self.samples as f64;
        let mut sum = Vector3::zeros();
        for j in 0..self.samples {
            for i in 0..self.samples {
                sum += self.light(world, &self.ray(x + offset(i), y + offset(j)));
            }
        }
        sum / (self.samples * self.samples) as f64
    }

    fn light(&self, world: &World, ray: &Ray) -> Vector3<f64> {
        let Some(hit) = world.trace(ray, 0.0) else { return BACKGROUND };
        let footprint = hit.t / self.camera.intrinsics.fx;
        let albedo = hit.surface.texture.albedo(&hit.at, footprint);
        albedo.component_mul(&illumination(world, &hit, &ray.at(hit.t)))
    }
}

/// Light that falls on a surface: a sun with hard shadows and an even sky (Lambert).
fn illumination(world: &World, hit: &WorldHit, x_in_world: &Vector3<f64>) -> Vector3<f64> {
    let sky = SKY * (0.6 + 0.4 * hit.normal.z);
    let slant = hit.normal.dot(&world.to_sun);
    let origin = x_in_world + hit.normal * 1e-6;
    if slant <= 0.0 || world.is_blocked(&Ray { origin, direction: world.to_sun }) {
        return sky;
    }
    sky + SUN * slant
}

/// 8-bit sRGB of linear light.
fn encode(light: &Vector3<f64>) -> Rgb {
    let srgb = |v: f64| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    light.map(|v| (255.0 * srgb(v.clamp(0.0, 1.0))).round() as u8).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{fixtures, rig};

    #[test]
    fn every_pixel_of_the_still_life_has_a_surface_that_faces_the_camera() {
        for shot in fixtures::still_life(Size::new(48, 36), 5) {
            let centre = shot.photo.cam_from_world.centre();
            for y in 0..36 {
                for x in 0..48 {
                    let depth = f64::from(shot.depth[(x, y)]);
                    assert!(depth > 1.0 && depth < 12.0, "depth {depth} at ({x}, {y})");
                    let pixel = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
                    let in_cam = shot.photo.camera.intrinsics.ray(&pixel) * depth;
                    let point = shot.photo.cam_from_world.inverse().transform(&in_cam);
                    let normal = Vector3::from(shot.normal[(x, y)]).cast::<f64>();
                    assert!((normal.norm() - 1.0).abs() < 1e-6);
                    assert!(normal.dot(&(centre - point)) > 0.0);
                }
            }
        }
    }

    #[test]
    fn the_tilted_plane_is_plane_in_every_view() {
        let size = Size::new(40, 30);
        for shot in fixtures::tilted_plane(size, 3) {
            let world_from_cam = shot.photo.cam_from_world.inverse();
            let normal = Vector3::from(shot.normal[(0, 0)]).cast::<f64>();
            for (x, y) in [(0, 0), (39, 0), (0, 29), (39, 29), (17, 11)] {
                let pixel = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
                let ray = shot.photo.camera.intrinsics.ray(&pixel);
                let point = world_from_cam.transform(&(ray * f64::from(shot.depth[(x, y)])));
                assert!((point - rig::TARGET).dot(&normal).abs() < 1e-5);
            }
        }
    }
}
