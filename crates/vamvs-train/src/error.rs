//! What can go wrong in training.

use std::fmt::Display;
use std::path::PathBuf;

use tch::TchError;
use vamvs_io::IoError;
use vamvs_net::NetError;
use vamvs_net::error::Libtorch;

/// An error of the training crate.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file of the data or of the run.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The network.
    #[error(transparent)]
    Net(#[from] NetError),
    /// A folder holds no scene with true depths.
    #[error("{}: {problem}; expected scenes of `vamvs synth`, or BlendedMVS's or DTU's training set", folder.display())]
    NoScenes {
        /// The folder.
        folder: PathBuf,
        /// What was found.
        problem: String,
    },
    /// An option that makes no sense.
    #[error("{name} must be {expected}, got {found}")]
    Option {
        /// Its name.
        name: &'static str,
        /// What it may be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// A run that does not fit its folder.
    #[error("{}: {problem}", folder.display())]
    Run {
        /// The run's folder.
        folder: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// The thread that reads samples ended: a bug.
    #[error("{0}; this is a bug: please report it with the lines above and the data that it happened with")]
    Loader(String),
    /// The loss or the gradient is no number any more.
    #[error(
        "the {what} became {value} at step {step}: lower the learning rate, or go on from an earlier checkpoint"
    )]
    Diverged {
        /// Which of the two.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The step.
        step: usize,
    },
    /// There are too few views, or no pixel of them has a true depth.
    #[error(
        "there is nothing to calibrate with: expected true depths in two reference views at least, one to fit to \
         and one to measure"
    )]
    NothingToCalibrate,
    /// A tensor operation failed: out of memory, as a rule.
    #[error("a tensor operation failed (out of memory? try a smaller crop, fewer views or fewer planes)")]
    Tensor(#[source] Libtorch),
}

impl From<TchError> for TrainError {
    fn from(error: TchError) -> Self {
        Self::Tensor(Libtorch(error))
    }
}

impl TrainError {
    /// The error of an option.
    pub(crate) fn option(name: &'static str, expected: &str, found: &dyn Display) -> Self {
        Self::Option { name, expected: expected.to_string(), found: found.to_string() }
    }
}
