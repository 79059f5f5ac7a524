//! Photographs with known cameras in, depth maps and one dense, coloured cloud out.
//!
//! This crate is the interface for programs that embed vamvs. In the order of the data: [`input`]
//! reads a scene, [`plan`](mod@plan) decides source views, depth range and planes of each view,
//! [`depth`] estimates depth maps with the network, refines them to the size of their photographs
//! and keeps them in an [`output`] folder, [`refine`](mod@refine) refines existing depth maps,
//! [`maps`] reads depth maps of vamvs or other programs, [`fuse`](mod@fuse) merges them into a
//! cloud, and [`export`] writes files for other programs. [`report`] shows a run on a page, and
//! [`eval`] compares results with ground truth. Progress comes as [`Event`]s; nothing here prints.
//!
//! The default network, vis-corr, runs without libtorch ([`Method::VisCorr`]). The feature `torch` adds TorchScript modules
//! and GPUs.

mod ceiling;
pub mod depth;
pub mod error;
pub mod eval;
pub mod event;
pub mod export;
mod feature_cache;
mod fit;
pub mod fuse;
mod geometric;
mod identity;
pub mod input;
mod lenses;
pub mod maps;
pub mod memory;
pub mod mesh;
mod method;
pub mod options;
mod order;
pub mod output;
mod part_files;
pub mod photographs;
mod place;
pub mod plan;
mod prepared;
pub mod pseudo;
mod quality;
mod reconstruction;
pub mod refine;
mod refinement;
mod region;
pub mod report;
mod surfaces;
mod view_map;
pub mod weights;

pub use depth::{DepthJob, DepthMaps, DepthSummary, estimate};
pub use error::VamvsError;
pub use event::{Event, OnEvent, Pass};
pub use export::ExportOptions;
pub use fuse::{FuseSummary, PartialFusion, fuse};
pub use input::Input;
pub use lenses::warn_of_lenses;
pub use maps::Maps;
pub use memory::MemoryLimit;
pub use mesh::{MeshSummary, PartialMesh, mesh, mesh_in_memory, mesh_of};
#[cfg(feature = "torch")]
pub use method::NetworkMethod;
#[cfg(not(feature = "torch"))]
pub use method::WITH_LIBTORCH;
pub use method::{Method, VisCorr};
pub use options::{DepthOptions, FusionOptions, Stretching};
pub use output::OutputFolder;
pub use photographs::{PhotoSource, Photographs, Picture};
pub use plan::{Plan, ViewPlan, plan};
pub use prepared::Prepared;
pub use quality::Quality;
pub use reconstruction::{Reconstructed, Reconstruction};

pub use view_map::{ViewMap, fuse_in_memory};

pub use nalgebra;
pub use vamvs_core as core;
pub use vamvs_corr as corr;
pub use vamvs_eval as measures;
pub use vamvs_fusion as fusion;
#[cfg(feature = "gpu")]
pub use vamvs_gpu as gpu;
pub use vamvs_io as io;
pub use vamvs_mesh as meshing;
#[cfg(feature = "torch")]
pub use vamvs_net as net;
