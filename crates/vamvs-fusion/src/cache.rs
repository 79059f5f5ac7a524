//! Views in memory: loaded as needed, the least recently used given up first.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

use crate::photometric::FilteredView;
use crate::{FuseError, FuseOptions, MapSource};

/// Bytes that loading a view takes for a while, as multiples of what the view takes afterwards: files, and
/// rasters that are not kept.
const LOADING: usize = 3;

/// Filtered views, at most `capacity` bytes of them, those being loaded included, unless those in use need
/// more.
pub(crate) struct ViewCache<'a, S: ?Sized> {
    source: &'a S,
    options: &'a FuseOptions,
    capacity: usize,
    held: BTreeMap<usize, Held>,
    clock: u64,
    /// Bytes of the largest view so far: what the next one is expected to take.
    largest: usize,
    /// Bytes that others took from the capacity.
    set_aside: usize,
    /// Most bytes held at a time, what is set aside and loaded included.
    most: usize,
}

struct Held {
    view: Arc<FilteredView>,
    last_use: u64,
}

impl<'a, S: MapSource + ?Sized> ViewCache<'a, S> {
    pub fn new(source: &'a S, options: &'a FuseOptions, capacity: usize) -> Self {
        Self { source, options, capacity, held: BTreeMap::new(), clock: 0, largest: 0, set_aside: 0, most: 0 }
    }

    /// Leaves so many bytes less to views.
    pub fn set_aside(&mut self, bytes: usize) {
        self.set_aside += bytes;
    }

    /// The most bytes that were held at a time, with those set aside.
    pub fn most_bytes(&self) -> usize {
        self.most
    }

    /// The views, in the order asked for; those that are not held are loaded in parallel.
    pub fn get(&mut self, views: &[usize]) -> Result<Vec<Arc<FilteredView>>, FuseError> {
        self.clock += 1;
        for view in views {
            self.held.entry(*view).and_modify(|held| held.last_use = self.clock);
        }
        let missing: Vec<usize> = views.iter().copied().filter(|v| !self.held.contains_key(v)).collect();
        self.make_room(missing.len() * self.largest + self.loading(missing.len()));
        for (view, loaded) in missing.iter().zip(self.load(&missing)?) {
            self.largest = self.largest.max(loaded.bytes());
            self.held.insert(*view, Held { view: loaded, last_use: self.clock });
        }
        self.most = self.most.max(self.bytes() + self.loading(missing.len()));
        let found = views.iter().map(|view| Arc::clone(&self.held[view].view)).collect();
        self.make_room(0);
        Ok(found)
    }

    /// Bytes held, with those set aside.
    fn bytes(&self) -> usize {
        self.set_aside + self.held.values().map(|held| held.view.bytes()).sum::<usize>()
    }

    /// Bytes that it takes for a while to load so many views.
    fn loading(&self, views: usize) -> usize {
        views.min(rayon::current_num_threads()) * LOADING * self.largest
    }

    fn load(&self, views: &[usize]) -> Result<Vec<Arc<FilteredView>>, FuseError> {
        let load = |&view: &usize| {
            let loaded = self.source.load(view).map_err(|e| FuseError::Load { view, source: e.into() })?;
            FilteredView::new(view, loaded, self.options).map(Arc::new)
        };
        let loaded: Vec<_> = views.par_iter().map(load).collect();
        loaded.into_iter().collect()
    }

    /// Gives up views until `needed` bytes are free, but none that was asked for just now.
    fn make_room(&mut self, needed: usize) {
        let mut bytes = self.bytes();
        while bytes + needed > self.capacity {
            let idle = self.held.iter().filter(|(_, held)| held.last_use < self.clock);
            let Some(oldest) = idle.min_by_key(|(_, held)| held.last_use).map(|(&view, _)| view) else {
                return;
            };
            bytes -= self.held.remove(&oldest).map_or(0, |held| held.view.bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FusionView;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use vamvs_core::{DepthMap, Grid, Intrinsics, Pinhole, Pose, Size};

    const SIZE: Size = Size::new(4, 4);
    const VIEW_BYTES: usize = 16 * 11;

    #[derive(Default)]
    struct Counting(AtomicUsize);

    impl MapSource for Counting {
        type Error = String;

        fn len(&self) -> usize {
            9
        }

        fn load(&self, view: usize) -> Result<FusionView, String> {
            self.0.fetch_add(1, Ordering::Relaxed);
            if view == 8 {
                return Err("no such file".into());
            }
            let intrinsics = Intrinsics { fx: 4.0, fy: 4.0, cx: 2.0, cy: 2.0 };
            let map = DepthMap {
                camera: Pinhole { size: SIZE, intrinsics },
                cam_from_world: Pose::identity(),
                depth: Grid::filled(SIZE, 1.0 + view as f32),
                confidence: Grid::filled(SIZE, 1.0),
                coarse_confidence: None,
            };
            Ok(FusionView { map, colour: Grid::filled(SIZE, [0; 3]), mask: None })
        }
    }

    #[test]
    fn recently_used_views_stay_and_the_oldest_go() {
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        one_thread.install(use_some_views);
    }

    /// With room for three views while one is loaded.
    fn use_some_views() {
        let (source, options) = (Counting::default(), FuseOptions::default());
        let mut cache = ViewCache::new(&source, &options, (3 + LOADING) * VIEW_BYTES);
        let mut loads_for = |views: &[usize]| {
            let before = source.0.load(Ordering::Relaxed);
            let found = cache.get(views).unwrap();
            for (view, found) in views.iter().zip(found) {
                assert!((found.inverse_depth[(0, 0)] - 1.0 / (1.0 + *view as f32)).abs() < 1e-6);
            }
            assert!(cache.held.len() <= 3);
            source.0.load(Ordering::Relaxed) - before
        };
        assert_eq!(loads_for(&[0, 1]), 2);
        assert_eq!(loads_for(&[1, 2]), 1);
        assert_eq!(loads_for(&[0, 1, 2]), 0);
        assert_eq!(loads_for(&[0]), 0);
        assert_eq!(loads_for(&[3]), 1, "view 1 or 2 goes");
        assert_eq!(loads_for(&[0]), 0, "view 0 was used since");
        assert_eq!(cache.most_bytes(), (3 + LOADING) * VIEW_BYTES);
        cache.set_aside(VIEW_BYTES);
        assert_eq!(cache.get(&[4]).unwrap().len(), 1);
        assert_eq!(cache.held.len(), 2, "there is less room now");
    }

    #[test]
    fn views_in_use_may_exceed_the_capacity_and_errors_name_the_view() {
        let (source, options) = (Counting::default(), FuseOptions::default());
        let mut cache = ViewCache::new(&source, &options, 0);
        assert_eq!(cache.get(&[4, 2, 7]).unwrap().len(), 3);
        assert_eq!(cache.get(&[1]).unwrap().len(), 1);
        assert_eq!(cache.held.len(), 1);
        let error = cache.get(&[1, 8]).unwrap_err();
        assert!(matches!(error, FuseError::Load { view: 8, .. }));
    }
}
