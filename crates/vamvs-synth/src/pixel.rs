//! The means over the light paths of a pixel, and grids of pixels filled by many threads.

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::{Grid, Size};

/// The mean over the paths of a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pixel {
    /// Light straight from the sky.
    pub background: Vector3<f32>,
    /// Diffuse albedo of the first surface, 0 for the sky.
    pub albedo: Vector3<f32>,
    /// Diffusely reflected light by albedo.
    pub diffuse: Estimate,
    /// Specularly reflected light.
    pub specular: Estimate,
    /// What the paths meet first, if any meets a surface.
    pub surface: Option<PixelSurface>,
}

/// The surface at a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelSurface {
    /// Mean unit normal in the world.
    pub normal: Vector3<f32>,
    /// Where the pixel's central ray is at the mean distance, from the camera along the world's axes.
    pub position: Vector3<f32>,
    /// Distance there to the next pixel's ray.
    pub spacing: f32,
}

/// A mean over paths.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Estimate {
    pub mean: Vector3<f32>,
    /// Variance of the mean's luminance.
    pub variance: f32,
}

impl Pixel {
    /// All light.
    pub fn radiance(&self) -> Vector3<f32> {
        self.background + self.albedo.component_mul(&self.diffuse.mean) + self.specular.mean
    }
}

/// Fills each pixel with `value(x, y)`, rows in parallel.
pub(crate) fn fill<T: Send>(size: Size, value: impl Fn(usize, usize) -> T + Sync) -> Grid<T> {
    let row = |y| (0..size.width).map(|x| value(x, y)).collect::<Vec<T>>();
    let rows: Vec<Vec<T>> = (0..size.height).into_par_iter().map(row).collect();
    Grid::from_vec(size, rows.into_iter().flatten().collect())
}
