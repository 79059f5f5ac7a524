//! What a view sees, in short: what the volume is laid out around.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::MeshOptions;
use crate::sight::Sight;
use crate::view::SeenView;

/// The largest distance of pixels, columns and rows, that an outline has...
const MOST_STRIDE: usize = 3;

/// ... which is less than a brick's width: bricks of cells of one pixel are at least so many pixels wide.
const BRICK_PIXELS: f64 = 5.0;

/// A place in the world that a view sees, and the pixel's size there, scene units.
pub(crate) type SeenPlace = (Vector3<f64>, f64);

/// A view in short: its camera, how far it sees, and the depths of some of its pixels, at least one for each brick.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outline {
    pub(crate) sight: Sight,
    stride: usize,
    /// The depths of the pixels in every so many columns and rows, row after row; not positive where there is none.
    depths: Vec<f32>,
}

impl Outline {
    /// That of a view.
    pub(crate) fn of(view: &SeenView, options: &MeshOptions) -> Self {
        let stride = ((BRICK_PIXELS * options.cell) as usize).clamp(1, MOST_STRIDE);
        let size = view.sight.camera.size;
        let columns = || (0..size.width).step_by(stride);
        let places = (0..size.height).step_by(stride).flat_map(|y| columns().map(move |x| (x, y)));
        let depths = places.map(|place| view.depth(place)).collect();
        Self { sight: view.sight.clone(), stride, depths }
    }

    /// Bytes that the view takes.
    pub(crate) fn view_bytes(&self) -> u64 {
        SeenView::bytes_of(self.sight.camera.size)
    }

    /// The sizes of the pixels on what they see, scene units.
    pub(crate) fn pixel_sizes(&self) -> impl Iterator<Item = f32> {
        self.depths.iter().filter(|depth| **depth > 0.0).map(|&depth| self.sight.rays.pixel_size(depth))
    }

    /// The places that the view sees.
    pub(crate) fn places(&self) -> impl Iterator<Item = SeenPlace> {
        let columns = self.sight.camera.size.width.div_ceil(self.stride).max(1);
        let seen = self.depths.iter().enumerate().filter(|(_, depth)| **depth > 0.0);
        seen.map(move |(number, &depth)| {
            let pixel = (number % columns * self.stride, number / columns * self.stride);
            let x_in_cam = self.sight.rays.of(pixel).cast::<f64>() * f64::from(depth);
            let pose = &self.sight.cam_from_world;
            let x_in_world = pose.rotation.tr_mul(&(x_in_cam - pose.translation));
            (x_in_world, f64::from(self.sight.rays.pixel_size(depth)))
        })
    }
}
