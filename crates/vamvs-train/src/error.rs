//! The errors of this crate.

use std::fmt::Display;
use std::path::PathBuf;

use tch::TchError;
use vamvs_io::IoError;
use vamvs_net::NetError;
use vamvs_net::error::Libtorch;

/// An error of the training crate.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file of the training data or of the run cannot be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// An error of the network crate.
    #[error(transparent)]
    Net(#[from] NetError),
    /// A folder does not contain a usable scene with ground-truth depth.
    #[error("{}: {problem}; expected scenes of `vamvs synth`, or BlendedMVS's or DTU's training set", folder.display())]
    NoScenes {
        /// The folder.
        folder: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// An option is out of range.
    #[error("{name} must be {expected}, got {found}")]
    Option {
        /// Its name.
        name: &'static str,
        /// The allowed values.
        expected: String,
        /// Its value.
        found: String,
    },
    /// The checkpoint in the run's folder cannot be continued.
    #[error("{}: {problem}", folder.display())]
    Run {
        /// The run's folder.
        folder: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// The thread that reads samples ended, which is a bug.
    #[error("{0}; this is a bug: please report it with the lines above and the data that it happened with")]
    Loader(String),
    /// The loss or the norm of the gradient is not finite.
    #[error(
        "the {what} became {value} at step {step}: lower the learning rate, or continue from an earlier checkpoint"
    )]
    Diverged {
        /// Which of the two.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Steps done before.
        step: usize,
    },
    /// There are fewer than two reference views, or none of their pixels has ground-truth depth.
    #[error(
        "there is nothing to calibrate with: expected ground-truth depths in at least two reference views, one to \
         fit to and one to measure on"
    )]
    NothingToCalibrate,
    /// A tensor operation failed, usually because memory ran out.
    #[error("a tensor operation failed (out of memory? try a smaller crop, fewer views or fewer planes)")]
    Tensor(#[source] Libtorch),
}

impl From<TchError> for TrainError {
    fn from(error: TchError) -> Self {
        Self::Tensor(Libtorch(error))
    }
}

impl TrainError {
    /// An error about an option.
    pub(crate) fn option(name: &'static str, expected: &str, found: &dyn Display) -> Self {
        Self::Option { name, expected: expected.to_string(), found: found.to_string() }
    }
}
