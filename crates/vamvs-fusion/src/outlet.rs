//! Where points go: to the sink, in the order in which they are made.

use crate::event::{FuseEvent, OnFuseEvent, Sink, tell};
use crate::spacing::Thinner;
use crate::{FuseError, FusedPoints, ViewReport};

/// Hands points to the sink one batch after the other; while it takes one, the next is made.
pub(crate) struct Outlet<'a, 's> {
    sink: &'a mut Sink<'s>,
    on_event: &'a mut OnFuseEvent<'s>,
    thinner: Option<Thinner>,
    views: Vec<ViewReport>,
    pending: Option<Batch>,
}

/// Points of one view.
pub(crate) struct Batch {
    pub view: usize,
    pub points: FusedPoints,
    /// Whether the view makes no more points.
    pub is_last: bool,
}

impl<'a, 's> Outlet<'a, 's> {
    /// `kept` tells for each view what was removed so far and how many pixels are kept.
    pub fn new(
        sink: &'a mut Sink<'s>,
        on_event: &'a mut OnFuseEvent<'s>,
        thinner: Option<Thinner>,
        kept: impl Iterator<Item = (ViewReport, u64)>,
    ) -> Self {
        // What is kept and makes no point is merged.
        let views = kept.map(|(report, kept)| ViewReport { merged: kept, ..report }).collect();
        Self { sink, on_event, thinner, views, pending: None }
    }

    /// Takes a batch, to be handed on by the next [`Outlet::flush`].
    pub fn take(&mut self, batch: Batch) {
        self.pending = Some(batch);
    }

    /// Hands on what was taken.
    pub fn flush(&mut self) -> Result<(), FuseError> {
        let Some(Batch { view, points, is_last }) = self.pending.take() else { return Ok(()) };
        let points = match &mut self.thinner {
            Some(thinner) => thinner.thinned(&points),
            None => points,
        };
        let count = points.points().len() as u64;
        if count > 0 {
            (self.sink)(&points).map_err(FuseError::Sink)?;
        }
        let report = &mut self.views[view];
        report.merged -= count;
        report.points += count;
        if is_last {
            tell(self.on_event, FuseEvent::Merged { view, points: report.points })?;
        }
        Ok(())
    }

    /// What became of the pixels of each view, when all batches are with the sink.
    pub fn finish(mut self) -> Result<Vec<ViewReport>, FuseError> {
        self.flush()?;
        Ok(self.views)
    }
}
