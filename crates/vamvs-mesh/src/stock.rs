//! Views that stay in memory as long as there is room.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::view::SeenView;

/// Views in memory.
pub(crate) struct Stock {
    /// Bytes that the views may take.
    pub room: u64,
    /// With the time of the last use.
    views: BTreeMap<usize, (Arc<SeenView>, u64)>,
    time: u64,
}

impl Stock {
    /// An empty stock.
    pub fn new(room: u64) -> Self {
        Self { room, views: BTreeMap::new(), time: 0 }
    }

    /// These views, with those that are not there yet made by `make`. Others go, those that were not used for longest first, until
    /// all that are left have room.
    pub fn get<E>(
        &mut self,
        wanted: &[usize],
        mut make: impl FnMut(usize) -> Result<SeenView, E>,
    ) -> Result<Vec<Arc<SeenView>>, E> {
        self.time += 1;
        let time = self.time;
        for view in wanted {
            if let Some((_, used)) = self.views.get_mut(view) {
                *used = time;
            }
        }
        for &view in wanted {
            if !self.views.contains_key(&view) {
                let made = make(view)?;
                self.make_room(made.bytes());
                self.views.insert(view, (Arc::new(made), time));
            }
        }
        Ok(wanted.iter().map(|view| Arc::clone(&self.views[view].0)).collect())
    }

    /// Removes views that are not in use until so many bytes are free, or none of them is left.
    fn make_room(&mut self, bytes: u64) {
        let taken = |views: &BTreeMap<usize, (Arc<SeenView>, u64)>| -> u64 {
            views.values().map(|(view, _)| view.bytes()).sum()
        };
        while taken(&self.views) + bytes > self.room {
            let unused = self.views.iter().filter(|(_, (_, used))| *used < self.time);
            let Some((&oldest, _)) = unused.min_by_key(|(_, (_, used))| *used) else { return };
            self.views.remove(&oldest);
        }
    }
}
