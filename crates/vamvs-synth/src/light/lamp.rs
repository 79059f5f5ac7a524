//! Rectangles that emit light on one side.

use nalgebra::Vector3;

use crate::Lamp;
use crate::colour::luminance;
use crate::geometry::Ray;

/// A lamp, prepared for path tracing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Panel {
    centre: Vector3<f32>,
    half_u: Vector3<f32>,
    half_v: Vector3<f32>,
    normal: Vector3<f32>,
    area: f32,
    pub radiance: Vector3<f32>,
}

/// A sampled point of a lamp, as seen from a position.
pub(crate) struct PanelSample {
    pub direction: Vector3<f32>,
    pub distance: f32,
    /// Probability density of the direction, by solid angle.
    pub density: f32,
}

impl Panel {
    pub fn new(lamp: &Lamp) -> Self {
        let across = lamp.half_u.cross(&lamp.half_v);
        Self {
            centre: lamp.centre.cast(),
            half_u: lamp.half_u.cast(),
            half_v: lamp.half_v.cast(),
            normal: across.normalize().cast(),
            area: 4.0 * across.norm() as f32,
            radiance: lamp.radiance.into(),
        }
    }

    /// An estimate of the irradiance (as luminance) that the lamp gives at `position`; more than 0 wherever it shines.
    pub fn strength(&self, position: &Vector3<f32>) -> f32 {
        let from_lamp = position - self.centre;
        let square = from_lamp.norm_squared();
        let cos = (self.normal.dot(&from_lamp) / square.sqrt()).max(0.0);
        let strength = luminance(self.radiance.into()) * self.area * cos / (square + self.area);
        if strength.is_nan() { 0.0 } else { strength }
    }

    /// A point sampled uniformly over the lamp's area, as seen from `position`; `None` from behind.
    pub fn sample(&self, position: &Vector3<f32>, [u, v]: [f32; 2]) -> Option<PanelSample> {
        let point = self.centre + self.half_u * (2.0 * u - 1.0) + self.half_v * (2.0 * v - 1.0);
        let distance = (point - position).norm();
        let direction = (point - position) / distance;
        let density = self.density(&direction, distance)?;
        Some(PanelSample { direction, distance, density })
    }

    /// Where a ray meets the emitting side: the distance, and the density of [`Self::sample`] for its direction.
    pub fn meet(&self, ray: &Ray) -> Option<(f32, f32)> {
        let to_centre = self.centre - ray.origin;
        let distance = self.normal.dot(&to_centre) / self.normal.dot(&ray.direction);
        let on_panel = ray.direction * distance - to_centre;
        let inside = |half: &Vector3<f32>| on_panel.dot(half).abs() <= half.norm_squared();
        if !(distance > 0.0 && inside(&self.half_u) && inside(&self.half_v)) {
            return None;
        }
        Some((distance, self.density(&ray.direction, distance)?))
    }

    fn density(&self, direction: &Vector3<f32>, distance: f32) -> Option<f32> {
        let cos = -self.normal.dot(direction);
        (cos > 0.0).then(|| distance * distance / (cos * self.area))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel() -> Panel {
        Panel::new(&Lamp {
            centre: Vector3::new(0.0, 0.0, 2.0),
            half_u: Vector3::new(0.0, 0.5, 0.0),
            half_v: Vector3::new(1.0, 0.0, 0.0),
            radiance: [1.0; 3],
        })
    }

    #[test]
    fn rays_towards_samples_meet_the_lamp_there_with_the_same_density() {
        let position = Vector3::new(0.4, 0.2, 0.1);
        for uv in [[0.01, 0.5], [0.6, 0.99], [0.3, 0.3]] {
            let sample = panel().sample(&position, uv).unwrap();
            let ray = Ray { origin: position, direction: sample.direction };
            let (distance, density) = panel().meet(&ray).unwrap();
            assert!((distance - sample.distance).abs() < 1e-5);
            assert!((density - sample.density).abs() < 1e-4 * density);
        }
    }

    #[test]
    fn the_back_and_the_surroundings_are_dark() {
        let above = Vector3::new(0.0, 0.0, 3.0);
        assert!(panel().sample(&above, [0.5; 2]).is_none());
        assert_eq!(panel().strength(&above), 0.0);
        let down = Ray { origin: above, direction: -Vector3::z() };
        assert!(panel().meet(&down).is_none());
        let beside = Ray { origin: Vector3::new(0.0, 0.6, 0.0), direction: Vector3::z() };
        assert!(panel().meet(&beside).is_none());
        assert!(panel().meet(&Ray { origin: Vector3::new(0.9, 0.4, 0.0), ..beside }).is_some());
    }
}
