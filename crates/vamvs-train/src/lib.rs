//! Training of the visibility-aware point-based network (sections 3.5 and 4 of the paper).
//!
//! A TorchScript module learns through the same geometry and the same stages that estimate depth
//! ([`vamvs_net`]). In the order in which data flows: [`dataset`] finds scenes with true depth,
//! [`sample`] draws one reference view with sources, cut, reduced and altered ([`augment`]), [`loader`]
//! reads ahead, [`forward`] runs the stages, [`loss`] compares them with the [`ground_truth`], [`optimizer`] and
//! [`schedule`] change the weights, [`checkpoint`] keeps everything that the next step depends on, and
//! [`trainer`] goes round.
//!
//! Every sample is a function of the run's seed and its number, so a run that was stopped goes on as if
//! it had not been.

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
pub mod sample;
pub mod schedule;
pub mod sheet;
pub mod trainer;
pub mod validate;

pub use calibrate::{Calibration, calibrate};
pub use dataset::Dataset;
pub use error::TrainError;
pub use event::TrainEvent;
pub use options::{TrainOptions, Validation};
pub use trainer::{TrainJob, train, write_module};
pub use validate::{Scores, validate};
