//! What a fusion tells while it works, and where its points go.

use std::ops::ControlFlow;

use crate::{BoxError, FuseError, FusedPoints};

/// Where points go.
pub(crate) type Sink<'a> = dyn FnMut(&FusedPoints) -> Result<(), BoxError> + 'a;

/// Takes how far a fusion is and says whether it goes on: `ControlFlow::Break(())` ends it with
/// [`FuseError::Cancelled`].
pub type OnFuseEvent<'a> = dyn FnMut(FuseEvent) -> ControlFlow<()> + 'a;

/// Tells how far a fusion is.
pub(crate) fn tell(on_event: &mut OnFuseEvent<'_>, event: FuseEvent) -> Result<(), FuseError> {
    match on_event(event) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(FuseError::Cancelled),
    }
}

/// How far a fusion is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FuseEvent {
    /// The first pass is through with a view.
    Filtered {
        /// The view.
        view: usize,
        /// Pixels that passed all filters.
        kept: u64,
    },
    /// The second pass is through with a view; its points are with the sink.
    Merged {
        /// The view.
        view: usize,
        /// Points that it made.
        points: u64,
    },
}
