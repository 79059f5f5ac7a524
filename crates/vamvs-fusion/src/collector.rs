//! From the points of single views to the cloud: thinned, counted, and handed on.

use serde::{Deserialize, Serialize};

use crate::event::{FuseEvent, OnFuseEvent, Sink, tell};
use crate::spacing::Thinner;
use crate::{Counts, FuseError, FuseOptions, FusedPoints, ViewReport};

/// Points of one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Batch {
    /// The view that made them.
    pub view: usize,
    /// The points.
    pub points: FusedPoints,
    /// Whether the view makes no more points.
    pub is_last: bool,
}

/// Takes the points of all views in the order of the second pass.
pub struct Collector<'a, 's> {
    sink: &'a mut Sink<'s>,
    on_event: &'a mut OnFuseEvent<'s>,
    thinner: Option<Thinner>,
    views: Vec<ViewReport>,
}

impl<'a, 's> Collector<'a, 's> {
    /// `counts` are those of all views; points go to `sink`.
    pub fn new(
        counts: &[Counts],
        options: &FuseOptions,
        sink: &'a mut Sink<'s>,
        on_event: &'a mut OnFuseEvent<'s>,
    ) -> Self {
        let unit = typical_footprint(counts);
        let thinner = options.point_spacing.map(|spacing| Thinner::new(spacing, unit));
        // A consistent pixel that makes no point counts as merged.
        let report = |counts: &Counts| ViewReport { merged: counts.consistent, ..counts.report };
        Self { sink, on_event, thinner, views: counts.iter().map(report).collect() }
    }

    /// Takes points.
    ///
    /// # Errors
    /// If the sink does not take them, or the caller ends the fusion.
    pub fn take(&mut self, batch: Batch) -> Result<(), FuseError> {
        let Batch { view, points, is_last } = batch;
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
        let points = report.points;
        if is_last { tell(self.on_event, FuseEvent::Merged { view, points }) } else { Ok(()) }
    }

    /// What became of the pixels of each view, when all points are taken.
    #[must_use]
    pub fn finish(self) -> Vec<ViewReport> {
        self.views
    }
}

/// The mean footprint (size on the surface) of all consistent pixels, scene units.
pub(crate) fn typical_footprint(counts: &[Counts]) -> f64 {
    let count: u64 = counts.iter().map(|view| view.consistent).sum();
    let sum: f64 = counts.iter().map(|view| view.footprints).sum();
    if count == 0 { 1.0 } else { sum / count as f64 }
}
