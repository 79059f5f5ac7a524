//! The two passes over the views.

use std::sync::Arc;

use vamvs_core::{Cloud, Roi};

use crate::cache::ViewCache;
use crate::geometric::{Kept, Pair, keep};
use crate::merge::{Merger, Other};
use crate::order::by_neighbourhood;
use crate::photometric::FilteredView;
use crate::priority::Ranking;
use crate::{BoxError, FuseError, FuseOptions, FuseReport, FusedPoints, MapSource, ViewReport};

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
    /// Memory to work in, bytes: for depth maps at 11 a pixel, for what it takes to load them, and for one
    /// bit of each pixel of all views. A view and its neighbours are held together even if that takes more;
    /// [`FuseReport::memory`] tells.
    pub memory: usize,
}

/// Where points go.
type Sink<'a> = dyn FnMut(&FusedPoints) -> Result<(), BoxError> + 'a;

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

/// Fuses depth maps; the points go to `sink` view by view, those of a view in the order of its pixels and in
/// one or more batches. The order of the views follows from the neighbours alone.
///
/// # Errors
/// If an option or a neighbour makes no sense, a view cannot be loaded or does not fit together, or
/// `sink` fails.
pub fn fuse<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    sink: &mut Sink<'_>,
    on_event: &mut dyn FnMut(FuseEvent),
) -> Result<FuseReport, FuseError> {
    job.options.validate()?;
    let neighbours = checked_neighbours(job.neighbours, job.source.len())?;
    let mutual = mutual(&neighbours);
    let order = by_neighbourhood(&mutual);
    let mut cache = ViewCache::new(job.source, job.options, job.memory);
    let kept = filter_views(job, (&neighbours, &order), &mut cache, on_event)?;
    let mut merging = Merging { job, kept: &kept, unit: typical_footprint(&kept), cache: &mut cache };
    let mut views: Vec<_> = kept.iter().map(|kept| kept.report).collect();
    for &view in order.iter().rev() {
        let points = merging.merge(view, &mutual[view], sink)?;
        on_event(FuseEvent::Merged { view, points });
        views[view] = finished_report(&kept[view], points);
    }
    Ok(FuseReport { views, memory: cache.most_bytes() as u64 })
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
    let report = fuse(job, &mut sink, &mut |_| ())?;
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

/// The first pass, over the views in the order given.
fn filter_views<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    (neighbours, order): (&[Vec<usize>], &[usize]),
    cache: &mut ViewCache<'_, S>,
    on_event: &mut dyn FnMut(FuseEvent),
) -> Result<Vec<Kept>, FuseError> {
    let mut all: Vec<Kept> = neighbours.iter().map(|_| Kept::default()).collect();
    for &view in order {
        let (reference, pairs) = load_pairs(cache, view, &neighbours[view], job.options)?;
        let kept = keep(&reference, &pairs, job.options.min_views, job.roi.as_ref());
        on_event(FuseEvent::Filtered { view, kept: kept.count });
        cache.set_aside(kept.bits.bytes());
        all[view] = kept;
    }
    Ok(all)
}

fn load_pairs<S: MapSource + ?Sized>(
    cache: &mut ViewCache<'_, S>,
    view: usize,
    sources: &[usize],
    options: &FuseOptions,
) -> Result<(Arc<FilteredView>, Vec<Pair>), FuseError> {
    let wanted: Vec<usize> = std::iter::once(view).chain(sources.iter().copied()).collect();
    let mut loaded = cache.get(&wanted)?;
    let reference = loaded.remove(0);
    let pair = |(&number, source)| Pair::new(&reference, number, source, options);
    let pairs = sources.iter().zip(loaded).map(pair).collect();
    Ok((reference, pairs))
}

/// The second pass.
struct Merging<'a, 'c, S: ?Sized> {
    job: &'a FuseJob<'a, S>,
    kept: &'a [Kept],
    unit: f64,
    cache: &'a mut ViewCache<'c, S>,
}

impl<S: MapSource + ?Sized> Merging<'_, '_, S> {
    /// Gives the points that a view makes to `sink`, and tells their number.
    fn merge(&mut self, view: usize, others: &[usize], sink: &mut Sink<'_>) -> Result<u64, FuseError> {
        if self.kept[view].count == 0 {
            return Ok(0);
        }
        let (reference, pairs) = load_pairs(self.cache, view, others, self.job.options)?;
        let other = |pair: Pair| Other {
            ranking: Ranking::new(pair.source_view, &pair.source, self.unit),
            kept: &self.kept[pair.source_view].bits,
            pair,
        };
        let merger = Merger {
            view,
            reference: &reference,
            ranking: Ranking::new(view, &reference, self.unit),
            kept: &self.kept[view].bits,
            others: pairs.into_iter().map(other).collect(),
        };
        let mut count = 0;
        for rows in merger.batches() {
            let fused = merger.points(rows);
            count += fused.points().len() as u64;
            sink(&fused).map_err(FuseError::Sink)?;
        }
        Ok(count)
    }
}

/// The mean size on the surface of all kept pixels, scene units.
fn typical_footprint(kept: &[Kept]) -> f64 {
    let count: u64 = kept.iter().map(|view| view.count).sum();
    let sum: f64 = kept.iter().map(|view| view.footprints).sum();
    if count == 0 { 1.0 } else { sum / count as f64 }
}

fn finished_report(kept: &Kept, points: u64) -> ViewReport {
    ViewReport { merged: kept.count - points, points, ..kept.report }
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
