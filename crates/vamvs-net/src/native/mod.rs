//! Kernels for the irregular parts of the paper's networks on the CPU, without libtorch's intermediate tensors: sampling,
//! the shared MLP on pairs of views, edge convolutions.
//!
//! libtorch warps all channels of a source view and relates them step by step, each into a tensor of its own.
//! The kernels read the features of a position once and write only the result. Training and GPUs use tensor
//! operations instead, against which these kernels are tested.

mod dot;
pub(crate) mod edges;
pub(crate) mod layers;
pub(crate) mod ncc;
pub(crate) mod pairs;
pub(crate) mod samples;
pub(crate) mod transfer;
pub(crate) mod views;

use tch::{Device, Kind, TchError, Tensor};

use tch::kind::Element;

use crate::NetError;

/// Whether kernels can read features (1, C, h, w): they are `f32` on the CPU, and no gradient flows back.
pub(crate) fn readable(features: &[Tensor]) -> bool {
    let fits = |level: &Tensor| {
        level.device() == Device::Cpu && level.kind() == Kind::Float && !level.requires_grad()
    };
    features.iter().all(fits)
}

/// Features (1, C, h, w) laid out so that the channels of a pixel are contiguous in memory; the shape stays.
pub(crate) fn channels_last(features: &Tensor) -> Result<Tensor, TchError> {
    features.f_permute([0, 2, 3, 1])?.f_contiguous()?.f_permute([0, 3, 1, 2])
}

/// Whether the channels of a pixel of features (1, C, h, w) are contiguous in memory, as [`channels_last`] lays them out.
pub(crate) fn is_channels_last(features: &Tensor) -> Result<bool, TchError> {
    Ok(features.f_permute([0, 2, 3, 1])?.is_contiguous())
}

/// One level of features in memory, (h, w, C).
#[derive(Clone, Copy)]
pub(crate) struct Level<'a> {
    pub values: &'a [f32],
    pub width: usize,
    pub height: usize,
    pub channels: usize,
}

impl<'a> Level<'a> {
    /// The values of features (1, C, h, w) that were laid out by [`channels_last`].
    pub fn of(features: &'a Tensor) -> Result<Self, NetError> {
        let (_, channels, height, width) = features.size4()?;
        let [channels, height, width] = [channels, height, width].map(|side| side as usize);
        let laid_out = features.f_permute([0, 2, 3, 1])?;
        let values: &[f32] = in_memory(&laid_out)?;
        // SAFETY: the permuted tensor shares its storage with the features, which are borrowed for 'a.
        let values: &'a [f32] = unsafe { std::slice::from_raw_parts(values.as_ptr(), values.len()) };
        Ok(Self { values, width, height, channels })
    }
}

/// The values of a contiguous tensor of type `T` on the CPU.
///
/// # Errors
/// If the tensor has another type, device or layout.
pub(crate) fn in_memory<T: Element>(tensor: &Tensor) -> Result<&[T], NetError> {
    if tensor.kind() != T::KIND || tensor.device() != Device::Cpu || !tensor.is_contiguous() {
        return Err(NetError::Request(format!(
            "a native kernel was given a tensor that is not a contiguous {:?} tensor on the CPU",
            T::KIND
        )));
    }
    if tensor.numel() == 0 {
        return Ok(&[]);
    }
    // SAFETY: a contiguous tensor has `numel` values from `data_ptr` on. They live as long as it does, and nothing writes to
    // them meanwhile: tensors that share them are not written to in this crate's kernels.
    Ok(unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast::<T>(), tensor.numel()) })
}

/// As [`in_memory`], mutable, for a tensor that was just created.
pub(crate) fn in_memory_mut(tensor: &mut Tensor) -> Result<&mut [f32], NetError> {
    let values = in_memory::<f32>(tensor)?;
    if values.is_empty() {
        return Ok(&mut []);
    }
    // SAFETY: as above, and nothing else refers to the tensor yet.
    Ok(unsafe { std::slice::from_raw_parts_mut(values.as_ptr().cast_mut(), values.len()) })
}
