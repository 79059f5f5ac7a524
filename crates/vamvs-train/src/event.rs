//! What training tells of itself, for a program to draw or to log.

use std::path::PathBuf;

use serde::Serialize;

use crate::validate::Scores;

/// What happened.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum TrainEvent {
    /// The run begins or goes on.
    Begun {
        /// Scenes to learn from.
        scenes: usize,
        /// Steps already done.
        step: usize,
        /// Steps in all.
        steps: usize,
    },
    /// A step of the optimiser is done.
    Step(StepRecord),
    /// The network was measured.
    Validated(ValidationRecord),
    /// All that the next step depends on was written.
    Saved {
        /// The steps done.
        step: usize,
        /// The folder.
        folder: PathBuf,
    },
}

/// One step of the optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, serde::Deserialize)]
pub struct StepRecord {
    /// Steps done, this one included.
    pub step: usize,
    /// What is minimised, the mean over the batch.
    pub loss: f64,
    /// Mean |u − u_gt| / s of each stage, coarse first; none where nothing was known.
    pub stages: Vec<Option<f64>>,
    /// Mean |V − V_gt| (vis-var).
    pub visibility: Option<f64>,
    /// The gradient's norm before clipping.
    pub gradient: f64,
    /// The learning rate.
    pub learning_rate: f64,
    /// Seconds that the step took.
    pub seconds: f64,
    /// Of these, seconds of waiting for data.
    pub waited: f64,
}

/// One measurement.
#[derive(Clone, Debug, PartialEq, Serialize, serde::Deserialize)]
pub struct ValidationRecord {
    /// Steps done.
    pub step: usize,
    /// The scores.
    pub scores: Scores,
    /// Whether they are the best so far.
    pub best: bool,
}
