//! Renders photographs: the mean over many light paths per pixel.

use nalgebra::Vector3;
use vamvs_core::{Pinhole, Pose};

use crate::colour::luminance;
use crate::denoise::denoised;
use crate::ground_truth::Eye;
use crate::path::{Cone, Paths, Seen};
use crate::pixel::{Estimate, Pixel, PixelSurface, fill};
use crate::sampler::Pattern;
use crate::surface::Split;
use crate::tracer::{RenderOptions, Shot, Tracer};

/// Smallest width of a path's texture footprint, as a share of the pixel's: narrower ones would undersample
/// textures.
const LEAST_COVER: f64 = 0.5;

impl Tracer {
    /// Renders the radiance that `camera` sees at `cam_from_world`, and its ground truth. Equal seeds give equal
    /// results, whatever the number of threads.
    #[must_use]
    pub fn shoot(&self, camera: &Pinhole, cam_from_world: &Pose, options: &RenderOptions, seed: u64) -> Shot {
        let exposure = Exposure {
            eye: Eye::new(camera, cam_from_world),
            paths: self.paths(options.max_bounces),
            samples: options.samples.max(1),
            seed,
        };
        let pixels = fill(camera.size, |x, y| exposure.pixel(x, y));
        let radiance =
            if options.denoise { denoised(&pixels) } else { pixels.map(|pixel| pixel.radiance().into()) };
        Shot { radiance, ground_truth: self.ground_truth(camera, cam_from_world) }
    }

    fn paths(&self, max_bounces: usize) -> Paths<'_> {
        Paths {
            geometry: &self.geometry,
            skins: &self.skins,
            lights: &self.lights,
            max_bounces,
            aim_at_lights: true,
        }
    }
}

struct Exposure<'a> {
    eye: Eye<'a>,
    paths: Paths<'a>,
    samples: usize,
    seed: u64,
}

impl Exposure<'_> {
    fn pixel(&self, x: usize, y: usize) -> Pixel {
        let mut pattern = Pattern::new(self.seed, (y * self.eye.camera.size.width + x) as u64);
        let mut sums = Sums::default();
        for path in 0..self.samples {
            let mut sampler = pattern.path(path);
            let [dx, dy] = sampler.pair().map(f64::from);
            sums.add(&self.paths.follow(&self.cone(x as f64 + dx, y as f64 + dy), &mut sampler));
        }
        self.mean(&sums, x as f64 + 0.5, y as f64 + 0.5)
    }

    fn cone(&self, x: f64, y: f64) -> Cone {
        let (ray, depth) = self.eye.ray(x, y);
        let cover = LEAST_COVER.max((self.samples as f64).sqrt().recip());
        Cone { ray, spread: (cover * depth / self.eye.camera.intrinsics.fx) as f32 }
    }

    fn mean(&self, sums: &Sums, x: f64, y: f64) -> Pixel {
        let n = self.samples as f32;
        let surface = (sums.hits > 0.0).then(|| {
            let (ray, depth) = self.eye.ray(x, y);
            let distance = sums.distance / sums.hits;
            PixelSurface {
                normal: sums.normal.normalize(),
                position: ray.direction * distance,
                spacing: distance * (depth / self.eye.camera.intrinsics.fx) as f32,
            }
        });
        let demodulated = sums.reflected.diffuse.zip_map(&sums.albedo, share);
        Pixel {
            background: sums.background / n,
            albedo: sums.albedo / n,
            diffuse: Estimate { mean: demodulated, variance: sums.diffuse.variance_of_mean(sums.hits) },
            specular: Estimate {
                mean: sums.reflected.specular / n,
                variance: sums.specular.variance_of_mean(n),
            },
            surface,
        }
    }
}

/// Sums over the paths of a pixel.
#[derive(Default)]
struct Sums {
    background: Vector3<f32>,
    reflected: Split,
    albedo: Vector3<f32>,
    normal: Vector3<f32>,
    distance: f32,
    /// Number of paths that met a surface.
    hits: f32,
    /// Luminance of the diffuse light divided by the albedo.
    diffuse: Moments,
    /// Luminance of the specular light.
    specular: Moments,
}

impl Sums {
    fn add(&mut self, seen: &Seen) {
        self.background += seen.background;
        let Some(first) = seen.first else { return };
        self.reflected.add(&seen.reflected);
        self.albedo += first.albedo;
        self.normal += first.normal;
        self.distance += first.distance;
        self.hits += 1.0;
        let demodulated = seen.reflected.diffuse.zip_map(&first.albedo, share);
        self.diffuse.add(luminance(demodulated.into()));
        self.specular.add(luminance(seen.reflected.specular.into()));
    }
}

/// `part` / `whole`, or 0 if `whole` is 0.
fn share(part: f32, whole: f32) -> f32 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// Sums of values and of their squares.
#[derive(Default)]
struct Moments {
    sum: f32,
    squares: f32,
}

impl Moments {
    fn add(&mut self, value: f32) {
        self.sum += value;
        self.squares += value * value;
    }

    /// The variance of the mean of `n` values; values that were not added count as 0. For a single value, its
    /// square.
    fn variance_of_mean(&self, n: f32) -> f32 {
        if n < 2.0 {
            return self.squares;
        }
        let mean = self.sum / n;
        ((self.squares / n - mean * mean) / (n - 1.0)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{Environment, Lamp, Material, Object, World, primitive};
    use nalgebra::Similarity3;
    use vamvs_core::{Grid, Intrinsics, Rgb, Size};

    fn object(mesh: crate::Mesh, colour: Rgb, specular: f32, place: [f64; 3]) -> Object {
        let albedo = Arc::new(Grid::filled(Size::new(1, 1), colour));
        let material = Material { albedo, tiling: [1.0; 2], tint: [1.0; 3], specular, roughness: 0.3 };
        let world_from_object = Similarity3::new(place.into(), Vector3::zeros(), 1.0);
        Object { mesh: Arc::new(mesh), material, world_from_object }
    }

    /// A coated ball and a box on a floor, lit by a lamp and a sky that is brighter on one side.
    fn tracer() -> Tracer {
        let objects = vec![
            object(primitive::rectangle([6.0, 6.0]), [180; 3], 0.0, [0.0; 3]),
            object(primitive::sphere(0.5, 12), [200, 160, 80], 0.2, [0.3, 0.2, 0.5]),
            object(primitive::cuboid([0.5, 0.5, 1.0]), [80, 160, 200], 0.04, [-0.6, -0.2, 0.5]),
        ];
        let map = Arc::new(Grid::from_fn(Size::new(8, 4), |x, _| if x < 3 { [1.5; 3] } else { [0.2; 3] }));
        let lamp = Lamp {
            centre: Vector3::new(0.0, 0.5, 2.0),
            half_u: Vector3::y() * 0.6,
            half_v: Vector3::x() * 0.6,
            radiance: [4.0; 3],
        };
        let environment = Environment { map, rotation: 0.4, strength: 1.0 };
        Tracer::new(&World { objects, environment, lamps: vec![lamp] })
    }

    /// Mean green radiance of each row of a small image.
    fn rows(tracer: &Tracer, aim_at_lights: bool) -> Vec<f32> {
        let intrinsics = Intrinsics { fx: 14.0, fy: 14.0, cx: 8.0, cy: 6.0 };
        let camera = Pinhole { size: Size::new(16, 12), intrinsics };
        let pose = Pose::look_at(&Vector3::new(2.0, -2.5, 1.6), &Vector3::z().scale(0.4), &Vector3::z());
        let paths = Paths { aim_at_lights, ..tracer.paths(5) };
        let exposure = Exposure { eye: Eye::new(&camera, &pose), paths, samples: 4096, seed: 1 };
        let light = fill(camera.size, |x, y| exposure.pixel(x, y).radiance().y);
        (0..12).map(|y| light.row(y).iter().sum::<f32>() / 16.0).collect()
    }

    #[test]
    fn aiming_at_lights_changes_the_noise_but_not_the_light() {
        let tracer = tracer();
        for (aimed, met) in rows(&tracer, true).into_iter().zip(rows(&tracer, false)) {
            assert!((aimed / met - 1.0).abs() < 0.02, "{aimed} {met}");
        }
    }
}
