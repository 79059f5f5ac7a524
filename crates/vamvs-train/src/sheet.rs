//! A picture that shows depth maps next to their ground truth.

use std::path::Path;

use vamvs_core::{Grid, Rgb, Size};
use vamvs_io::image;
use vamvs_picture::Scale;
use vamvs_picture::map::{relative_errors, spread, valid};
use vamvs_picture::panel;

use crate::TrainError;
use crate::validate::Example;

/// The most rows of a sheet, and the width of each of its pictures, pixels.
const ROWS: usize = 8;
const WIDTH: usize = 192;
/// The relative error at the upper end of the colour scale.
const WORST: f32 = 0.04;

/// One row for each reference view: photograph, ground truth, coarse depth, final depth, error.
#[derive(Default)]
pub struct Sheet {
    rows: Vec<Grid<Rgb>>,
}

impl Sheet {
    /// Adds a view, if there is room.
    pub fn add(&mut self, example: &Example) {
        if self.rows.len() == ROWS {
            return;
        }
        let (Some(coarse), Some(last)) = (example.stages.first(), example.stages.last()) else { return };
        let ground_truth = valid(&example.ground_truth);
        let (low, high) = spread(&ground_truth);
        let depth = |map: &Grid<f32>| Scale::Turbo.paint(&valid(map), low, high);
        let last = cropped(last, example.ground_truth.size());
        let errors = relative_errors(&last, &example.ground_truth);
        let pictures = [
            example.photo.image.clone(),
            Scale::Turbo.paint(&ground_truth, low, high),
            depth(coarse),
            depth(&last),
            Scale::Error.paint(&errors, 0.0, WORST),
        ];
        let size = panel::of_width(example.photo.camera.size, WIDTH);
        self.rows.push(panel::row(&pictures, size));
    }

    /// Writes the sheet as a PNG file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), TrainError> {
        let width = self.rows.iter().map(|row| row.size().width).max().unwrap_or(1);
        let height: usize = self.rows.iter().map(|row| row.size().height).sum();
        let mut sheet = Grid::filled(Size::new(width, height.max(1)), [255; 3]);
        let mut top = 0;
        for row in &self.rows {
            for y in 0..row.size().height {
                sheet.row_mut(top + y)[..row.size().width].copy_from_slice(row.row(y));
            }
            top += row.size().height;
        }
        Ok(image::save_png_rgb(path, &sheet)?)
    }
}

/// The map without its padding.
fn cropped(map: &Grid<f32>, size: Size) -> Grid<f32> {
    Grid::from_fn(size, |x, y| map[(x, y)])
}
