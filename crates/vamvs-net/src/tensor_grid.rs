//! Maps as tensors and as grids.

use tch::{TchError, Tensor};
use vamvs_core::{Grid, Size};

use crate::NetError;

/// A map (h, w) in memory.
///
/// # Errors
/// If `map` is not of two dimensions, or memory runs out.
pub fn to_grid(map: &Tensor) -> Result<Grid<f32>, NetError> {
    let (height, width) = map.size2()?;
    let map = map.f_to_device(tch::Device::Cpu)?.f_contiguous()?.f_flatten(0, -1)?;
    Ok(Grid::from_vec(Size::new(width as usize, height as usize), Vec::<f32>::try_from(map)?))
}

/// A map (h, w) where `like` lives.
pub(crate) fn to_tensor(map: &Grid<f32>, like: &Tensor) -> Result<Tensor, TchError> {
    let shape = [map.height() as i64, map.width() as i64];
    Tensor::f_from_slice(map.data())?.f_view(shape)?.f_to_device(like.device())
}
