//! The result of a pixel's light paths, and a parallel way to fill a grid.

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::{Grid, Size};

/// The means over the light paths of a pixel, all linear.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pixel {
    /// Light straight from the sky; paths that meet a surface count as 0.
    pub background: Vector3<f32>,
    /// Diffuse albedo of the first surface; the sky counts as 0.
    pub albedo: Vector3<f32>,
    /// Diffusely reflected light divided by the albedo, so that the texture is taken out of it.
    pub diffuse: Estimate,
    /// Specularly reflected light.
    pub specular: Estimate,
    /// The first surface, averaged over the paths; `None` if all paths meet the sky.
    pub surface: Option<PixelSurface>,
}

/// The surface at a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelSurface {
    /// Mean unit normal in the world.
    pub normal: Vector3<f32>,
    /// The point on the pixel's central ray at the mean distance, relative to the camera centre, world axes.
    pub position: Vector3<f32>,
    /// Distance there to the neighbouring pixel's ray.
    pub spacing: f32,
}

/// A mean over paths and its uncertainty.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Estimate {
    pub mean: Vector3<f32>,
    /// Variance of the mean's luminance.
    pub variance: f32,
}

impl Pixel {
    /// The pixel's radiance, with the albedo multiplied back in.
    pub fn radiance(&self) -> Vector3<f32> {
        self.background + self.albedo.component_mul(&self.diffuse.mean) + self.specular.mean
    }
}

/// A grid of `value(x, y)`, computed row by row in parallel.
pub(crate) fn fill<T: Send>(size: Size, value: impl Fn(usize, usize) -> T + Sync) -> Grid<T> {
    let row = |y| (0..size.width).map(|x| value(x, y)).collect::<Vec<T>>();
    let rows: Vec<Vec<T>> = (0..size.height).into_par_iter().map(row).collect();
    Grid::from_vec(size, rows.into_iter().flatten().collect())
}
