//! Measures of depth maps and clouds against ground truth, as benchmarks define them.
//!
//! [`depth`] compares depth maps, [`cloud`] compares clouds. [`dtu`] and [`tnt`] are the protocols of two benchmarks,
//! built from [`thin`](mod@thin), [`voxel`] and [`icp`]. [`surface`] makes a ground-truth cloud from ground-truth
//! depth maps. [`reliability`] measures how well confidence is calibrated. This crate reads no files and draws no
//! figures.

mod cells;
pub mod cloud;
pub mod crop;
pub mod depth;
pub mod dtu;
pub mod icp;
pub mod nearest;
pub mod reliability;
mod samples;
pub mod stats;
pub mod surface;
pub mod thin;
pub mod tnt;
pub mod voxel;
pub mod voxel_mask;

pub use cells::TooFine;
pub use cloud::{Agreement, CloudDistances, CloudErrors, compare_clouds};
pub use crop::CropVolume;
pub use depth::{DepthErrors, DepthSamples, PixelMap, Region, Threshold};
pub use nearest::nearest_distances;
pub use reliability::Reliability;
pub use samples::{area, samples};
pub use stats::Spread;
pub use thin::thin;
pub use voxel::voxel_means;
pub use voxel_mask::VoxelMask;
