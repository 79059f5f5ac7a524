//! Both passes, one after the other in one process.

use std::ops::ControlFlow;

use vamvs_core::{Cloud, Part, Roi};

use crate::event::{OnFuseEvent, Sink};
use crate::{
    Collector, Counts, FuseError, FuseOptions, FuseReport, FusedPoints, MapSource, Schedule, confirm, merge,
};

/// What is fused and how.
#[derive(Debug)]
pub struct FuseJob<'a, S: ?Sized> {
    /// The depth maps.
    pub source: &'a S,
    /// For each view, the source views that it is checked against.
    pub neighbours: &'a [Vec<usize>],
    /// The thresholds.
    pub options: &'a FuseOptions,
    /// Where points are wanted; `None` for everywhere.
    pub roi: Option<Roi>,
    /// Limit of memory, bytes: for loaded depth maps (4 bytes a pixel in the first pass, 12 in the
    /// second), for loading them, and for one bit for each pixel of all views. A view and its
    /// neighbours are held together even if that takes more; see [`FuseReport::memory`].
    pub memory: usize,
}

/// Fuses depth maps; the points go to `sink` view by view, those of a view in the order of its pixels and in
/// one or more batches. The order of the views follows from the neighbours alone.
///
/// The same as [`confirm`] for all views, then [`merge`] for all views into a [`Collector`].
///
/// # Errors
/// If an option or a neighbour is invalid, a view cannot be loaded, its rasters differ in size,
/// `sink` fails, or `on_event` breaks.
pub fn fuse<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    sink: &mut Sink<'_>,
    on_event: &mut OnFuseEvent<'_>,
) -> Result<FuseReport, FuseError> {
    let schedule = Schedule::new(job.neighbours, job.source.len())?;
    let (pixels, confirming) = confirm(job, &schedule, Part::WHOLE, on_event)?;
    let counts: Vec<Counts> = pixels.values().map(|pixels| pixels.counts).collect();
    let mut collector = Collector::new(&counts, job.options, sink, on_event);
    let mut take = |batch| collector.take(batch);
    let merging = merge(job, &schedule, Part::WHOLE, (&pixels, &counts), &mut take)?;
    Ok(FuseReport { views: collector.finish(), memory: confirming.max(merging) })
}

/// Fuses depth maps into a cloud in memory.
///
/// # Errors
/// As [`fuse`].
pub fn fuse_to_cloud<S: MapSource + ?Sized>(job: &FuseJob<'_, S>) -> Result<(Cloud, FuseReport), FuseError> {
    let mut cloud = Cloud::new();
    let mut sink = |fused: &FusedPoints| {
        cloud.extend_from_slice(fused.points());
        Ok(())
    };
    let report = fuse(job, &mut sink, &mut |_| ControlFlow::Continue(()))?;
    Ok((cloud, report))
}
