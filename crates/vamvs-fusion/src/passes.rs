//! The two passes over the views, over all or a part of them.

use std::collections::BTreeMap;
use std::sync::Arc;

use vamvs_core::Part;

use crate::appearance::SeenView;
use crate::cache::ViewCache;
use crate::collector::typical_footprint;
use crate::event::{FuseEvent, OnFuseEvent, tell};
use crate::geometric::{RoiTest, keep};
use crate::merge::{Merger, RivalView};
use crate::outlet::{Outlet, Pending, Take};
use crate::pair::Pair;
use crate::photometric::FilteredView;
use crate::priority::Ranking;
use crate::{ConsistentPixels, Counts, FuseError, FuseJob, MapSource, Schedule};

/// The consistent pixels of views, by the views' numbers.
pub type ConsistentViews = BTreeMap<usize, ConsistentPixels>;

/// The first pass over a part of the views: finds their consistent pixels. Also returns the peak of
/// its memory, bytes.
///
/// # Errors
/// If an option is invalid, a view cannot be loaded, its rasters differ in size, or `on_event`
/// breaks.
pub fn confirm<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    schedule: &Schedule,
    part: Part,
    on_event: &mut OnFuseEvent<'_>,
) -> Result<(ConsistentViews, u64), FuseError> {
    job.options.validate()?;
    let order = schedule.confirmed_in(part);
    let mut cache = ViewCache::new(job.memory, |view| FilteredView::load(view, job.source, job.options));
    let mut all = ConsistentViews::new();
    let wanted = |&view: &usize| with_neighbours(view, &schedule.sources[view]);
    for (step, &view) in order.iter().enumerate() {
        let next = order.get(step + 1).map(wanted).unwrap_or_default();
        let kept = cache.with(&wanted(&view), &next, |views| {
            let (reference, sources) = (&views[0], &views[1..]);
            let numbered = schedule.sources[view].iter().zip(sources);
            let pairs = numbered.map(|(&number, source)| Pair::new(reference, number, source, job.options));
            keep(reference, &pairs.collect::<Vec<_>>(), job.options, job.roi.as_ref())
        })?;
        tell(on_event, FuseEvent::Filtered { view, kept: kept.counts.consistent })?;
        cache.set_aside(kept.bits.bytes());
        all.insert(view, kept);
    }
    Ok((all, cache.most_bytes() as u64))
}

/// The second pass over a part of the views: turns their consistent pixels into points, which
/// `take` receives in the order that a [`crate::Collector`] needs. `pixels` must hold the views of
/// [`Schedule::needed_to_merge`], `counts` those of all views. Returns the peak of its memory,
/// bytes.
///
/// # Errors
/// If an option is invalid, a view cannot be loaded, its rasters differ in size, or `take` fails.
pub fn merge<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    schedule: &Schedule,
    part: Part,
    (pixels, counts): (&ConsistentViews, &[Counts]),
    take: &mut Take<'_>,
) -> Result<u64, FuseError> {
    job.options.validate()?;
    let merging = Merging { job, pixels, unit: typical_footprint(counts), neighbours: &schedule.mutual };
    let mut outlet = Outlet::new(take);
    let bytes = merging.merge_all(&schedule.merged_in(part), &mut outlet)?;
    outlet.flush()?;
    Ok(bytes as u64)
}

fn with_neighbours(view: usize, neighbours: &[usize]) -> Vec<usize> {
    std::iter::once(view).chain(neighbours.iter().copied()).collect()
}

/// The second pass.
struct Merging<'a, S: ?Sized> {
    job: &'a FuseJob<'a, S>,
    pixels: &'a ConsistentViews,
    /// The typical size of a pixel on the surface, scene units.
    unit: f64,
    /// For each view, those that may see the same places.
    neighbours: &'a [Vec<usize>],
}

impl<S: MapSource + ?Sized> Merging<'_, S> {
    /// Merges views in the given order; returns the peak of its memory, bytes.
    fn merge_all(&self, order: &[usize], outlet: &mut Outlet<'_, '_>) -> Result<usize, FuseError> {
        let mut cache =
            ViewCache::new(self.job.memory, |view| SeenView::load(view, self.job.source, self.job.options));
        cache.set_aside(self.pixels.values().map(|pixels| pixels.bits.bytes()).sum());
        let wanted = |&view: &usize| with_neighbours(view, &self.neighbours[view]);
        let makes_points = |view: &&usize| self.pixels[*view].counts.consistent > 0;
        let mut ahead = order.iter().filter(makes_points).skip(1);
        for &view in order {
            if makes_points(&&view) {
                let next = ahead.next().map(wanted).unwrap_or_default();
                cache.with(&wanted(&view), &next, |views| self.merge(view, views, outlet))??;
            } else {
                outlet.flush()?;
                outlet.hold(Pending { view, rows: Vec::new(), is_last: true });
            }
        }
        Ok(cache.most_bytes())
    }

    /// Makes the points of a view, the first of `views`, while the batch before is handed on.
    fn merge(
        &self,
        view: usize,
        views: &[Arc<SeenView>],
        outlet: &mut Outlet<'_, '_>,
    ) -> Result<(), FuseError> {
        let merger = self.merger(view, views);
        let last = merger.batches().last();
        for rows in merger.batches() {
            let (is_last, mut points) = (Some(&rows) == last.as_ref(), Vec::new());
            rayon::in_place_scope(|scope| {
                scope.spawn(|_| points = merger.points(rows));
                outlet.flush()
            })?;
            outlet.hold(Pending { view, rows: points, is_last });
        }
        Ok(())
    }

    fn merger<'b>(&'b self, view: usize, views: &'b [Arc<SeenView>]) -> Merger<'b> {
        let ranking = |view: usize, seen: &SeenView| Ranking::new(view, &seen.filtered, self.unit);
        let reference = &views[0];
        let other = |(&number, seen): (&usize, &'b Arc<SeenView>)| RivalView {
            ranking: ranking(number, seen),
            kept: &self.pixels[&number].bits,
            pair: Pair::new(&reference.filtered, number, &seen.filtered, self.job.options),
            seen,
        };
        Merger {
            view,
            reference,
            ranking: ranking(view, reference),
            kept: &self.pixels[&view].bits,
            max_relative_depth: self.job.options.max_relative_depth,
            max_sigma: self.job.options.max_sigma.map_or(f32::INFINITY, |sigma| sigma as f32),
            others: self.neighbours[view].iter().zip(&views[1..]).map(other).collect(),
            region: self.job.roi.as_ref().map(|roi| RoiTest::new(&reference.filtered, roi)),
        }
    }
}
