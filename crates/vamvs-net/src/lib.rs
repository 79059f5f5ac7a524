//! The visibility-aware point-based network (Chen et al., TPAMI 2020): from a reference view and its source
//! views to a depth map.
//!
//! The learned part is a TorchScript module ([`Network`]; `models/README.md` is its contract). This crate has
//! the geometry between the module's methods, the same for inference and for training. In the order in which
//! data flows: [`Network::encode`] computes the features of a photograph, [`cost_volume`] sweeps planes
//! through them, [`coarse`] turns the regularised costs into a coarse depth map, and [`point_flow`] refines it
//! on a cloud of hypothesised points. [`Estimator`] runs all stages; its [`fovea`] variant runs the finer ones
//! in a region only.
//!
//! Depth is in plane coordinates throughout (see [`vamvs_core::planes`]), and points are normalised by the
//! reference view's depth range, so nothing depends on the scene's scale or frame.

pub mod aggregate;
pub mod cascade;
pub mod coarse;
pub mod correlate;
pub mod cost_volume;
pub mod depth_completion;
pub mod device;
pub mod encode;
pub mod error;
pub mod estimator;
pub mod fovea;
mod joint_bilateral;
pub mod manifest;
mod native;
pub mod point_flow;
mod post_process;
pub mod profile;
pub mod project;
pub mod script;
mod slabs;
mod tensor_grid;

pub use aggregate::Aggregation;
pub use device::{Device, free_device_memory, open_device};
pub use encode::EncodedView;
pub use error::NetError;
pub use estimator::{Coarse, Estimator, EstimatorOptions};
pub use manifest::{Cascade, Iteration, Manifest};
pub use profile::{Profile, Stage};
pub use script::{Mode, Network};
pub use tch;
pub use tensor_grid::to_grid;
