//! A rough specular coat: microfacets of the GGX distribution (Walter et al. 2007) with Smith's
//! height-correlated shadowing (Heitz 2014) and Schlick's reflectance.
//!
//! Directions are local and point away from the surface; z is the normal.

use std::f32::consts::PI;
use std::sync::LazyLock;

use nalgebra::Vector3;
use vamvs_core::{Grid, Size};

use super::frame::around;
use crate::Material;

/// Smallest α: a perfect mirror's reflection would be a delta function.
const MIN_ALPHA: f32 = 2e-3;
/// From this reflectance at normal incidence on, light at grazing incidence is reflected fully.
const FULL_GRAZING: f32 = 0.02;

/// The coat of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Coat {
    /// Reflectance of a microfacet at normal incidence.
    normal: f32,
    /// Reflectance of a microfacet at grazing incidence.
    grazing: f32,
    /// GGX roughness: the material's roughness squared.
    alpha: f32,
}

impl Coat {
    /// The coat of a material; `None` if it is perfectly matt.
    pub fn of(material: &Material) -> Option<Self> {
        let alpha = (material.roughness * material.roughness).clamp(MIN_ALPHA, 1.0);
        let grazing = (material.specular / FULL_GRAZING).min(1.0);
        (material.specular > 0.0).then_some(Self { normal: material.specular.min(1.0), grazing, alpha })
    }

    /// The coat's BRDF for light from `wi` towards `wo`, times the cosine of `wi`.
    pub fn reflected(&self, wo: &Vector3<f32>, wi: &Vector3<f32>) -> f32 {
        let half = (wo + wi).normalize();
        let shadowing = 1.0 / (1.0 + self.lambda(wo.z) + self.lambda(wi.z));
        self.fresnel(wo.dot(&half)) * self.distribution(&half) * shadowing / (4.0 * wo.z)
    }

    /// Probability density of [`Self::sample`], by solid angle of `wi`.
    pub fn density(&self, wo: &Vector3<f32>, wi: &Vector3<f32>) -> f32 {
        let half = (wo + wi).normalize();
        self.distribution(&half) / ((1.0 + self.lambda(wo.z)) * 4.0 * wo.z)
    }

    /// Samples a reflected direction from the distribution of microfacets visible from `wo` (Dupuy and Benyoub,
    /// "Sampling visible GGX normals with spherical caps", 2023). It may point into the surface.
    pub fn sample(&self, wo: &Vector3<f32>, [u, v]: [f32; 2]) -> Vector3<f32> {
        let stretched = Vector3::new(self.alpha * wo.x, self.alpha * wo.y, wo.z).normalize();
        let facet = around((1.0 - v) * (1.0 + stretched.z) - stretched.z, u) + stretched;
        let half = Vector3::new(self.alpha * facet.x, self.alpha * facet.y, facet.z.max(1e-7)).normalize();
        half * (2.0 * wo.dot(&half)) - wo
    }

    /// The share of the light from a direction with cosine `z` that the coat reflects in total.
    pub fn albedo(&self, z: f32) -> f32 {
        self.mix(TABLE.lookup(z, self.alpha))
    }

    /// The mean of [`Self::albedo`] under a uniform sky: weighted by the cosine.
    pub fn mean_albedo(&self) -> f32 {
        self.mix(TABLE.mean(self.alpha))
    }

    /// The albedo, which is linear in both reflectances, from those of [`Table`].
    fn mix(&self, [normal, grazing]: [f32; 2]) -> f32 {
        self.normal * normal + self.grazing * grazing
    }

    fn fresnel(&self, cos: f32) -> f32 {
        let share = schlick(cos);
        self.normal * (1.0 - share) + self.grazing * share
    }

    /// GGX density of the microfacets' normals.
    fn distribution(&self, half: &Vector3<f32>) -> f32 {
        let square = self.alpha * self.alpha;
        let base = half.x * half.x + half.y * half.y + square * half.z * half.z;
        square / (PI * base * base)
    }

    /// Smith's Λ for a direction with cosine `z`.
    fn lambda(&self, z: f32) -> f32 {
        let tan_squared = (1.0 - z * z).max(0.0) / (z * z);
        0.5 * ((1.0 + self.alpha * self.alpha * tan_squared).sqrt() - 1.0)
    }
}

/// Schlick's weight of the grazing reflectance.
fn schlick(cos: f32) -> f32 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

static TABLE: LazyLock<Table> = LazyLock::new(Table::new);

/// Directional albedos of two coats: with reflectance 1 at normal incidence and 0 at grazing (first), and the
/// reverse (second). The columns are cosines z, the rows are square roots of α; both go from 0 to 1.
struct Table {
    albedos: Grid<[f32; 2]>,
    /// The cosine-weighted mean of each row.
    means: Vec<[f32; 2]>,
}

/// Number of columns and of rows in the table.
const ENTRIES: usize = 32;

/// Number of directions over which an entry of the table is integrated.
const DIRECTIONS: u32 = 512;

impl Table {
    fn new() -> Self {
        let step = |i: usize| i as f32 / (ENTRIES - 1) as f32;
        let alpha = |y: usize| step(y).powi(2).max(MIN_ALPHA);
        let albedos = Grid::from_fn(Size::new(ENTRIES, ENTRIES), |x, y| {
            integrate(step(x).max(1e-3), Coat { normal: 0.0, grazing: 0.0, alpha: alpha(y) })
        });
        let means = (0..ENTRIES).map(|y| cosine_mean(albedos.row(y))).collect();
        Self { albedos, means }
    }

    fn lookup(&self, z: f32, alpha: f32) -> [f32; 2] {
        let ((x, s), (y, t)) = (cell(z), cell(alpha.sqrt()));
        let along = |y| lerp(self.albedos[(x, y)], self.albedos[(x + 1, y)], s);
        lerp(along(y), along(y + 1), t)
    }

    fn mean(&self, alpha: f32) -> [f32; 2] {
        let (y, t) = cell(alpha.sqrt());
        lerp(self.means[y], self.means[y + 1], t)
    }
}

/// The table index below a coordinate in [0, 1], and the fraction of the way from there to the next.
fn cell(coordinate: f32) -> (usize, f32) {
    let position = coordinate.clamp(0.0, 1.0) * (ENTRIES - 1) as f32;
    let index = (position as usize).min(ENTRIES - 2);
    (index, position - index as f32)
}

fn lerp(a: [f32; 2], b: [f32; 2], t: f32) -> [f32; 2] {
    [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

/// The two albedos of [`Table`] for light from a direction with cosine `z`; only the coat's α is used.
fn integrate(z: f32, coat: Coat) -> [f32; 2] {
    let wo = around(z, 0.0);
    let mut sums = [0.0; 2];
    for index in 0..DIRECTIONS {
        let uv = [index.reverse_bits() as f32 / 2.0_f32.powi(32), (index as f32 + 0.5) / DIRECTIONS as f32];
        let wi = coat.sample(&wo, uv);
        if wi.z > 0.0 {
            let (out, into) = (coat.lambda(wo.z), coat.lambda(wi.z));
            let unshadowed = (1.0 + out) / (1.0 + out + into);
            let share = schlick(wo.dot(&(wo + wi).normalize()));
            sums[0] += unshadowed * (1.0 - share);
            sums[1] += unshadowed * share;
        }
    }
    sums.map(|sum| sum / DIRECTIONS as f32)
}

/// 2 ∫ albedo(z) z dz over z from 0 to 1, exact for an albedo that is linear between the entries.
fn cosine_mean(albedos: &[[f32; 2]]) -> [f32; 2] {
    let width = 1.0 / (ENTRIES - 1) as f32;
    let mut mean = [0.0; 2];
    for (index, pair) in albedos.windows(2).enumerate() {
        let z = index as f32 * width;
        for (mean, (a, b)) in mean.iter_mut().zip(pair[0].into_iter().zip(pair[1])) {
            *mean += width * (z * (a + b) + width * (a + 2.0 * b) / 3.0);
        }
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::TAU;

    fn coats() -> [Coat; 4] {
        let coat = |normal, roughness: f32| Coat { normal, grazing: 1.0, alpha: roughness * roughness };
        [coat(0.04, 0.2), coat(0.04, 0.6), coat(1.0, 0.4), coat(0.5, 1.0)]
    }

    /// The integral of `value(direction)` over the upper hemisphere.
    fn over_hemisphere(mut value: impl FnMut(&Vector3<f32>) -> f32) -> f32 {
        let (rows, columns) = (600, 600);
        let mut sum = 0.0_f64;
        for row in 0..rows {
            for column in 0..columns {
                let wi = around((row as f32 + 0.5) / rows as f32, (column as f32 + 0.5) / columns as f32);
                sum += f64::from(value(&wi));
            }
        }
        (sum * f64::from(TAU) / f64::from(rows * columns)) as f32
    }

    #[test]
    fn the_albedo_is_the_integral_of_what_is_reflected() {
        for coat in coats() {
            for z in [0.15, 0.5, 0.95] {
                let wo = around(z, 0.1);
                let integral = over_hemisphere(|wi| coat.reflected(&wo, wi));
                let albedo = coat.albedo(z);
                assert!((integral - albedo).abs() < 4e-3, "{coat:?} at {z}: {integral} {albedo}");
                assert!(albedo <= 1.0);
            }
        }
    }

    #[test]
    fn samples_have_their_density() {
        for coat in coats() {
            let wo = around(0.4, 0.3);
            let z_by_density = over_hemisphere(|wi| wi.z * coat.density(&wo, wi));
            let count = 1 << 16;
            let heights = (0..count).map(|index: u32| {
                let uv = [index.reverse_bits() as f32 / 2.0_f32.powi(32), index as f32 / count as f32];
                coat.sample(&wo, uv).z.max(0.0)
            });
            let z_by_samples = heights.sum::<f32>() / count as f32;
            assert!((z_by_density - z_by_samples).abs() < 3e-3, "{coat:?}: {z_by_density} {z_by_samples}");
        }
    }

    #[test]
    fn reflection_is_reciprocal() {
        let (a, b) = (around(0.3, 0.2), around(0.8, 0.7));
        for coat in coats() {
            let (forth, back) = (coat.reflected(&a, &b) / b.z, coat.reflected(&b, &a) / a.z);
            assert!((forth - back).abs() < 1e-5 * forth.max(1.0));
        }
    }
}
