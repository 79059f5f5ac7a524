//! Mipmaps: textures that are looked up at the size at which they are seen.

use std::sync::Arc;

use nalgebra::Vector3;
use vamvs_core::{Grid, Rgb, Size};

use crate::colour::{linear, srgb};

/// A texture and its versions at half the size, a quarter and so on, down to one pixel. It repeats.
pub(crate) struct Pyramid {
    full: Arc<Grid<Rgb>>,
    halved: Vec<Grid<Rgb>>,
}

impl Pyramid {
    pub fn new(full: Arc<Grid<Rgb>>) -> Self {
        let mut halved: Vec<Grid<Rgb>> = Vec::new();
        loop {
            let last = halved.last().unwrap_or(&full);
            if last.width() == 1 && last.height() == 1 {
                return Self { full, halved };
            }
            let next = half(last);
            halved.push(next);
        }
    }

    /// The size of the full texture.
    pub fn size(&self) -> Size {
        self.full.size()
    }

    /// Linear colour at texture coordinates `uv`, averaged over a footprint of `width` pixels of the full texture:
    /// interpolated within and between the versions (trilinear).
    pub fn colour(&self, uv: [f32; 2], width: f32) -> Vector3<f32> {
        let level = width.max(1.0).log2().min(self.halved.len() as f32);
        let (below, between) = (level as usize, level.fract());
        let colour = interpolated(self.level(below), uv);
        if between == 0.0 { colour } else { colour.lerp(&interpolated(self.level(below + 1), uv), between) }
    }

    fn level(&self, level: usize) -> &Grid<Rgb> {
        if level == 0 { &self.full } else { &self.halved[level - 1] }
    }
}

/// The texture at half the size (rounded up); each pixel is the mean of four, in linear light.
fn half(texture: &Grid<Rgb>) -> Grid<Rgb> {
    let Size { width, height } = texture.size();
    let last = (width - 1, height - 1);
    Grid::from_fn(Size::new(width.div_ceil(2), height.div_ceil(2)), |x, y| {
        let at = |i: usize, j: usize| linear(texture[((2 * x + i).min(last.0), (2 * y + j).min(last.1))]);
        let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
        std::array::from_fn(|c| srgb(four.iter().map(|colour| colour[c]).sum::<f32>() / 4.0))
    })
}

fn interpolated(texture: &Grid<Rgb>, [u, v]: [f32; 2]) -> Vector3<f32> {
    let Size { width, height } = texture.size();
    let (x, y) = (u * width as f32 - 0.5, (1.0 - v) * height as f32 - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let wrap = |i: f32, n: usize| ((i as i64).rem_euclid(n as i64)) as usize;
    let (x0, y0) = (wrap(left, width), wrap(top, height));
    let (x1, y1) = ((x0 + 1) % width, (y0 + 1) % height);
    let at = |x, y| Vector3::from(linear(texture[(x, y)]));
    let (s, t) = (x - left, y - top);
    at(x0, y0).lerp(&at(x1, y0), s).lerp(&at(x0, y1).lerp(&at(x1, y1), s), t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pyramid(size: Size, value: impl FnMut(usize, usize) -> Rgb) -> Pyramid {
        Pyramid::new(Arc::new(Grid::from_fn(size, value)))
    }

    #[test]
    fn the_origin_is_the_lower_left_corner_and_the_texture_repeats() {
        let texture = pyramid(Size::new(4, 2), |x, y| [40 * x as u8, 100 * y as u8, 0]);
        let expected = Vector3::from(linear([40, 100, 0]));
        for uv in [[0.375, 0.25], [1.375, 0.25], [-0.625, -0.75]] {
            assert!((texture.colour(uv, 0.5) - expected).norm() < 1e-6);
        }
    }

    #[test]
    fn far_away_only_the_mean_light_is_seen() {
        let texture = pyramid(Size::new(8, 8), |x, y| [255 * ((x + y) % 2) as u8; 3]);
        for width in [2.0, 5.0, 64.0] {
            assert!((texture.colour([0.3, 0.7], width).x - 0.5).abs() < 3e-3);
        }
        assert_eq!(texture.halved.len(), 3);
    }
}
