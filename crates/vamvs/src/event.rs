//! What the pipeline tells while it works.

use std::ops::ControlFlow;
use std::time::Duration;

use crate::VamvsError;
use crate::output::LeftOut;

/// What was done for a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// A depth map of the photographs alone, which is refined once more.
    Photometric,
    /// The view's depth map.
    Final,
}

/// Progress of the pipeline; front ends draw it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// Something a user should know, one sentence.
    Warning(String),
    /// A depth map is there, after a pass of two or of one.
    DepthMap {
        /// The view's name.
        name: String,
        /// What was done for it.
        pass: Pass,
        /// How many are done, this one included.
        done: usize,
        /// How many there will be.
        total: usize,
        /// Whether it was there already, made with the same settings.
        resumed: bool,
        /// Time since the one before.
        time: Duration,
    },
    /// Fusion went over a view: all views once to filter, then once to merge.
    Fusion {
        /// How many view passes are done.
        done: usize,
        /// How many there will be.
        total: usize,
    },
    /// A view is drawn for the report.
    Report {
        /// How many views are done.
        done: usize,
        /// How many there will be.
        total: usize,
    },
    /// A view is exported.
    Export {
        /// How many views are done.
        done: usize,
        /// How many there will be.
        total: usize,
    },
}

/// Takes the progress of some work and says whether it goes on: `ControlFlow::Break(())` ends it with
/// [`VamvsError::Cancelled`].
pub type OnEvent<'a> = dyn FnMut(Event) -> ControlFlow<()> + 'a;

/// Tells an event.
pub(crate) fn tell(on_event: &mut OnEvent<'_>, event: Event) -> Result<(), VamvsError> {
    match on_event(event) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(VamvsError::Cancelled),
    }
}

impl Event {
    /// The warning that a view is left out.
    pub(crate) fn left_out(LeftOut { view, reason }: &LeftOut) -> Self {
        Self::Warning(format!("{view} is left out: {reason}"))
    }
}
