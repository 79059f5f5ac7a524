//! The BRDF of a surface point: a diffuse base under a specular coat. The base gets only what the coat lets
//! through, so that both together never reflect more than they receive (Kelemen and Szirmay-Kalos, "A microfacet
//! based coupled specular-matte BRDF model", 2001).
//!
//! Directions are local and point away from the surface; z is the normal.

use std::f32::consts::{FRAC_1_PI, TAU};

use nalgebra::Vector3;

use super::coat::Coat;
use crate::colour::luminance;

/// The reflectance of a surface point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reflectance {
    /// Linear diffuse albedo.
    pub albedo: Vector3<f32>,
    /// The specular coat; `None` if the surface is perfectly matt.
    pub coat: Option<Coat>,
}

/// Light, or a share of it, split by how it was reflected.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Split {
    pub diffuse: Vector3<f32>,
    pub specular: Vector3<f32>,
}

impl Split {
    pub fn sum(&self) -> Vector3<f32> {
        self.diffuse + self.specular
    }

    pub fn add(&mut self, other: &Self) {
        self.diffuse += other.diffuse;
        self.specular += other.specular;
    }

    /// Both parts times `factor`, per colour channel.
    pub fn filtered(&self, factor: &Vector3<f32>) -> Self {
        Self { diffuse: self.diffuse.component_mul(factor), specular: self.specular.component_mul(factor) }
    }
}

impl Reflectance {
    /// The BRDF for light from `wi` towards `wo`, times the cosine of `wi`; 0 below the surface.
    pub fn reflected(&self, wo: &Vector3<f32>, wi: &Vector3<f32>) -> Split {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Split::default();
        }
        let diffuse = self.albedo * (FRAC_1_PI * wi.z);
        let Some(coat) = self.coat else { return Split { diffuse, ..Split::default() } };
        let through =
            (1.0 - coat.albedo(wo.z)) * (1.0 - coat.albedo(wi.z)) / (1.0 - coat.mean_albedo()).max(1e-4);
        Split { diffuse: diffuse * through, specular: Vector3::repeat(coat.reflected(wo, wi)) }
    }

    /// Probability density of [`Self::sample`], by solid angle of `wi`.
    pub fn density(&self, wo: &Vector3<f32>, wi: &Vector3<f32>) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        let specular = self.specular_share(wo);
        let by_coat = self.coat.map_or(0.0, |coat| specular * coat.density(wo, wi));
        by_coat + (1.0 - specular) * FRAC_1_PI * wi.z
    }

    /// Samples a direction that light towards `wo` may come from, roughly in proportion to what is reflected;
    /// `choice` and `uv` are numbers in [0, 1). The direction may point into the surface.
    pub fn sample(&self, wo: &Vector3<f32>, choice: f32, uv: [f32; 2]) -> Vector3<f32> {
        match self.coat {
            Some(coat) if choice < self.specular_share(wo) => coat.sample(wo, uv),
            _ => cosine(uv),
        }
    }

    /// The probability with which [`Self::sample`] samples the coat.
    fn specular_share(&self, wo: &Vector3<f32>) -> f32 {
        let Some(coat) = self.coat else { return 0.0 };
        let specular = coat.albedo(wo.z);
        let diffuse = (1.0 - specular) * luminance(self.albedo.into());
        (specular / (specular + diffuse)).clamp(0.1, 0.9)
    }
}

/// Samples a direction in proportion to its cosine with the normal.
fn cosine([u, v]: [f32; 2]) -> Vector3<f32> {
    let (sin, cos) = (TAU * u).sin_cos();
    Vector3::new(v.sqrt() * cos, v.sqrt() * sin, (1.0 - v).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::frame::around;
    use super::*;
    use crate::{Material, colour};
    use std::sync::Arc;
    use vamvs_core::{Grid, Size};

    fn reflectance(specular: f32, roughness: f32) -> Reflectance {
        let albedo = Arc::new(Grid::filled(Size::new(1, 1), [255; 3]));
        let material = Material { albedo, tiling: [1.0; 2], tint: [1.0; 3], specular, roughness };
        Reflectance { albedo: colour::linear([255; 3]).into(), coat: Coat::of(&material) }
    }

    /// A white surface in a white sky is white: the base reflects what the coat does not.
    #[test]
    fn white_surfaces_reflect_all_light_once() {
        for (specular, roughness) in [(0.0, 0.5), (0.04, 0.1), (0.04, 0.5), (0.5, 0.3), (0.9, 0.9)] {
            let surface = reflectance(specular, roughness);
            for z in [0.1, 0.4, 0.9] {
                let (wo, count) = (around(z, 0.6), 1 << 15);
                let estimate = |index: u32| {
                    let uv =
                        [index.reverse_bits() as f32 / 2.0_f32.powi(32), (index as f32 + 0.5) / count as f32];
                    let choice = (index as f32 * 0.618_034).fract();
                    let wi = surface.sample(&wo, choice, uv);
                    let density = surface.density(&wo, &wi);
                    if density > 0.0 { surface.reflected(&wo, &wi).sum().y / density } else { 0.0 }
                };
                let albedo = (0..count).map(estimate).sum::<f32>() / count as f32;
                assert!(
                    (albedo - 1.0).abs() < 0.012,
                    "specular {specular}, roughness {roughness}, {z}: {albedo}"
                );
            }
        }
    }
}
