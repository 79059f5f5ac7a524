//! Progress events of the pipeline.

use std::ops::ControlFlow;
use std::time::Duration;

use crate::VamvsError;
use crate::output::LeftOut;

/// A pass over the views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Pass {
    /// From the photographs alone; a geometric pass follows.
    Photometric,
    /// The last pass, which makes the view's final depth map.
    Final,
}

/// Progress of the pipeline; front ends draw it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// Something a user should know, one sentence.
    Warning(String),
    /// A pass has finished the depth map of a view.
    DepthMap {
        /// The view's name.
        name: String,
        /// The pass.
        pass: Pass,
        /// How many are done, this one included.
        done: usize,
        /// How many there will be.
        total: usize,
        /// Whether it existed already, made with the same settings.
        resumed: bool,
        /// Time that it took.
        time: Duration,
    },
    /// A view's draft is made, from which the depth ranges of captures without sparse points follow.
    Draft {
        /// How many are done.
        done: usize,
        /// How many there will be.
        total: usize,
    },
    /// Fusion has processed a view: first each view is filtered, then each is merged.
    Fusion {
        /// How many view passes are done.
        done: usize,
        /// How many there will be.
        total: usize,
    },
    /// Meshing has filtered or taken in a view, or is done.
    Mesh {
        /// How many steps are done.
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

/// Receives progress events and says whether the work goes on: `ControlFlow::Break(())` ends it
/// with [`VamvsError::Cancelled`].
pub type OnEvent<'a> = dyn FnMut(Event) -> ControlFlow<()> + 'a;

/// Sends an event; an error if the caller cancels.
pub(crate) fn tell(on_event: &mut OnEvent<'_>, event: Event) -> Result<(), VamvsError> {
    match on_event(event) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(VamvsError::Cancelled),
    }
}

/// Tells warnings, if there are any.
pub(crate) fn warn(
    on_event: &mut OnEvent<'_>,
    warnings: impl IntoIterator<Item = String>,
) -> Result<(), VamvsError> {
    warnings.into_iter().try_for_each(|warning| tell(on_event, Event::Warning(warning)))
}

impl Event {
    /// The warning that a view is left out.
    pub(crate) fn left_out(LeftOut { view, reason }: &LeftOut) -> Self {
        Self::Warning(format!("{view} is left out: {reason}"))
    }
}
