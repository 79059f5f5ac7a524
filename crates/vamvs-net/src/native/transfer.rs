//! Projection of rows of reference pixels into a source view.

use vamvs_core::Size;
use vamvs_core::homography::PixelTransfer;

use crate::EncodedView;
use crate::project::{BEHIND, PixelGrid};

/// The transfer of a grid of pixels into one source view. Depths are in units of the nearest depth searched.
pub(crate) struct Transfer {
    /// Rows of `K_source · R · K_reference⁻¹`.
    linear: [[f64; 3]; 3],
    /// `K_source · t`, in units of the nearest depth searched.
    offset: [f32; 3],
    /// Size of the source image, padding included.
    size: Size,
}

impl Transfer {
    /// The transfer from `reference` to `source`; `near` is the nearest depth searched.
    pub fn new(reference: &EncodedView, source: &EncodedView, near: f64) -> Self {
        let source_from_reference = source.cam_from_world.compose(&reference.cam_from_world.inverse());
        let transfer = PixelTransfer::new(&reference.camera, &source.camera, &source_from_reference);
        let linear = std::array::from_fn(|row| std::array::from_fn(|column| transfer.linear[(row, column)]));
        let offset = std::array::from_fn(|row| (transfer.offset[row] / near) as f32);
        Self { linear, offset, size: source.padded }
    }

    /// Writes the rays of a row's pixels into `rays`: the pixel at depth d is at the homogeneous source pixel
    /// `d · ray + offset`.
    pub fn rays(&self, pixel_grid: &PixelGrid, row: usize, rays: &mut Vec<[f32; 3]>) {
        let y = pixel_grid.y[row];
        rays.clear();
        rays.extend(pixel_grid.x.iter().map(|x| self.linear.map(|[a, b, c]| (a * x + b * y + c) as f32)));
    }

    /// The position in the source image as a fraction of its size; `None` behind the camera.
    #[inline(always)]
    pub fn place(&self, ray: [f32; 3], depth: f32) -> Option<[f32; 2]> {
        let [x, y, z] = [0, 1, 2].map(|axis| depth * ray[axis] + self.offset[axis]);
        let scale = [1.0 / self.size.width as f32, 1.0 / self.size.height as f32];
        (z > BEHIND as f32).then(|| [x / z * scale[0], y / z * scale[1]])
    }
}
