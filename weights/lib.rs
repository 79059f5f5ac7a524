//! The networks that are built into vamvs, each the bytes of a TorchScript module. The model card of `NAME.pt` is
//! `NAME.md`.

/// The paper's network with max aggregation over pairs of views, trained: `vis-max.md`.
pub const VIS_MAX: &[u8] = include_bytes!("vis-max.pt");

/// The light network with group-wise correlation, trained: `vis-corr.md`.
pub const VIS_CORR: &[u8] = include_bytes!("vis-corr.pt");

/// The handcrafted plane-sweep matcher: `photometric.md`.
pub const PHOTOMETRIC: &[u8] = include_bytes!("photometric.pt");
