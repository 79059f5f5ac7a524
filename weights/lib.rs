//! The networks that are built into vamvs: TorchScript modules, each with a model card beside it.

/// The trained network of the paper that weighs views by their maximum, `vis-max.md`.
pub const VIS_MAX: &[u8] = include_bytes!("vis-max.pt");

/// The light network, `vis-corr.md`.
pub const VIS_CORR: &[u8] = include_bytes!("vis-corr.pt");

/// The handcrafted network, `photometric.md`.
pub const PHOTOMETRIC: &[u8] = include_bytes!("photometric.pt");
