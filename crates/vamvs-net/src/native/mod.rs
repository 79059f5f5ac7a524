//! vis-corr's irregular parts on a processor, without what libtorch would write to memory in between.
//!
//! libtorch warps all channels of a source view, multiplies, and averages groups, each into a tensor of its own. Here
//! the features of a place are read once, and what is written is the result. Gradients and GPUs take the path of
//! tensors, which these kernels are tested against.

mod dot;
pub(crate) mod fetch;
pub(crate) mod sweep;
pub(crate) mod transfer;

use tch::{Device, Kind, TchError, Tensor};

use crate::{NetError, Network};

/// Groups of channels of one level of features that the kernels are compiled for.
const GROUPS: [usize; 2] = [4, 8];

/// Whether the kernels can do the work: correlation on a processor, without gradients, of features (1, C, h, w) with
/// as many groups as they know.
pub(crate) fn serves(network: &Network, features: &[Tensor]) -> bool {
    let manifest = network.manifest();
    let fits = |level: &Tensor| {
        level.device() == Device::Cpu
            && level.kind() == Kind::Float
            && !level.requires_grad()
            && GROUPS.contains(&(level.size()[1] as usize / manifest.group))
    };
    manifest.aggregation.correlates() && features.iter().all(fits)
}

/// Features (1, C, h, w) with the channels of a place beside each other in memory; the shape stays.
pub(crate) fn channels_last(features: &Tensor) -> Result<Tensor, TchError> {
    features.f_permute([0, 2, 3, 1])?.f_contiguous()?.f_permute([0, 3, 1, 2])
}

/// Values in memory, (h, w, C).
#[derive(Clone, Copy)]
pub(crate) struct Level<'a> {
    pub values: &'a [f32],
    pub width: usize,
    pub height: usize,
    pub channels: usize,
}

impl<'a> Level<'a> {
    /// The values of features (1, C, h, w) that [`channels_last`] laid out.
    pub fn of(features: &'a Tensor) -> Result<Self, NetError> {
        let (_, channels, height, width) = features.size4()?;
        let [channels, height, width] = [channels, height, width].map(|side| side as usize);
        Ok(Self { values: in_memory(&features.f_permute([0, 2, 3, 1])?)?, width, height, channels })
    }
}

/// The values of a contiguous tensor of floats on the processor, for as long as something holds its memory.
pub(crate) fn in_memory<'a>(tensor: &Tensor) -> Result<&'a [f32], NetError> {
    if tensor.kind() != Kind::Float || tensor.device() != Device::Cpu || !tensor.is_contiguous() {
        return Err(NetError::Request(
            "a native kernel was given a tensor that is not of floats, in order, on the processor".to_owned(),
        ));
    }
    // SAFETY: a contiguous tensor has `numel` values from `data_ptr` on. Its storage is that of features which the
    // caller borrows for the lifetime, and nobody writes to them.
    Ok(unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast::<f32>(), tensor.numel()) })
}

/// The same of a tensor that was just made, to be filled.
pub(crate) fn in_memory_mut<'a>(tensor: &Tensor) -> Result<&'a mut [f32], NetError> {
    let values = in_memory(tensor)?;
    // SAFETY: as above, and nobody else knows of the tensor yet.
    Ok(unsafe { std::slice::from_raw_parts_mut(values.as_ptr().cast_mut(), values.len()) })
}
