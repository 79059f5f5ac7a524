//! Filtering depth maps and fusing them into one cloud (section 4.2.2).
//!
//! [`fuse`] goes over the views twice. First it decides for each pixel whether it is *kept*: it has
//! a depth, is confident ([`FuseOptions::min_confidence`]), and source views confirm it
//! ([`Consistency`]). Then it turns kept pixels into points: where several views keep the same
//! place of a surface, the one that sees it in most detail makes the point, on its pixel's ray at a
//! robust mean of all depths that agree, and the others are merged into it. Both passes read only
//! depth maps and the result of the pass before, so the cloud depends neither on the number of
//! threads nor on how many maps fit into memory. Views are visited in an order that keeps
//! neighbours together, and in the second pass in the reverse order, so that few maps are loaded
//! more than twice. The maps of the next view are loaded while a view is processed, and points are
//! written while the next ones are made. Processes that share depth maps can each do a
//! [`Part`](vamvs_core::Part) of a pass with [`confirm`] and [`merge`]; a [`Collector`] makes the
//! same cloud of their results.
//!
//! Pixels are projected to other views and back 64 at a time, in loops over single-precision arrays
//! that the compiler turns into vector instructions (`round_trip`).
//!
//! This crate reads and writes no files: depth maps come from a [`MapSource`], points go to a
//! closure.

mod appearance;
mod bits;
mod cache;
mod candidates;
mod collector;
mod consistency;
mod error;
mod event;
mod fuse;
mod geometric;
mod lanes;
mod mean;
mod merge;
mod normals;
mod options;
mod order;
mod outlet;
mod packed_normal;
mod pair;
mod passes;
mod photometric;
mod points;
mod priority;
mod report;
mod round_trip;
mod sample;
mod schedule;
mod source;
mod spacing;
mod surface;

pub use collector::{Batch, Collector};
pub use error::{BoxError, FuseError};
pub use event::{FuseEvent, OnFuseEvent};
pub use fuse::{FuseJob, fuse, fuse_to_cloud};
pub use geometric::{ConsistentPixels, Counts};
pub use options::{Consistency, FuseOptions, OptionsError, PointSpacing};
pub use passes::{ConsistentViews, confirm, merge};
pub use points::FusedPoints;
pub use report::{FuseReport, ViewReport};
pub use schedule::Schedule;
pub use source::{FusionView, MapSource, MaskedMap, expect_sizes};
pub use surface::Surface;
