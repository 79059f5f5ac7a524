//! What can go wrong.

/// An error of a GPU, or of what it was asked to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no such GPU.
    #[error("{0}")]
    NoAdapter(String),
    /// The driver refused a device, or what was asked of it.
    #[error("{adapter}: {problem}")]
    Device {
        /// The name of the GPU.
        adapter: String,
        /// What the driver says.
        problem: String,
    },
    /// The device has not enough memory.
    #[error("{adapter} has not enough memory: {problem}")]
    Memory {
        /// The name of the GPU.
        adapter: String,
        /// What was too large.
        problem: String,
    },
    /// The device was lost: its driver was reset or updated, or it was taken away.
    #[error("{adapter} was lost: {reason}; the same command continues the run")]
    Lost {
        /// The name of the GPU.
        adapter: String,
        /// What the driver says.
        reason: String,
    },
    /// The inputs are not as expected.
    #[error(transparent)]
    Corr(#[from] vamvs_corr::CorrError),
}
