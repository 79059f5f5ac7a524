//! Views in memory: loaded as needed or ahead of use, the least recently used dropped first.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

use crate::FuseError;
use crate::appearance::SeenView;
use crate::packed_normal::PackedNormal;
use crate::photometric::FilteredView;

/// A view as a pass needs it.
pub(crate) trait MemorySize: Send + Sync {
    /// Bytes held in memory.
    fn bytes(&self) -> usize;

    /// Temporary bytes for loading it: rasters that are not kept.
    fn loading_bytes(&self) -> usize;
}

/// Bytes a pixel of what a depth map is loaded with: depth, both confidences, and mask.
const RASTERS: usize = 3 * size_of::<f32>() + 1;

impl MemorySize for FilteredView {
    fn bytes(&self) -> usize {
        self.bytes()
    }

    fn loading_bytes(&self) -> usize {
        self.size().area() * RASTERS
    }
}

impl MemorySize for SeenView {
    fn bytes(&self) -> usize {
        self.bytes()
    }

    /// The depth map's rasters beside packed normals, before there are colours; what is loaded before and after takes
    /// less.
    fn loading_bytes(&self) -> usize {
        let area = self.filtered.size().area();
        let together = self.filtered.bytes() + area * (RASTERS + size_of::<PackedNormal>());
        together - self.bytes()
    }
}

/// Loads a view of this number.
type Load<'a, T> = dyn Fn(usize) -> Result<T, FuseError> + Sync + 'a;

/// Views of at most `capacity` bytes, including those being loaded, unless the views in use need
/// more.
pub(crate) struct ViewCache<'a, T> {
    load: Box<Load<'a, T>>,
    capacity: usize,
    held: BTreeMap<usize, CachedView<T>>,
    clock: u64,
    /// Bytes of the largest view so far: what the next one is expected to take.
    largest: usize,
    /// The most temporary bytes that a view took to load.
    most_loading: usize,
    /// Bytes of the capacity that other data takes.
    set_aside: usize,
    /// Peak of the bytes held, including those set aside and those for loading.
    most: usize,
}

struct CachedView<T> {
    view: Arc<T>,
    last: u64,
}

impl<'a, T: MemorySize> ViewCache<'a, T> {
    pub fn new(capacity: usize, load: impl Fn(usize) -> Result<T, FuseError> + Sync + 'a) -> Self {
        let load = Box::new(load);
        Self {
            load,
            capacity,
            held: BTreeMap::new(),
            clock: 0,
            largest: 0,
            most_loading: 0,
            set_aside: 0,
            most: 0,
        }
    }

    /// Sets this many more bytes of the capacity aside for other data.
    pub fn set_aside(&mut self, bytes: usize) {
        self.set_aside += bytes;
    }

    /// The peak of the bytes held, with those set aside.
    pub fn most_bytes(&self) -> usize {
        self.most
    }

    /// Runs `work` on the views `now`, in this order. Meanwhile other threads load those of `next`
    /// that are not held, as far as there is room.
    pub fn with<R>(
        &mut self,
        now: &[usize],
        next: &[usize],
        work: impl FnOnce(&[Arc<T>]) -> R,
    ) -> Result<R, FuseError> {
        let views = self.get(now)?;
        let ahead = self.room_for(next);
        let mut loaded = Ok(Vec::new());
        let (load, all, result) = (&self.load, &ahead, &mut loaded);
        let result = rayon::in_place_scope(|scope| {
            if !all.is_empty() {
                scope.spawn(move |_| *result = load_all(load, all));
            }
            work(&views)
        });
        self.hold(&ahead, loaded?);
        Ok(result)
    }

    /// The views; those that are not held are loaded in parallel.
    fn get(&mut self, views: &[usize]) -> Result<Vec<Arc<T>>, FuseError> {
        self.clock += 1;
        self.touch(views);
        let mut missing = self.missing(views);
        while !missing.is_empty() {
            self.make_room(self.needed(missing.len()));
            // The first one alone: it tells what the others will take.
            let fitting = if self.largest == 0 { 1 } else { self.views_that_fit(missing.len()) };
            let rest = missing.split_off(fitting.clamp(1, missing.len()));
            let loaded = load_all(&self.load, &missing)?;
            self.hold(&missing, loaded);
            missing = rest;
        }
        let found = views.iter().map(|view| Arc::clone(&self.held[view].view)).collect();
        self.make_room(0);
        Ok(found)
    }

    /// The first of `views` that are not held and fit next to all views in use.
    fn room_for(&mut self, views: &[usize]) -> Vec<usize> {
        self.touch(views);
        let mut missing = self.missing(views);
        self.make_room(self.needed(missing.len()));
        missing.truncate(self.views_that_fit(missing.len()));
        missing
    }

    /// Bytes of so many more views, with those for loading them together.
    fn needed(&self, views: usize) -> usize {
        views * self.largest + self.loading(views)
    }

    /// How many of so many views fit in, loaded together.
    fn views_that_fit(&self, views: usize) -> usize {
        let bytes = self.bytes();
        (0..=views).rev().find(|&views| bytes + self.needed(views) <= self.capacity).unwrap_or(0)
    }

    fn touch(&mut self, views: &[usize]) {
        for view in views {
            self.held.entry(*view).and_modify(|held| held.last = self.clock);
        }
    }

    fn missing(&self, views: &[usize]) -> Vec<usize> {
        views.iter().copied().filter(|view| !self.held.contains_key(view)).collect()
    }

    /// Keeps views that were just loaded.
    fn hold(&mut self, views: &[usize], loaded: Vec<T>) {
        for (&view, loaded) in views.iter().zip(loaded) {
            self.largest = self.largest.max(loaded.bytes());
            self.most_loading = self.most_loading.max(loaded.loading_bytes());
            self.held.insert(view, CachedView { view: Arc::new(loaded), last: self.clock });
        }
        self.most = self.most.max(self.bytes() + self.loading(views.len()));
    }

    /// Bytes held, with those set aside.
    fn bytes(&self) -> usize {
        self.set_aside + self.held.values().map(|held| held.view.bytes()).sum::<usize>()
    }

    /// Temporary bytes for loading so many views.
    fn loading(&self, views: usize) -> usize {
        views.min(rayon::current_num_threads()) * self.most_loading
    }

    /// Drops views until `needed` bytes are free, but none of the current request.
    fn make_room(&mut self, needed: usize) {
        let mut bytes = self.bytes();
        while bytes + needed > self.capacity {
            let idle = self.held.iter().filter(|(_, held)| held.last < self.clock);
            let Some(oldest) = idle.min_by_key(|(_, held)| held.last).map(|(&view, _)| view) else {
                return;
            };
            bytes -= self.held.remove(&oldest).map_or(0, |held| held.view.bytes());
        }
    }
}

/// Loads views in parallel; an error is that of the first view that failed.
fn load_all<T: Send>(load: &Load<'_, T>, views: &[usize]) -> Result<Vec<T>, FuseError> {
    let loaded: Vec<_> = views.par_iter().map(|&view| load(view)).collect();
    loaded.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    const VIEW_BYTES: usize = 100;

    struct Number(usize);

    const LOADING: usize = 3;

    impl MemorySize for Number {
        fn bytes(&self) -> usize {
            VIEW_BYTES
        }

        fn loading_bytes(&self) -> usize {
            LOADING * VIEW_BYTES
        }
    }

    /// A cache of this capacity that counts its loads; view 8 is missing.
    fn counting(capacity: usize, loads: &AtomicUsize) -> ViewCache<'_, Number> {
        ViewCache::new(capacity, |view| {
            loads.fetch_add(1, Ordering::Relaxed);
            let missing = FuseError::Load { view, source: "no such file".into() };
            if view == 8 { Err(missing) } else { Ok(Number(view)) }
        })
    }

    fn on_one_thread(work: impl FnOnce() + Send) {
        rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(work);
    }

    fn get(cache: &mut ViewCache<'_, Number>, now: &[usize], next: &[usize]) -> Result<(), FuseError> {
        cache.with(now, next, |views| {
            assert!(views.iter().map(|view| view.0).eq(now.iter().copied()));
        })
    }

    #[test]
    fn recently_used_views_stay_and_the_oldest_go() {
        on_one_thread(|| {
            // With room for three views while one is loaded.
            let loads = AtomicUsize::new(0);
            let mut cache = counting((3 + LOADING) * VIEW_BYTES, &loads);
            let mut loads_for = |views: &[usize]| {
                let before = loads.load(Ordering::Relaxed);
                get(&mut cache, views, &[]).unwrap();
                assert!(cache.held.len() <= 3);
                loads.load(Ordering::Relaxed) - before
            };
            assert_eq!(loads_for(&[0, 1]), 2);
            assert_eq!(loads_for(&[1, 2]), 1);
            assert_eq!(loads_for(&[0, 1, 2]), 0);
            assert_eq!(loads_for(&[0]), 0);
            assert_eq!(loads_for(&[3]), 1, "view 1 or 2 goes");
            assert_eq!(loads_for(&[0]), 0, "view 0 was used since");
            assert_eq!(cache.most_bytes(), (3 + LOADING) * VIEW_BYTES);
            cache.set_aside(VIEW_BYTES);
            get(&mut cache, &[4], &[]).unwrap();
            assert_eq!(cache.held.len(), 2, "there is less room now");
        });
    }

    #[test]
    fn views_are_loaded_ahead_as_far_as_there_is_room() {
        on_one_thread(|| {
            let loads = AtomicUsize::new(0);
            let mut cache = counting((4 + LOADING) * VIEW_BYTES, &loads);
            get(&mut cache, &[0, 1], &[1, 2, 3, 4]).unwrap();
            assert_eq!(cache.held.keys().copied().collect::<Vec<_>>(), [0, 1, 2, 3]);
            get(&mut cache, &[1, 2, 3], &[5]).unwrap();
            assert_eq!(cache.held.keys().copied().collect::<Vec<_>>(), [1, 2, 3, 5]);
            assert_eq!(loads.load(Ordering::Relaxed), 5);
            assert_eq!(cache.most_bytes(), (4 + LOADING) * VIEW_BYTES);
        });
    }

    #[test]
    fn views_in_use_may_exceed_the_capacity_and_errors_name_the_view() {
        let loads = AtomicUsize::new(0);
        let mut cache = counting(0, &loads);
        get(&mut cache, &[4, 2, 7], &[]).unwrap();
        get(&mut cache, &[1], &[3]).unwrap();
        assert_eq!(cache.held.len(), 1, "nothing is loaded ahead");
        let error = get(&mut cache, &[1, 8], &[]).unwrap_err();
        assert!(matches!(error, FuseError::Load { view: 8, .. }));
        let mut ample = counting(100 * VIEW_BYTES, &loads);
        assert!(matches!(get(&mut ample, &[0], &[8]).unwrap_err(), FuseError::Load { view: 8, .. }));
    }
}
