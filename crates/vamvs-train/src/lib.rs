//! Training of the visibility-aware point-based network (sections 3.5 and 4 of the paper).
//!
//! A TorchScript module is trained through the same geometry and the same stages that estimate depth
//! ([`vamvs_net`]). In the order in which data flows: [`dataset`] finds scenes with ground-truth depth, [`sample`]
//! draws a reference view with source views, crops and reduces them and augments them ([`augment`]), [`loader`]
//! reads ahead, [`forward`] runs the stages, [`loss`] compares their output with the [`ground_truth`],
//! [`optimizer`] and [`schedule`] change the weights, [`checkpoint`] saves everything that the next step depends
//! on, and [`trainer`] is the loop around them.
//!
//! A sample depends only on the run's seed and on the sample's number, so an interrupted run continues exactly as if it
//! had not been interrupted.

pub mod augment;
pub mod calibrate;
pub mod checkpoint;
pub mod curves;
pub mod dataset;
pub mod error;
pub mod event;
pub mod forward;
pub mod ground_truth;
pub mod loader;
pub mod loss;
pub mod optimizer;
pub mod options;
pub mod run_scene;
pub mod sample;
pub mod schedule;
pub mod sheet;
pub mod trainer;
pub mod validate;

pub use calibrate::{Calibration, Outcomes, calibrate};
pub use dataset::Dataset;
pub use error::TrainError;
pub use event::TrainEvent;
pub use options::{TrainOptions, Validation};
pub use trainer::{TrainJob, train, write_module};
pub use validate::{Scores, validate};
