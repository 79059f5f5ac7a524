//! The errors of this crate.

use std::fmt;
use std::path::PathBuf;

use tch::TchError;

/// An error of the network crate.
#[derive(Debug, thiserror::Error)]
pub enum NetError {
    /// The file holds no TorchScript module, or cannot be read.
    #[error(
        "{path}: not a TorchScript module that libtorch 2.11 can load; `vamvs info` tells what a file is, and models/README.md how to export one"
    )]
    NotAModule {
        /// The file.
        path: PathBuf,
        /// libtorch's error.
        source: Libtorch,
    },
    /// A method of the contract is missing or failed.
    #[error("{module}: method `{method}` is missing or failed; expected {expected} (models/README.md)")]
    Method {
        /// Where the module came from.
        module: String,
        /// The method.
        method: &'static str,
        /// Its signature in the contract.
        expected: &'static str,
        /// libtorch's error.
        source: Libtorch,
    },
    /// A method returned a tensor of another shape than the contract says.
    #[error(
        "{module}: method `{method}` gave a tensor of shape {found:?}, expected {expected} (models/README.md)"
    )]
    Shape {
        /// Where the module came from.
        module: String,
        /// The method.
        method: &'static str,
        /// The shape in the contract.
        expected: String,
        /// The shape of the tensor.
        found: Vec<i64>,
    },
    /// The manifest is not the JSON of the contract, or its values are not valid.
    #[error("{module}: its manifest {problem}")]
    Manifest {
        /// Where the module came from.
        module: String,
        /// What is wrong with the manifest.
        problem: String,
    },
    /// The requested device is not available.
    #[error("device `{wanted}` is not available: {reason}")]
    Device {
        /// The requested name.
        wanted: String,
        /// Why not.
        reason: String,
    },
    /// The request makes no sense for this network.
    #[error("{0}")]
    Request(String),
    /// A tensor operation failed, usually because memory ran out.
    #[error(
        "a tensor operation failed (out of memory? try smaller images with --max-size, or fewer --planes)"
    )]
    Tensor(#[source] Libtorch),
}

/// An error of libtorch, displayed without the stack trace that libtorch appends.
#[derive(Debug)]
pub struct Libtorch(pub TchError);

impl fmt::Display for Libtorch {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = self.0.to_string();
        let (words, _) = words.split_once("\nException raised from").unwrap_or((&words, ""));
        out.write_str(words)
    }
}

impl std::error::Error for Libtorch {}

impl From<TchError> for NetError {
    fn from(error: TchError) -> Self {
        Self::Tensor(Libtorch(error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libtorch_speaks_without_addresses() {
        let wrong = tch::Tensor::zeros([2], (tch::Kind::Float, tch::Device::Cpu)).f_view([3]).unwrap_err();
        assert!(wrong.to_string().contains("frame #0"), "libtorch adds a trace: {wrong}");
        let said = Libtorch(wrong).to_string();
        assert!(said.contains("shape '[3]' is invalid") && !said.contains("frame"), "{said}");
    }
}
