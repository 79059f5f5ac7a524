//! A cache of photographs and of what the method keeps of them.

use std::rc::Rc;
use std::time::{Duration, Instant};

use vamvs_core::Scene;

use crate::event::{OnEvent, tell};
use crate::method::{Clock, Encoded};
use crate::{Event, Method, Photographs, VamvsError};

/// The size at which the method sees a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Seen {
    /// As planned: a small one enlarged.
    Planned,
    /// A small one as it is.
    AsItIs,
}

/// Encodes photographs on demand and keeps the most recently used ones.
pub(crate) struct FeatureCache<'a> {
    pub scene: &'a Scene,
    pub photographs: Photographs,
    pub method: &'a Method,
    /// Bytes to keep.
    pub capacity: usize,
    /// Time that reading photographs took.
    pub reading: Duration,
    /// Least recently used first.
    kept: Vec<((usize, Seen), Rc<Encoded>)>,
    noted: Vec<bool>,
}

impl<'a> FeatureCache<'a> {
    pub fn new(scene: &'a Scene, photographs: Photographs, method: &'a Method, capacity: usize) -> Self {
        Self {
            scene,
            photographs,
            method,
            capacity,
            reading: Duration::ZERO,
            kept: Vec::new(),
            noted: vec![false; scene.views.len()],
        }
    }

    /// The features of a view at one size.
    pub fn get(
        &mut self,
        (view, seen): (usize, Seen),
        clock: &mut Clock,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Rc<Encoded>, VamvsError> {
        // A photograph that is not enlarged is the same both ways.
        let is_enlarged = self.photographs.enlarged_by(&self.scene.views[view].camera) > 1.0;
        let seen = if is_enlarged { seen } else { Seen::Planned };
        if let Some(place) = self.kept.iter().position(|(kept, _)| *kept == (view, seen)) {
            let entry = self.kept.remove(place);
            self.kept.push(entry);
        } else {
            let encoded = self.encode((view, seen), clock, on_event)?;
            self.make_room(encoded.bytes());
            self.kept.push(((view, seen), Rc::new(encoded)));
        }
        Ok(Rc::clone(&self.kept[self.kept.len() - 1].1))
    }

    /// Drops the features of all views but these.
    pub fn keep_only(&mut self, views: &[usize]) {
        self.kept.retain(|((view, _), _)| views.contains(view));
    }

    /// Drops all features.
    pub fn clear(&mut self) {
        self.kept.clear();
    }

    fn encode(
        &mut self,
        (view, seen): (usize, Seen),
        clock: &mut Clock,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Encoded, VamvsError> {
        let scene_view = &self.scene.views[view];
        let of_view = |error: VamvsError| error.of_view(&scene_view.name);
        let begin = Instant::now();
        let photo = match seen {
            Seen::Planned => self.photographs.load(scene_view),
            Seen::AsItIs => self.photographs.as_they_are().load(scene_view),
        };
        let (photo, note) = photo.map_err(of_view)?;
        self.reading += begin.elapsed();
        if let Some(note) = note.filter(|_| !self.noted[view]) {
            self.noted[view] = true;
            tell(on_event, Event::Warning(note))?;
        }
        let features = self.method.encode(&photo, clock).map_err(of_view)?;
        Ok(Encoded { features, photo })
    }

    fn make_room(&mut self, needed: usize) {
        let mut used: usize = self.kept.iter().map(|(_, encoded)| encoded.bytes()).sum();
        while used + needed > self.capacity && !self.kept.is_empty() {
            used -= self.kept.remove(0).1.bytes();
        }
    }
}
