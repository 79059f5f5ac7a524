//! How surfaces reflect light.

use std::sync::Arc;

use vamvs_core::{Grid, Rgb};

/// How a surface reflects light: a diffuse base under a rough specular coat.
#[derive(Clone, Debug)]
pub struct Material {
    /// Texture of the diffuse albedo, sRGB-encoded.
    pub albedo: Arc<Grid<Rgb>>,
    /// Repetitions of the texture per unit of u and of v.
    pub tiling: [f32; 2],
    /// Factor on the (linear) albedo, to tint the texture.
    pub tint: [f32; 3],
    /// Reflectance of the coat at normal incidence, 0 to 1: 0.04 is plastic, 0 is perfectly matt.
    pub specular: f32,
    /// Roughness of the coat, 0 (mirror) to 1.
    pub roughness: f32,
}
