//! The networks that are built into vamvs. The model card of `NAME` is `NAME.md`.

/// The default network, group-wise correlation and a cascade of volumes, trained: `vis-corr.md`. Its weights, for `vamvs-corr`.
pub const VIS_CORR: &[u8] = include_bytes!("vis-corr.safetensors");

/// The paper's network with max aggregation over pairs of views, trained: `vis-max.md`.
#[cfg(feature = "modules")]
pub const VIS_MAX: &[u8] = include_bytes!("vis-max.pt");

/// The same as [`VIS_CORR`] as a TorchScript module, for GPUs and for training.
#[cfg(feature = "modules")]
pub const VIS_CORR_MODULE: &[u8] = include_bytes!("vis-corr.pt");

/// The handcrafted plane-sweep matcher: `photometric.md`.
#[cfg(feature = "modules")]
pub const PHOTOMETRIC: &[u8] = include_bytes!("photometric.pt");
