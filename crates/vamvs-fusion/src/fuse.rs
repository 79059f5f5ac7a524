//! The two passes over the views.

use std::sync::Arc;

use vamvs_core::{Cloud, Roi};

use crate::cache::ViewCache;
use crate::geometric::{Kept, Pair, keep};
use crate::merge::{Merger, Other};
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
    /// Bytes of depth maps to keep in memory, 11 a pixel. A view and its neighbours are held together
    /// even if that takes more.
    pub cache_bytes: usize,
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

/// Fuses depth maps; the points go to `sink` view by view, in the order of the views and their pixels.
///
/// # Errors
/// If an option or a neighbour makes no sense, a view cannot be loaded or does not fit together, or
/// `sink` fails.
pub fn fuse<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    sink: &mut dyn FnMut(&FusedPoints) -> Result<(), BoxError>,
    on_event: &mut dyn FnMut(FuseEvent),
) -> Result<FuseReport, FuseError> {
    job.options.validate()?;
    let neighbours = checked_neighbours(job.neighbours, job.source.len())?;
    let mut cache = ViewCache::new(job.source, job.options, job.cache_bytes);
    let kept = filter_views(job, &neighbours, &mut cache, on_event)?;
    let mut merging = Merging { job, kept: &kept, unit: typical_footprint(&kept), cache: &mut cache };
    let mut views = Vec::with_capacity(kept.len());
    for (view, others) in mutual(&neighbours).iter().enumerate() {
        let fused = merging.points(view, others)?;
        sink(&fused).map_err(FuseError::Sink)?;
        let points = fused.points().len() as u64;
        on_event(FuseEvent::Merged { view, points });
        views.push(finished_report(&kept[view], points));
    }
    Ok(FuseReport { views })
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

/// The first pass.
fn filter_views<S: MapSource + ?Sized>(
    job: &FuseJob<'_, S>,
    neighbours: &[Vec<usize>],
    cache: &mut ViewCache<'_, S>,
    on_event: &mut dyn FnMut(FuseEvent),
) -> Result<Vec<Kept>, FuseError> {
    let mut all = Vec::with_capacity(neighbours.len());
    for (view, sources) in neighbours.iter().enumerate() {
        let (reference, pairs) = load_pairs(cache, view, sources, job.options)?;
        let kept = keep(&reference, &pairs, job.options.min_views, job.roi.as_ref());
        on_event(FuseEvent::Filtered { view, kept: kept.count });
        all.push(kept);
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
    fn points(&mut self, view: usize, others: &[usize]) -> Result<FusedPoints, FuseError> {
        if self.kept[view].count == 0 {
            return Ok(FusedPoints::default());
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
        Ok(merger.points())
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
