//! What can go wrong.

/// An error of the network or of its inputs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CorrError {
    /// The weights are damaged, or of another network.
    #[error("{problem}")]
    Weights {
        /// What was expected and what was found.
        problem: String,
    },
    /// The inputs are not as expected.
    #[error("{0}")]
    Request(String),
}
