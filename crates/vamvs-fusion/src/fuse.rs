//! The two passes over the views.

use std::ops::ControlFlow;
use std::sync::Arc;

use vamvs_core::{Cloud, Roi};

use crate::appearance::SeenView;
use crate::cache::ViewCache;
use crate::event::{FuseEvent, OnFuseEvent, Sink, tell};
use crate::geometric::{ConsistentPixels, keep};
use crate::merge::{Merger, RivalView};
use crate::order::by_neighbourhood;
use crate::outlet::{Batch, Outlet};
use crate::pair::Pair;
use crate::photometric::FilteredView;
use crate::priority::Ranking;
use crate::spacing::Thinner;
use crate::{FuseError, FuseOptions, FuseReport, FusedPoints, MapSource};

/// What is fused and how.
#[derive(Debug)]
pub struct FuseJob<'a, S: ?Sized> {
    /// The depth maps.
    pub source: &'a S,
    /// For each view, the views that are asked whether they agree.
    pub neighbours: &'a [Vec<usize>],
    /// The thresholds.
    pub options: &'a FuseOptions,
    /// Where points are wanted; `None` for everywhere.
    pub roi: Option<Roi>,
    /// Memory to work in, bytes: for depth maps at 8 and then 15 a pixel, for what it takes to load them, and for one
    /// bit of each pixel of all views. A view and its neighbours are held together even if that takes more;
    /// [`FuseReport::memory`] tells.
    pub memory: usize,
}

/// Fuses depth maps; the points go to `sink` view by view, those of a view in the order of its pixels and in
/// one or more batches. The order of the views follows from the neighbours alone.
///
/// # Errors
/// If an option or a neighbour makes no sense, a view cannot be loaded or does not fit together, or
/// `sink` fails, or `on_event` breaks.
pub fn fuse<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    sink: &mut Sink<'_>,
    on_event: &mut OnFuseEvent<'_>,
) -> Result<FuseReport, FuseError> {
    job.options.validate()?;
    let neighbours = checked_neighbours(job.neighbours, job.source.len())?;
    let mutual = mutual(&neighbours);
    let order = by_neighbourhood(&mutual);
    let (kept, filtering) = filter_views(job, (&neighbours, &order), on_event)?;
    let unit = typical_footprint(&kept);
    let thinner = job.options.point_spacing.map(|spacing| Thinner::new(spacing, unit));
    let reports = kept.iter().map(|kept| (kept.report, kept.count));
    let mut outlet = Outlet::new(sink, on_event, thinner, reports);
    let merging = Merging { job, kept: &kept, unit, neighbours: &mutual };
    let merging = merging.merge_all(&order, &mut outlet)?;
    let views = outlet.finish()?;
    Ok(FuseReport { views, memory: filtering.max(merging) as u64 })
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

/// The neighbour lists in ascending order, each view once and none its own neighbour.
fn checked_neighbours(lists: &[Vec<usize>], len: usize) -> Result<Vec<Vec<usize>>, FuseError> {
    if lists.len() != len {
        return Err(FuseError::NeighbourLists { expected: len, found: lists.len() });
    }
    let checked = |(view, list): (usize, &Vec<usize>)| {
        if let Some(&neighbour) = list.iter().find(|&&neighbour| neighbour >= len) {
            return Err(FuseError::Neighbour { view, neighbour, len });
        }
        Ok(ascending(list.iter().copied().filter(|&neighbour| neighbour != view).collect()))
    };
    lists.iter().enumerate().map(checked).collect()
}

/// For each view, its neighbours and those that name it as theirs: a point is merged only if both
/// views know of each other.
fn mutual(neighbours: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut mutual = neighbours.to_vec();
    for (view, list) in neighbours.iter().enumerate() {
        list.iter().for_each(|&neighbour| mutual[neighbour].push(view));
    }
    mutual.into_iter().map(ascending).collect()
}

fn ascending(mut views: Vec<usize>) -> Vec<usize> {
    views.sort_unstable();
    views.dedup();
    views
}

/// The first pass, over the views in the order given; also the most bytes that it took.
fn filter_views<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    (neighbours, order): (&[Vec<usize>], &[usize]),
    on_event: &mut OnFuseEvent<'_>,
) -> Result<(Vec<ConsistentPixels>, usize), FuseError> {
    let mut cache = ViewCache::new(job.memory, |view| job.filtered(view));
    let mut all: Vec<ConsistentPixels> = neighbours.iter().map(|_| ConsistentPixels::default()).collect();
    let wanted = |&view: &usize| with_neighbours(view, &neighbours[view]);
    for (step, &view) in order.iter().enumerate() {
        let next = order.get(step + 1).map(wanted).unwrap_or_default();
        let kept = cache.with(&wanted(&view), &next, |views| {
            let (reference, sources) = (&views[0], &views[1..]);
            let numbered = neighbours[view].iter().zip(sources);
            let pairs = numbered.map(|(&number, source)| Pair::new(reference, number, source, job.options));
            keep(reference, &pairs.collect::<Vec<_>>(), job.options, job.roi.as_ref())
        })?;
        tell(on_event, FuseEvent::Filtered { view, kept: kept.count })?;
        cache.set_aside(kept.bits.bytes());
        all[view] = kept;
    }
    Ok((all, cache.most_bytes()))
}

fn with_neighbours(view: usize, neighbours: &[usize]) -> Vec<usize> {
    std::iter::once(view).chain(neighbours.iter().copied()).collect()
}

impl<S: MapSource + ?Sized> FuseJob<'_, S> {
    /// A view as the first pass needs it.
    fn filtered(&self, view: usize) -> Result<FilteredView, FuseError> {
        let failed = |error: S::Error| FuseError::Load { view, source: error.into() };
        FilteredView::new(view, self.source.load_map(view).map_err(failed)?, self.options)
    }

    /// A view as the second pass needs it.
    fn seen(&self, view: usize) -> Result<SeenView, FuseError> {
        let failed = |error: S::Error| FuseError::Load { view, source: error.into() };
        SeenView::new(view, self.source.load(view).map_err(failed)?, self.options)
    }
}

/// The second pass.
struct Merging<'a, S: ?Sized> {
    job: &'a FuseJob<'a, S>,
    kept: &'a [ConsistentPixels],
    /// The typical size of a pixel on the surface, scene units.
    unit: f64,
    /// For each view, those that may see the same places.
    neighbours: &'a [Vec<usize>],
}

impl<S: MapSource + ?Sized> Merging<'_, S> {
    /// Merges all views, the last of `order` first; gives the most bytes that it took.
    fn merge_all(&self, order: &[usize], outlet: &mut Outlet<'_, '_>) -> Result<usize, FuseError> {
        let mut cache = ViewCache::new(self.job.memory, |view| self.job.seen(view));
        cache.set_aside(self.kept.iter().map(|kept| kept.bits.bytes()).sum());
        let wanted = |&view: &usize| with_neighbours(view, &self.neighbours[view]);
        let makes_points = |view: &&usize| self.kept[**view].count > 0;
        let mut ahead = order.iter().rev().filter(makes_points).skip(1);
        for &view in order.iter().rev() {
            if self.kept[view].count > 0 {
                let next = ahead.next().map(wanted).unwrap_or_default();
                cache.with(&wanted(&view), &next, |views| self.merge(view, views, outlet))??;
            } else {
                outlet.flush()?;
                outlet.take(Batch { view, points: FusedPoints::default(), is_last: true });
            }
        }
        Ok(cache.most_bytes())
    }

    /// Makes the points of a view, the first of `views`, while those made before go to the sink.
    fn merge(
        &self,
        view: usize,
        views: &[Arc<SeenView>],
        outlet: &mut Outlet<'_, '_>,
    ) -> Result<(), FuseError> {
        let merger = self.merger(view, views);
        let last = merger.batches().last();
        for rows in merger.batches() {
            let (is_last, mut points) = (Some(&rows) == last.as_ref(), FusedPoints::default());
            rayon::in_place_scope(|scope| {
                scope.spawn(|_| points = merger.points(rows));
                outlet.flush()
            })?;
            outlet.take(Batch { view, points, is_last });
        }
        Ok(())
    }

    fn merger<'b>(&'b self, view: usize, views: &'b [Arc<SeenView>]) -> Merger<'b> {
        let ranking = |view: usize, seen: &SeenView| Ranking::new(view, &seen.filtered, self.unit);
        let reference = &views[0];
        let other = |(&number, seen): (&usize, &'b Arc<SeenView>)| RivalView {
            ranking: ranking(number, seen),
            kept: &self.kept[number].bits,
            pair: Pair::new(&reference.filtered, number, &seen.filtered, self.job.options),
            seen,
        };
        Merger {
            view,
            reference,
            ranking: ranking(view, reference),
            kept: &self.kept[view].bits,
            max_relative_depth: self.job.options.max_relative_depth,
            others: self.neighbours[view].iter().zip(&views[1..]).map(other).collect(),
        }
    }
}

/// The mean size on the surface of all kept pixels, scene units.
fn typical_footprint(kept: &[ConsistentPixels]) -> f64 {
    let count: u64 = kept.iter().map(|view| view.count).sum();
    let sum: f64 = kept.iter().map(|view| view.footprints).sum();
    if count == 0 { 1.0 } else { sum / count as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_become_mutual_and_sorted() {
        let lists = [vec![2, 1, 2], vec![1], vec![]];
        let checked = checked_neighbours(&lists, 3).unwrap();
        assert_eq!(checked, [vec![1, 2], vec![], vec![]]);
        assert_eq!(mutual(&checked), [vec![1, 2], vec![0], vec![0]]);
    }

    #[test]
    fn neighbours_that_are_none_are_named() {
        let error = checked_neighbours(&[vec![1], vec![2]], 2).unwrap_err();
        assert_eq!(error.to_string(), "view 1 names 2 as a source view, but there are only views 0 to 1");
        assert!(checked_neighbours(&[vec![]], 2).is_err());
    }
}
