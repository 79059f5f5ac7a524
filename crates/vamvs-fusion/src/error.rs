//! Why a fusion stopped.

use vamvs_core::Size;

use crate::OptionsError;

/// An error of the caller: of its source of depth maps or its sink of points.
pub type BoxError = Box<dyn std::error::Error + Send + Sync>;

/// Why a fusion stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FuseError {
    /// A threshold outside of its range.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The lists of source views do not fit the views.
    #[error("expected one list of source views for each of the {expected} views, got {found} lists")]
    NeighbourLists {
        /// Number of views.
        expected: usize,
        /// Number of lists.
        found: usize,
    },
    /// A source view that does not exist.
    #[error("view {view} names {neighbour} as a source view, but there are only views 0 to {}", .len - 1)]
    Neighbour {
        /// The reference view.
        view: usize,
        /// The source view it names.
        neighbour: usize,
        /// Number of views.
        len: usize,
    },
    /// A depth map could not be loaded.
    #[error("view {view} could not be loaded")]
    Load {
        /// The view.
        view: usize,
        /// What the source said.
        source: BoxError,
    },
    /// A part of a view differs in size from its depth map.
    #[error("view {view}: expected {what} of {expected} pixels like the depth map, got {found}")]
    Size {
        /// The view.
        view: usize,
        /// Camera, confidence, coarse confidence, colour, normals or mask.
        what: &'static str,
        /// The depth map's size.
        expected: Size,
        /// The part's size.
        found: Size,
    },
    /// The caller ended the fusion.
    #[error("the fusion was cancelled")]
    Cancelled,
    /// The sink failed.
    #[error("the fused points could not be written")]
    Sink(#[source] BoxError),
}

impl FuseError {
    /// The error of a view that cannot be loaded, made of the reason.
    pub(crate) fn loading<E: Into<BoxError>>(view: usize) -> impl Fn(E) -> Self {
        move |error| Self::Load { view, source: error.into() }
    }
}
