//! A photograph as the network sees it.

use rayon::prelude::*;
use vamvs_core::{Grid, Rgb, Size};
use vamvs_corr::layers::BLOCK;

use crate::map::Map;
use crate::recorder::{Recorder, Words};
use crate::{Gpu, GpuError};

/// A photograph in the device's memory, padded to multiples of [`BLOCK`] by repeating its last column and row.
pub struct Photograph {
    pixels: Vec<[u8; 4]>,
    buffer: wgpu::Buffer,
    /// Its size with the padding.
    pub padded: Size,
}

impl Photograph {
    pub fn new(gpu: &Gpu, image: &Grid<Rgb>) -> Result<Self, GpuError> {
        let Size { width, height } = image.size();
        let padded = Size::new(width.next_multiple_of(BLOCK), height.next_multiple_of(BLOCK));
        let mut pixels = vec![[0; 4]; padded.area()];
        pixels.par_chunks_mut(padded.width).enumerate().for_each(|(y, row)| {
            let from = image.row(y.min(height - 1));
            row.iter_mut().enumerate().for_each(|(x, pixel)| {
                let [red, green, blue] = from[x.min(width - 1)];
                *pixel = [red, green, blue, 0];
            });
        });
        let buffer = gpu.upload(&pixels)?;
        Ok(Self { pixels, buffer, padded })
    }

    /// The photograph with zero mean and unit deviation, as it is or at half its size, padded.
    pub fn seen(&self, recorder: &mut Recorder<'_>, halved: bool) -> Result<Map, GpuError> {
        let size =
            if halved { Size::new(self.padded.width / 2, self.padded.height / 2) } else { self.padded };
        let sides = [1, size.height.next_multiple_of(BLOCK), size.width.next_multiple_of(BLOCK)];
        let (mean, share) = self.moments(sides, halved);
        let output = Map::new(recorder.gpu, sides, 1)?;
        let words = Words::new()
            .counts(&[self.padded.height, self.padded.width])
            .counts(&sides[1..])
            .flag(halved)
            .numbers(&[mean, share]);
        let buffers = [&self.buffer, &output.buffer];
        recorder.run(&recorder.gpu.kernels.image, words, &buffers, [sides[2], sides[1], 1]);
        Ok(output)
    }

    /// The mean of all values, in [0, 1], and the inverse of their standard deviation, of an image of these sides.
    fn moments(&self, [_, height, width]: [usize; 3], halved: bool) -> (f32, f32) {
        let scale = if halved { 2 } else { 1 };
        let pixel = |x: usize, y: usize| &self.pixels[y * self.padded.width + x];
        let of_row = |y: usize| {
            let y = scale * y.min(self.padded.height / scale - 1);
            let (mut sum, mut squares) = (0_u64, 0_u64);
            for x in 0..width {
                let x = scale * x.min(self.padded.width / scale - 1);
                for channel in 0..3 {
                    let mut value = 0_u64;
                    for (dx, dy) in (0..scale).flat_map(|dy| (0..scale).map(move |dx| (dx, dy))) {
                        value += u64::from(pixel(x + dx, y + dy)[channel]);
                    }
                    sum += value;
                    squares += value * value;
                }
            }
            [sum, squares]
        };
        let add = |a: [u64; 2], b: [u64; 2]| [a[0] + b[0], a[1] + b[1]];
        let [sum, squares] = (0..height).into_par_iter().map(of_row).reduce(|| [0; 2], add);
        let unit = 255.0 * (scale * scale) as f64;
        let (sum, squares) = (sum as f64 / unit, squares as f64 / (unit * unit));
        let count = (3 * width * height) as f64;
        let mean = sum / count;
        let deviation = ((squares - sum * mean).max(0.0) / (count - 1.0)).sqrt();
        (mean as f32, 1.0 / (deviation + 1e-3) as f32)
    }
}
