//! The light sources of a world, and how paths sample them.

mod lamp;
mod sky;

use nalgebra::Vector3;

use crate::World;
use crate::geometry::Ray;
use lamp::Panel;
pub(crate) use sky::Sky;

/// All lights of a world.
pub(crate) struct Lights {
    pub sky: Sky,
    lamps: Vec<Panel>,
}

/// A sampled direction that light may come from.
pub(crate) struct LightSample {
    pub direction: Vector3<f32>,
    /// Distance to the light; infinite for the sky.
    pub distance: f32,
    /// Linear radiance, if nothing is in between.
    pub radiance: Vector3<f32>,
    /// Probability density of the direction, by solid angle.
    pub density: f32,
}

/// Light that a ray meets by chance.
pub(crate) struct Emitted {
    pub radiance: Vector3<f32>,
    /// Probability density with which [`Lights::sample`] would have chosen its direction, by solid angle.
    pub density: f32,
}

impl Lights {
    pub fn new(world: &World) -> Self {
        let lamps = world.lamps.iter().map(Panel::new).collect();
        Self { sky: Sky::new(&world.environment), lamps }
    }

    /// Samples a direction that light at `position` may come from: `choice` selects a light in proportion to its
    /// strength there, `uv` a point of it; all are numbers in [0, 1).
    pub fn sample(&self, position: &Vector3<f32>, choice: f32, uv: [f32; 2]) -> Option<LightSample> {
        let total = self.strength(position);
        let mut left = choice * total - self.sky_strength();
        if left < 0.0 {
            let (direction, light) = self.sky.sample(uv);
            let density = light.density * self.sky_strength() / total;
            return Some(LightSample {
                direction,
                distance: f32::INFINITY,
                radiance: light.radiance,
                density,
            });
        }
        for lamp in &self.lamps {
            let strength = lamp.strength(position);
            left -= strength;
            if left < 0.0 {
                let sample = lamp.sample(position, uv)?;
                let density = sample.density * strength / total;
                let (direction, distance) = (sample.direction, sample.distance);
                return Some(LightSample { direction, distance, radiance: lamp.radiance, density });
            }
        }
        None
    }

    /// All light that a ray meets: from lamps nearer than `distance`, that of the surface that the ray meets, and from
    /// the sky if `distance` is infinite.
    pub fn emitted<'a>(&'a self, ray: &'a Ray, distance: f32) -> impl Iterator<Item = Emitted> + 'a {
        let total = self.strength(&ray.origin);
        let from_lamp = move |lamp: &Panel| {
            let (_, density) = lamp.meet(ray).filter(|&(to_lamp, _)| to_lamp < distance)?;
            Some(Emitted { radiance: lamp.radiance, density: density * lamp.strength(&ray.origin) / total })
        };
        let from_sky = (distance == f32::INFINITY).then(|| {
            let light = self.sky.light(&ray.direction);
            Emitted { radiance: light.radiance, density: light.density * self.sky_strength() / total }
        });
        self.lamps.iter().filter_map(from_lamp).chain(from_sky)
    }

    fn strength(&self, position: &Vector3<f32>) -> f32 {
        self.sky_strength() + self.lamps.iter().map(|lamp| lamp.strength(position)).sum::<f32>()
    }

    /// The irradiance that a uniform sky of the same mean luminance would give.
    fn sky_strength(&self) -> f32 {
        std::f32::consts::PI * self.sky.mean_luminance()
    }
}
