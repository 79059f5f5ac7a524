//! Photographs with known cameras in, depth maps and one dense, coloured cloud out.
//!
//! This is the face of the library, what other programs embed. In the order in which data flows:
//! [`input`] reads a scene, [`plan`](mod@plan) decides for each view its source views, depth range and
//! planes, [`depth`] estimates the depth maps with the network and keeps them in an [`output`] folder,
//! [`fuse`](mod@fuse) merges them into a cloud. Progress comes as [`Event`]s; nothing here prints.
//!
//! Without the feature `net` the crate builds and runs without libtorch, and everything but [`depth`]
//! is there.

#[cfg(feature = "net")]
pub mod depth;
pub mod error;
pub mod event;
#[cfg(feature = "net")]
mod feature_cache;
pub mod fuse;
#[cfg(feature = "net")]
mod identity;
pub mod input;
pub mod options;
pub mod output;
pub mod photographs;
pub mod plan;
#[cfg(feature = "net")]
pub mod weights;

#[cfg(feature = "net")]
pub use depth::{DepthSummary, estimate};
pub use error::VamvsError;
pub use event::Event;
pub use fuse::{FuseSummary, fuse};
pub use input::Input;
pub use options::{DepthOptions, FusionOptions};
pub use output::OutputFolder;
pub use photographs::Photographs;
pub use plan::{Plan, ViewPlan, plan};

pub use vamvs_core as core;
pub use vamvs_fusion as fusion;
pub use vamvs_io as io;
#[cfg(feature = "net")]
pub use vamvs_net as net;
