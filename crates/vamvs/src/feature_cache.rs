//! A cache of the features of photographs.

use std::rc::Rc;
use std::time::{Duration, Instant};

use vamvs_core::{Photo, Scene};
use vamvs_net::tch::no_grad;
use vamvs_net::{EncodedView, Network, Profile, Stage};

use crate::event::{OnEvent, tell};
use crate::{Event, Photographs, VamvsError};

/// A photograph and its features.
pub struct Encoded {
    pub photo: Photo,
    pub features: EncodedView,
}

impl Encoded {
    fn bytes(&self) -> usize {
        self.features.bytes() + 3 * self.photo.image.data().len()
    }
}

/// Encodes photographs on demand and keeps the most recently used ones.
pub struct FeatureCache<'a> {
    pub scene: &'a Scene,
    pub photographs: Photographs,
    pub network: &'a Network,
    /// Bytes to keep.
    pub capacity: usize,
    /// Time that reading photographs took.
    pub reading: Duration,
    /// Least recently used first.
    kept: Vec<(usize, Rc<Encoded>)>,
    noted: Vec<bool>,
}

impl<'a> FeatureCache<'a> {
    pub fn new(scene: &'a Scene, photographs: Photographs, network: &'a Network, capacity: usize) -> Self {
        Self {
            scene,
            photographs,
            network,
            capacity,
            reading: Duration::ZERO,
            kept: Vec::new(),
            noted: vec![false; scene.views.len()],
        }
    }

    /// The features of a view.
    pub fn get(
        &mut self,
        view: usize,
        profile: &mut Profile,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Rc<Encoded>, VamvsError> {
        if let Some(place) = self.kept.iter().position(|(kept, _)| *kept == view) {
            let entry = self.kept.remove(place);
            self.kept.push(entry);
        } else {
            let encoded = self.encode(view, profile, on_event)?;
            self.make_room(encoded.bytes());
            self.kept.push((view, Rc::new(encoded)));
        }
        Ok(Rc::clone(&self.kept[self.kept.len() - 1].1))
    }

    /// Drops the features of all views but these.
    pub fn keep_only(&mut self, views: &[usize]) {
        self.kept.retain(|(view, _)| views.contains(view));
    }

    /// Drops all features.
    pub fn clear(&mut self) {
        self.kept.clear();
    }

    fn encode(
        &mut self,
        view: usize,
        profile: &mut Profile,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Encoded, VamvsError> {
        let scene_view = &self.scene.views[view];
        let of_view = |error: VamvsError| error.of_view(&scene_view.name);
        let begin = Instant::now();
        let (photo, note) = self.photographs.load(scene_view).map_err(of_view)?;
        self.reading += begin.elapsed();
        if let Some(note) = note.filter(|_| !self.noted[view]) {
            self.noted[view] = true;
            tell(on_event, Event::Warning(note))?;
        }
        let features = profile.time(Stage::Encode, || no_grad(|| self.network.encode(&photo)));
        Ok(Encoded { features: features.map_err(|error| of_view(error.into()))?, photo })
    }

    fn make_room(&mut self, needed: usize) {
        let mut used: usize = self.kept.iter().map(|(_, encoded)| encoded.bytes()).sum();
        while used + needed > self.capacity && !self.kept.is_empty() {
            used -= self.kept.remove(0).1.bytes();
        }
    }
}
