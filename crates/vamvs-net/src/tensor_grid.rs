//! Conversion of maps between tensors and grids.

use tch::{TchError, Tensor};
use vamvs_core::{Grid, Size};

use crate::NetError;

/// Copies a map (h, w) from any device into a grid.
///
/// # Errors
/// If `map` is not of two dimensions, or memory runs out.
pub fn to_grid(map: &Tensor) -> Result<Grid<f32>, NetError> {
    let (height, width) = map.size2()?;
    let map = map.f_to_device(tch::Device::Cpu)?.f_contiguous()?.f_flatten(0, -1)?;
    Ok(Grid::from_vec(Size::new(width as usize, height as usize), Vec::<f32>::try_from(map)?))
}

/// Copies a grid into a tensor (h, w) on the device of `like`.
pub(crate) fn to_tensor(map: &Grid<f32>, like: &Tensor) -> Result<Tensor, TchError> {
    let shape = [map.height() as i64, map.width() as i64];
    Tensor::f_from_slice(map.data())?.f_view(shape)?.f_to_device(like.device())
}
