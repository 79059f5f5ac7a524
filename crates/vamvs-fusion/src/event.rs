//! Progress events of a fusion, and where its points go.

use std::ops::ControlFlow;

use crate::{BoxError, FuseError, FusedPoints};

/// Where points go.
pub(crate) type Sink<'a> = dyn FnMut(&FusedPoints) -> Result<(), BoxError> + 'a;

/// Receives progress events and says whether the fusion goes on: `ControlFlow::Break(())` ends it
/// with [`FuseError::Cancelled`].
pub type OnFuseEvent<'a> = dyn FnMut(FuseEvent) -> ControlFlow<()> + 'a;

/// Sends an event; an error if the caller cancels.
pub(crate) fn tell(on_event: &mut OnFuseEvent<'_>, event: FuseEvent) -> Result<(), FuseError> {
    match on_event(event) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(FuseError::Cancelled),
    }
}

/// Progress of a fusion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FuseEvent {
    /// The first pass has finished a view.
    Filtered {
        /// The view.
        view: usize,
        /// Pixels that passed all filters.
        kept: u64,
    },
    /// The second pass has finished a view; the sink has its points.
    Merged {
        /// The view.
        view: usize,
        /// Points that it made.
        points: u64,
    },
}
