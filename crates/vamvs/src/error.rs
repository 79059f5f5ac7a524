//! What can go wrong between a scene and its cloud.

use std::path::PathBuf;

/// An error of the pipeline.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VamvsError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] vamvs_io::IoError),
    /// Fusion.
    #[error(transparent)]
    Fuse(vamvs_fusion::FuseError),
    /// Meshing.
    #[error(transparent)]
    Mesh(#[from] vamvs_mesh::MeshError),
    /// Refinement.
    #[error(transparent)]
    Refine(#[from] vamvs_refine::RefineError),
    /// The network.
    #[cfg(feature = "torch")]
    #[error(transparent)]
    Net(#[from] vamvs_net::NetError),
    /// vis-corr.
    #[error("{name}: {source}")]
    Corr {
        /// The network's name or file.
        name: String,
        /// What is wrong.
        source: vamvs_corr::CorrError,
    },
    /// The GPU.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] vamvs_gpu::GpuError),
    /// An error of one view.
    #[error("view {name}")]
    View {
        /// The image's name.
        name: String,
        /// What is wrong with it.
        source: Box<VamvsError>,
    },
    /// A folder or file is not as expected.
    #[error("{}: {problem}", path.display())]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// A [`PhotoSource`](crate::PhotoSource) gave no photograph.
    #[error("its photograph could not be loaded")]
    Photo(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The caller ended the work.
    #[error("the work was cancelled")]
    Cancelled,
    /// The request or the scene is invalid.
    #[error("{0}")]
    Request(String),
}

impl From<vamvs_fusion::FuseError> for VamvsError {
    fn from(error: vamvs_fusion::FuseError) -> Self {
        match error {
            vamvs_fusion::FuseError::Cancelled => Self::Cancelled,
            error => Self::Fuse(error),
        }
    }
}

impl From<vamvs_corr::CorrError> for VamvsError {
    fn from(error: vamvs_corr::CorrError) -> Self {
        Self::Request(error.to_string())
    }
}

impl VamvsError {
    /// Whether memory ran out in the network.
    #[must_use]
    pub fn is_out_of_memory(&self) -> bool {
        match self {
            Self::View { source, .. } => source.is_out_of_memory(),
            #[cfg(feature = "gpu")]
            Self::Gpu(error) => matches!(error, vamvs_gpu::GpuError::Memory { .. }),
            #[cfg(feature = "torch")]
            Self::Net(error) => {
                let causes =
                    std::iter::successors(Some(error as &dyn std::error::Error), |error| error.source());
                causes.map(|error| error.to_string().to_lowercase()).any(|text| {
                    // The messages of libtorch for a GPU, a CPU, and a CPU under Windows.
                    ["cuda out of memory", "can't allocate memory", "not enough memory"]
                        .iter()
                        .any(|words| text.contains(words))
                })
            }
            _ => false,
        }
    }

    /// Whether the run cannot go on as it is: memory ran out, or the caller cancelled.
    pub(crate) fn ends_run(&self) -> bool {
        self.ends_all() || self.is_out_of_memory()
    }

    /// Whether no view can be made any more: the caller cancelled, or the device on which they are made fails.
    pub(crate) fn ends_all(&self) -> bool {
        match self {
            Self::View { source, .. } => source.ends_all(),
            #[cfg(feature = "gpu")]
            Self::Gpu(vamvs_gpu::GpuError::Lost { .. } | vamvs_gpu::GpuError::Device { .. }) => true,
            Self::Refine(vamvs_refine::RefineError::Device(_)) => true,
            error => matches!(error, Self::Cancelled),
        }
    }

    /// The error and its causes in one line.
    #[must_use]
    pub fn with_causes(&self) -> String {
        let causes = std::iter::successors(Some(self as &dyn std::error::Error), |error| error.source());
        let mut texts: Vec<String> = causes.map(ToString::to_string).collect();
        texts.dedup();
        texts.join(": ")
    }

    /// The same error, with the name of the view.
    #[must_use]
    pub fn of_view(self, name: &str) -> Self {
        Self::View { name: name.to_owned(), source: Box::new(self) }
    }
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use super::*;

    #[test]
    fn a_lost_gpu_ends_the_run_and_one_without_memory_a_view() {
        let adapter = || "a GPU".to_owned();
        let lost = vamvs_gpu::GpuError::Lost { adapter: adapter(), reason: "reset".to_owned() };
        let lost = VamvsError::from(lost).of_view("a.png");
        assert!(lost.ends_all() && lost.ends_run() && !lost.is_out_of_memory());
        let full = vamvs_gpu::GpuError::Memory { adapter: adapter(), problem: "a map".to_owned() };
        let full = VamvsError::from(full).of_view("a.png");
        assert!(!full.ends_all() && full.is_out_of_memory());
    }
}
