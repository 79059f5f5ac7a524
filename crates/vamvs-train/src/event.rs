//! The events of a training run, for a program to display or to log.

use std::path::PathBuf;

use serde::Serialize;

use crate::validate::Scores;

/// An event of a training run.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum TrainEvent {
    /// The run begins or continues.
    Begun {
        /// Number of training scenes.
        scenes: usize,
        /// Steps already done.
        step: usize,
        /// Steps in all.
        steps: usize,
    },
    /// A step of the optimiser is done.
    Step(StepRecord),
    /// The network was validated.
    Validated(ValidationRecord),
    /// A checkpoint was written.
    Saved {
        /// Steps done.
        step: usize,
        /// The checkpoint's folder.
        folder: PathBuf,
    },
}

/// One step of the optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, serde::Deserialize)]
pub struct StepRecord {
    /// Steps done, this one included.
    pub step: usize,
    /// The minimised loss, averaged over the batch.
    pub loss: f64,
    /// Mean |u − u_gt| / s of each stage, coarse first; `None` without ground truth.
    pub stages: Vec<Option<f64>>,
    /// Mean |V − V_gt| (vis-var and vis-corr); `None` without ground truth.
    pub visibility: Option<f64>,
    /// The gradient's norm before clipping.
    pub gradient: f64,
    /// The learning rate.
    pub learning_rate: f64,
    /// Seconds that the step took.
    pub seconds: f64,
    /// Seconds of these spent waiting for samples.
    pub waited: f64,
}

/// One validation.
#[derive(Clone, Debug, PartialEq, Serialize, serde::Deserialize)]
pub struct ValidationRecord {
    /// Steps done.
    pub step: usize,
    /// The scores.
    pub scores: Scores,
    /// Whether they are the best so far.
    pub best: bool,
}
