//! What can go wrong between a scene and its cloud.

use std::path::PathBuf;

/// An error of the pipeline.
#[derive(Debug, thiserror::Error)]
pub enum VamvsError {
    /// A file.
    #[error(transparent)]
    Io(#[from] vamvs_io::IoError),
    /// Fusion.
    #[error(transparent)]
    Fuse(#[from] vamvs_fusion::FuseError),
    /// Refinement.
    #[error(transparent)]
    Refine(#[from] vamvs_refine::RefineError),
    /// The network.
    #[cfg(feature = "net")]
    #[error(transparent)]
    Net(#[from] vamvs_net::NetError),
    /// A view.
    #[error("view {name}")]
    View {
        /// The image's name.
        name: String,
        /// What is wrong with it.
        source: Box<VamvsError>,
    },
    /// A folder that should be an output folder is none.
    #[error("{}: {problem}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is missing, and what to do.
        problem: String,
    },
    /// The request or the scene makes no sense.
    #[error("{0}")]
    Request(String),
}

impl VamvsError {
    /// Whether it is the memory that did not suffice.
    #[must_use]
    pub fn is_out_of_memory(&self) -> bool {
        let causes = std::iter::successors(Some(self as &dyn std::error::Error), |error| error.source());
        causes.map(|error| error.to_string().to_lowercase()).any(|text| {
            // As libtorch says it of a GPU, of a processor, and of a processor under Windows.
            ["cuda out of memory", "can't allocate memory", "not enough memory"]
                .iter()
                .any(|w| text.contains(w))
        })
    }

    /// The error and its causes in one line.
    #[must_use]
    pub fn in_full(&self) -> String {
        let causes = std::iter::successors(Some(self as &dyn std::error::Error), |error| error.source());
        let mut texts: Vec<String> = causes.map(ToString::to_string).collect();
        texts.dedup();
        texts.join(": ")
    }

    /// The same error, told of a view.
    #[must_use]
    pub fn of_view(self, name: &str) -> Self {
        Self::View { name: name.to_owned(), source: Box::new(self) }
    }
}
