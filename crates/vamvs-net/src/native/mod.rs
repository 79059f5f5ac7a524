//! Kernels for the sampling and correlation of vis-corr on the CPU, without libtorch's intermediate tensors.
//!
//! libtorch warps all channels of a source view, multiplies, and averages groups, each step into a tensor of its own.
//! The kernels read the features of a position once and write only the result. Training and GPUs use tensor
//! operations instead, against which these kernels are tested.

mod dot;
pub(crate) mod fetch;
pub(crate) mod sweep;
pub(crate) mod transfer;

use tch::{Device, Kind, TchError, Tensor};

use crate::{Aggregation, NetError, Network};

/// The numbers of groups in one level of features for which the kernels are compiled.
const GROUPS: [usize; 2] = [4, 8];

/// Whether the kernels apply: the network is a vis-corr, whose weighted mean they compute, and its features (1, C, h, w) are on the CPU, need no gradient,
/// and have a supported number of groups.
pub(crate) fn serves(network: &Network, features: &[Tensor]) -> bool {
    let manifest = network.manifest();
    let fits = |level: &Tensor| {
        level.device() == Device::Cpu
            && level.kind() == Kind::Float
            && !level.requires_grad()
            && GROUPS.contains(&(level.size()[1] as usize / manifest.group))
    };
    manifest.aggregation == Aggregation::VisCorr && features.iter().all(fits)
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
        Ok(Self { values: in_memory(&features.f_permute([0, 2, 3, 1])?)?, width, height, channels })
    }
}

/// The values of a contiguous `f32` tensor on the CPU. The caller keeps the tensor's memory alive for `'a`.
///
/// # Errors
/// If the tensor has another type, device or layout.
pub(crate) fn in_memory<'a>(tensor: &Tensor) -> Result<&'a [f32], NetError> {
    if tensor.kind() != Kind::Float || tensor.device() != Device::Cpu || !tensor.is_contiguous() {
        return Err(NetError::Request(
            "a native kernel was given a tensor that is not a contiguous f32 tensor on the CPU".to_owned(),
        ));
    }
    // SAFETY: a contiguous tensor has `numel` values from `data_ptr` on. The caller keeps its storage alive for the
    // lifetime, and nothing writes to it.
    Ok(unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast::<f32>(), tensor.numel()) })
}

/// As [`in_memory`], mutable, for a tensor that was just created.
pub(crate) fn in_memory_mut<'a>(tensor: &Tensor) -> Result<&'a mut [f32], NetError> {
    let values = in_memory(tensor)?;
    // SAFETY: as above, and nothing else refers to the tensor yet.
    Ok(unsafe { std::slice::from_raw_parts_mut(values.as_ptr().cast_mut(), values.len()) })
}
