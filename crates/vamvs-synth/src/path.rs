//! Path tracing: light paths, followed backwards from the camera.

use nalgebra::Vector3;

use crate::geometry::{Geometry, Ray};
use crate::light::{LightSample, Lights};
use crate::sampler::Sampler;
use crate::surface::{Skin, Split, Surface};

/// Width of a reflected ray per unit of its length: textures that are seen only indirectly may be blurred.
const REFLECTED_SPREAD: f32 = 0.2;
/// Least and greatest survival probability of a path in Russian roulette.
const SURVIVAL: (f32, f32) = (0.05, 0.95);

/// The scene and the settings that paths are traced with.
#[derive(Clone, Copy)]
pub(crate) struct Paths<'a> {
    pub geometry: &'a Geometry,
    pub skins: &'a [Skin],
    pub lights: &'a Lights,
    /// Number of surfaces that a path may touch.
    pub max_bounces: usize,
    /// Whether paths also sample the lights directly, besides meeting them by chance.
    pub aim_at_lights: bool,
}

/// What the camera sees along a path.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seen {
    /// Light straight from the sky.
    pub background: Vector3<f32>,
    /// Light from the first surface, split into what it reflects diffusely and specularly.
    pub reflected: Split,
    /// The first surface.
    pub first: Option<FirstSurface>,
}

/// The surface that a path meets first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FirstSurface {
    pub albedo: Vector3<f32>,
    pub normal: Vector3<f32>,
    pub distance: f32,
}

/// A ray with the width of its footprint, which textures are averaged over.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cone {
    pub ray: Ray,
    /// Width per unit of distance along the ray.
    pub spread: f32,
}

/// A ray that leaves a surface, with the throughput of the path from there to the camera.
struct Bounce {
    ray: Ray,
    /// The path's throughput: the share of the radiance along the ray that reaches the camera, divided by
    /// the density of the sampled directions.
    share: Split,
    /// Probability density of the ray's direction, by solid angle.
    density: f32,
}

impl Paths<'_> {
    /// Traces a path that starts with `cone`, and returns the light that comes back along it.
    pub fn follow(&self, cone: &Cone, sampler: &mut Sampler<'_>) -> Seen {
        let Some((mut surface, distance)) = self.meet(cone) else {
            return Seen { background: self.lights.sky.background(&cone.ray.direction), ..Seen::default() };
        };
        let (albedo, normal) = (surface.reflectance.albedo, *surface.normal());
        let first = Some(FirstSurface { albedo, normal, distance });
        let mut seen = Seen { first, ..Seen::default() };
        let mut share = None;
        for bounces_left in (0..self.max_bounces).rev() {
            let numbers = Numbers::draw(sampler);
            seen.reflected.add(&self.aimed(&surface, share.as_ref(), &numbers));
            let Some(mut bounce) = scattered(&surface, share.as_ref(), &numbers) else { break };
            let next = self.meet(&Cone { ray: bounce.ray, spread: REFLECTED_SPREAD });
            let distance = next.as_ref().map_or(f32::INFINITY, |(_, distance)| *distance);
            seen.reflected.add(&self.met(&bounce, distance));
            let Some((next, _)) = next else { break };
            if bounces_left == 0 || !survives(&mut bounce.share, sampler) {
                break;
            }
            (surface, share) = (next, Some(bounce.share));
        }
        seen
    }

    fn meet(&self, cone: &Cone) -> Option<(Surface, f32)> {
        let meeting = self.geometry.nearest(&cone.ray)?;
        let skin = &self.skins[meeting.face.object as usize];
        let width = cone.spread * meeting.distance;
        Some((skin.surface(&cone.ray, &meeting, width), meeting.distance))
    }

    /// Direct light on `surface` from one sampled light, weighted against [`Self::met`].
    fn aimed(&self, surface: &Surface, share: Option<&Split>, numbers: &Numbers) -> Split {
        if !self.aim_at_lights {
            return Split::default();
        }
        let start = surface.leaving(Vector3::zeros()).origin;
        let Some(light) = self.lights.sample(&start, numbers.light_choice, numbers.light) else {
            return Split::default();
        };
        let reflected = surface.reflected(&light.direction);
        if reflected.sum().max() <= 0.0 || self.is_hidden(surface, &light) {
            return Split::default();
        }
        let weight = heuristic(light.density, surface.density(&light.direction)) / light.density;
        after(&reflected, share).filtered(&(light.radiance * weight))
    }

    fn is_hidden(&self, surface: &Surface, light: &LightSample) -> bool {
        self.geometry.is_blocked(&surface.leaving(light.direction), light.distance)
    }

    /// Light that a bounce meets by chance within `distance`, weighted against [`Self::aimed`].
    fn met(&self, bounce: &Bounce, distance: f32) -> Split {
        let mut sum = Split::default();
        for emitted in self.lights.emitted(&bounce.ray, distance) {
            let weight = if self.aim_at_lights { heuristic(bounce.density, emitted.density) } else { 1.0 };
            sum.add(&bounce.share.filtered(&(emitted.radiance * weight)));
        }
        sum
    }
}

/// The random numbers that a path uses at one surface.
struct Numbers {
    light: [f32; 2],
    direction: [f32; 2],
    light_choice: f32,
    lobe_choice: f32,
}

impl Numbers {
    fn draw(sampler: &mut Sampler<'_>) -> Self {
        let (light, direction) = (sampler.pair(), sampler.pair());
        let [light_choice, lobe_choice] = sampler.pair();
        Self { light, direction, light_choice, lobe_choice }
    }
}

/// The sampled ray that continues the path; `None` if no light can come along it.
fn scattered(surface: &Surface, share: Option<&Split>, numbers: &Numbers) -> Option<Bounce> {
    let direction = surface.sample(numbers.lobe_choice, numbers.direction);
    let (reflected, density) = (surface.reflected(&direction), surface.density(&direction));
    if density <= 0.0 || reflected.sum().max() <= 0.0 {
        return None;
    }
    let share = after(&reflected, share).filtered(&Vector3::repeat(1.0 / density));
    Some(Bounce { ray: surface.leaving(direction), share, density })
}

/// The share of light at the camera, given the share `reflected` here and the `share` of the path so far. The
/// first surface alone splits light into diffuse and specular; later ones keep its split.
fn after(reflected: &Split, share: Option<&Split>) -> Split {
    share.map_or(*reflected, |share| share.filtered(&reflected.sum()))
}

/// Russian roulette: whether a path is followed further, with a probability equal to its share of light, which is
/// scaled up to make up for the paths that end.
fn survives(share: &mut Split, sampler: &mut Sampler<'_>) -> bool {
    let probability = share.sum().max().clamp(SURVIVAL.0, SURVIVAL.1);
    *share = share.filtered(&Vector3::repeat(1.0 / probability));
    sampler.single() < probability
}

/// Veach's power heuristic: the weight of a sample drawn with density `own` that the other technique would draw
/// with density `other`.
fn heuristic(own: f32, other: f32) -> f32 {
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}
