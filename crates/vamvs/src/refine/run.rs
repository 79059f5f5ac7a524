//! One view after the other.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::rc::Rc;
use std::time::Instant;

use vamvs_core::depth_map::is_valid;
use vamvs_core::{DepthMap, DepthRange, Photo, Source};

use super::cache::PhotoCache;
use super::{RefineJob, RefineSummary, Refined, refine_view, refine_view_geometric};
use crate::output::{LeftOut, Record, SavedMap, names};
use crate::{Event, VamvsError};

/// Changes whenever the same inputs give other depth maps.
const VERSION: u32 = 1;

/// What became of a view.
enum Outcome {
    Made,
    Resumed,
}

pub(super) struct Run<'a> {
    job: &'a RefineJob<'a>,
    /// For each depth map, its view in the scene.
    views: Vec<Option<usize>>,
    /// For each depth map, those of its source views, best first.
    sources: Vec<Vec<usize>>,
    photos: PhotoCache,
    /// Results without geometric pass that will still be needed.
    first: HashMap<usize, Rc<Refined>>,
    hashes: HashMap<usize, blake3::Hash>,
    summary: RefineSummary,
}

impl<'a> Run<'a> {
    pub fn new(job: &'a RefineJob<'a>) -> Self {
        let in_scene: HashMap<String, usize> =
            names(&job.scene.views).into_iter().enumerate().map(|(view, name)| (name, view)).collect();
        let views: Vec<Option<usize>> =
            job.maps.names().iter().map(|name| in_scene.get(name).copied()).collect();
        let mut sources = job.maps.neighbours(job.views.max(2) - 1);
        sources.iter_mut().for_each(|sources| sources.retain(|&source| views[source].is_some()));
        Self {
            job,
            views,
            sources,
            photos: PhotoCache::new(2 * job.views),
            first: HashMap::new(),
            hashes: HashMap::new(),
            summary: RefineSummary::default(),
        }
    }

    pub fn views(mut self, on_event: &mut dyn FnMut(Event)) -> Result<RefineSummary, VamvsError> {
        let names: Vec<&str> = self.job.maps.names().iter().map(String::as_str).collect();
        self.job.output.expect_apart([self.job.photographs.folder()])?;
        self.job.output.expect_apart([self.job.maps.root().join("images").as_path()])?;
        self.job.output.prepare(&names)?;
        self.job.output.forget_views()?;
        let total = names.len();
        for (map, name) in names.iter().enumerate() {
            let begin = Instant::now();
            match self.view(map)? {
                Ok(outcome) => {
                    let resumed = matches!(outcome, Outcome::Resumed);
                    let (name, done) = ((*name).to_owned(), map + 1);
                    on_event(Event::DepthMap { name, done, total, resumed, time: begin.elapsed() });
                }
                Err(error) => self.leave_out(name, error.in_full(), on_event)?,
            }
            self.forget(map);
        }
        self.finish(&names)
    }

    /// Refines one view unless that is done. The outer error is one of writing.
    fn view(&mut self, map: usize) -> Result<Result<Outcome, VamvsError>, VamvsError> {
        let record = match self.record(map) {
            Ok(record) => record,
            Err(error) => return Ok(Err(error)),
        };
        let (output, name) = (self.job.output, self.job.maps.names()[map].as_str());
        let same = |saved: Record| saved.made_of == record.made_of;
        let is_there = output.saved(name).is_some_and(same) && output.normals(name).is_file();
        if !self.job.force && is_there && output.is_readable(name) {
            self.summary.resumed += 1;
            return Ok(Ok(Outcome::Resumed));
        }
        match self.refined(map).and_then(|refined| Ok((range(&refined.map)?, self.photo(map)?, refined))) {
            Err(error) => Ok(Err(error)),
            Ok((range, photo, refined)) => {
                let begin = Instant::now();
                let normals = refined.normals_in_world();
                let saved =
                    SavedMap { map: &refined.map, range, colour: &photo.image, normals: Some(&normals) };
                output.save(name, &saved, &record)?;
                self.summary.writing += begin.elapsed();
                self.summary.made += 1;
                Ok(Ok(Outcome::Made))
            }
        }
    }

    fn refined(&mut self, map: usize) -> Result<Rc<Refined>, VamvsError> {
        let own = self.first(map)?;
        if !self.job.geometric {
            return Ok(own);
        }
        // A source view that cannot be refined has no part; that is told where its own turn comes.
        let (mut photos, mut maps) = (Vec::new(), Vec::new());
        for source in self.sources[map].clone() {
            if let Ok(photo) = self.photo(source) {
                photos.push(photo);
                maps.push(self.first(source).ok());
            }
        }
        let reference = self.photo(map)?;
        let photos: Vec<&Photo> = photos.iter().map(Rc::as_ref).collect();
        let maps: Vec<Option<&DepthMap>> =
            maps.iter().map(|refined| refined.as_ref().map(|refined| &refined.map)).collect();
        let begin = Instant::now();
        let refined = refine_view_geometric(&reference, &photos, &own, &maps, self.job.options)?;
        self.summary.geometric += begin.elapsed();
        Ok(Rc::new(refined))
    }

    /// The result of the photographs alone, kept for the views to come.
    fn first(&mut self, map: usize) -> Result<Rc<Refined>, VamvsError> {
        if let Some(refined) = self.first.get(&map) {
            return Ok(refined.clone());
        }
        let begin = Instant::now();
        let seed = self.job.maps.depth_map(map)?;
        self.summary.reading += begin.elapsed();
        let reference = self.photo(map)?;
        let sources: Vec<Rc<Photo>> =
            self.sources[map].clone().into_iter().filter_map(|source| self.photo(source).ok()).collect();
        let sources: Vec<&Photo> = sources.iter().map(Rc::as_ref).collect();
        let begin = Instant::now();
        let refined = Rc::new(refine_view(&reference, &sources, &seed, &[], self.job.options)?);
        self.summary.photometric += begin.elapsed();
        self.first.insert(map, refined.clone());
        Ok(refined)
    }

    fn photo(&mut self, map: usize) -> Result<Rc<Photo>, VamvsError> {
        let (job, begin) = (self.job, Instant::now());
        let view = self.views[map].ok_or_else(|| {
            let name = &job.maps.names()[map];
            VamvsError::Request(format!("expected a photograph called {name} in the scene, found none"))
        })?;
        let read = || job.photographs.load(&job.scene.views[view]).map(|(photo, _)| photo);
        let photo = self.photos.get(view, read);
        self.summary.reading += begin.elapsed();
        photo
    }

    /// Drops what no later view needs.
    fn forget(&mut self, done: usize) {
        let later = done + 1..self.sources.len();
        let needed: HashSet<usize> =
            later.flat_map(|map| self.sources[map].iter().copied().chain([map])).collect();
        self.first.retain(|map, _| needed.contains(map));
    }

    fn record(&mut self, map: usize) -> Result<Record, VamvsError> {
        let mut hasher = blake3::Hasher::new();
        let photographs = self.job.photographs;
        let options = (VERSION, self.job.options, self.job.geometric, photographs.max_size());
        hasher.update(format!("{options:?} {:?}", photographs.shape()).as_bytes());
        for view in std::iter::once(map).chain(self.sources[map].clone()) {
            let own = self.hash(view)?;
            hasher.update(own.as_bytes());
            for source in self.sources[view].clone() {
                hasher.update(self.hash(source)?.as_bytes());
            }
        }
        let names = self.job.maps.names();
        Ok(Record {
            made_of: hasher.finalize().to_hex().to_string(),
            planes: self.job.maps.record(map).and_then(|record| record.planes),
            sources: self.sources[map].iter().map(|&source| names[source].clone()).collect(),
        })
    }

    /// The hash of a view's photograph, mask, camera, pose and depth map.
    fn hash(&mut self, map: usize) -> Result<blake3::Hash, VamvsError> {
        if let Some(hash) = self.hashes.get(&map) {
            return Ok(*hash);
        }
        let mut hasher = blake3::Hasher::new();
        if let Some(view) = self.views[map].map(|view| &self.job.scene.views[view]) {
            hasher.update(format!("{:?} {:?}", view.camera, view.cam_from_world).as_bytes());
            add(&mut hasher, &self.job.photographs.path(view));
            self.job.photographs.mask_path(view).iter().for_each(|mask| add(&mut hasher, mask));
        }
        add(&mut hasher, self.job.maps.depth_file(map));
        let hash = hasher.finalize();
        self.hashes.insert(map, hash);
        Ok(hash)
    }

    fn leave_out(
        &mut self,
        name: &str,
        reason: String,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<(), VamvsError> {
        let left_out = LeftOut { view: name.to_owned(), reason };
        on_event(Event::left_out(&left_out));
        self.summary.skipped.push(left_out);
        self.job.output.discard(name)
    }

    /// Writes `pair.txt`. That nothing could be refined is an error.
    fn finish(self, names: &[&str]) -> Result<RefineSummary, VamvsError> {
        let skipped = &self.summary.skipped;
        let there: Vec<usize> = (0..names.len())
            .filter(|&map| skipped.iter().all(|left_out| left_out.view != names[map]))
            .collect();
        if let (true, Some(LeftOut { view, reason })) = (there.is_empty(), skipped.first()) {
            return Err(VamvsError::Request(format!("no depth map could be refined: {view}: {reason}")));
        }
        let neighbours = self.job.maps.neighbours(names.len().min(10));
        let place = |source: &usize| there.binary_search(source).ok();
        let sources = |map: &usize| -> Vec<Source> {
            let of_map = neighbours[*map].iter().filter_map(place).enumerate();
            of_map.map(|(rank, view)| Source { view, score: 1.0 / (1.0 + rank as f64) }).collect()
        };
        let names: Vec<&str> = there.iter().map(|&map| names[map]).collect();
        self.job.output.write_pairs(&names, &there.iter().map(sources).collect::<Vec<_>>())?;
        self.job.output.write_left_out(&self.summary.skipped)?;
        Ok(self.summary)
    }
}

/// Adds a file, or why it cannot be read: then the view is left out when its turn comes.
fn add(hasher: &mut blake3::Hasher, path: &Path) {
    let read = std::fs::File::open(path).and_then(|file| hasher.update_reader(file).map(drop));
    if let Err(error) = read {
        hasher.update(error.to_string().as_bytes());
    }
}

/// The range of a map's depths.
fn range(map: &DepthMap) -> Result<DepthRange, VamvsError> {
    let valid = map.depth.data().iter().copied().filter(|&depth| is_valid(depth));
    let (near, far) = valid.fold((f32::MAX, 0.0_f32), |(near, far), depth| (near.min(depth), far.max(depth)));
    let widened = DepthRange::try_new(f64::from(near) * 0.99, f64::from(far) * 1.01);
    widened.map_err(|_| VamvsError::Request("no pixel has a depth".to_owned()))
}
