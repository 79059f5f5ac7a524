//! Refines the views of a folder one after the other.

use std::collections::{HashMap, HashSet};
use std::rc::Rc;
use std::time::Instant;

use vamvs_core::depth_map::is_valid;
use vamvs_core::{DepthMap, DepthRange, Photo, Size, Source};

use super::cache::PhotoCache;
use super::{RefineJob, RefineSummary, Refined};
use crate::output::{ConfidenceKind, LeftOut, Record, SavedMap, names};
use vamvs_io::image;
use vamvs_refine::refine_on;

use crate::ceiling::Ceiling;
use crate::event::{OnEvent, tell, warn};
use crate::photographs::{hash_file, working_cameras};
use crate::place::{Place, peak_bytes};
use crate::{Event, OutputFolder, Pass, VamvsError, geometric, memory};

/// Increased whenever a change gives other depth maps for the same inputs.
const VERSION: u32 = 8;

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
    place: Place<'a>,
    ceiling: Ceiling,
    /// The folder of photometric depth maps, until all views are done.
    first: OutputFolder,
    /// Depth maps that are known to be in `first`.
    has_first: HashSet<usize>,
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
            photos: PhotoCache::default(),
            place: Place::new(job.device),
            ceiling: Ceiling::new(job.max_memory, needed(job)),
            first: job.output.photometric(),
            has_first: HashSet::new(),
            hashes: HashMap::new(),
            summary: RefineSummary::default(),
        }
    }

    pub fn views(mut self, on_event: &mut OnEvent<'_>) -> Result<RefineSummary, VamvsError> {
        let names: Vec<&str> = self.job.maps.names().iter().map(String::as_str).collect();
        self.job.output.expect_apart(self.job.photographs.folder())?;
        self.job.output.expect_apart([self.job.maps.root().join("images").as_path()])?;
        let _lock = self.job.output.prepare_alone(&names, &names)?;
        if self.job.geometric {
            self.first.expect_apart(self.job.photographs.folder())?;
            self.first.expect_apart([self.job.maps.root().join("images").as_path()])?;
            self.first.prepare(&names)?;
        }
        self.job.output.forget_views()?;
        let total = names.len();
        for (map, name) in names.iter().enumerate() {
            let begin = Instant::now();
            if !self.ceiling.has_room() {
                self.photos = PhotoCache::default();
                memory::give_back();
            }
            match self.view(map)? {
                Ok(outcome) => {
                    let resumed = matches!(outcome, Outcome::Resumed);
                    let (name, done) = ((*name).to_owned(), map + 1);
                    let (pass, time) = (Pass::Final, begin.elapsed());
                    tell(on_event, Event::DepthMap { name, pass, done, total, resumed, time })?;
                }
                Err(error) if error.ends_all() => return Err(error),
                Err(error) => self.leave_out(name, error.with_causes(), on_event)?,
            }
            warn(on_event, self.place.warning())?;
        }
        if self.first.is_own() {
            self.first.remove(&names)?;
        }
        self.finish(&names)
    }

    /// Refines one view unless that is done. The outer error means that a file could not be
    /// written.
    fn view(&mut self, map: usize) -> Result<Result<Outcome, VamvsError>, VamvsError> {
        let record = match self.record(map, self.job.geometric) {
            Ok(record) => record,
            Err(error) => return Ok(Err(error)),
        };
        if self.is_there(self.job.output, map, &record) {
            self.summary.resumed += 1;
            return Ok(Ok(Outcome::Resumed));
        }
        let refined = if self.job.geometric { self.refined_again(map)? } else { self.refined(map) };
        match refined {
            Err(error) => Ok(Err(error)),
            Ok(refined) => match self.save(self.job.output, map, refined, &record)? {
                Err(error) => Ok(Err(error)),
                Ok(()) => {
                    self.summary.made += 1;
                    Ok(Ok(Outcome::Made))
                }
            },
        }
    }

    fn is_there(&self, folder: &OutputFolder, map: usize, record: &Record) -> bool {
        let name = &self.job.maps.names()[map];
        let same = |saved: Record| saved.made_of == record.made_of;
        let is_there = folder.saved(name).is_some_and(same) && folder.normals(name).is_file();
        !self.job.force && is_there && folder.is_readable(name)
    }

    /// Saves a refined depth map. The outer error means that a file could not be written.
    fn save(
        &mut self,
        folder: &OutputFolder,
        map: usize,
        refined: Refined,
        record: &Record,
    ) -> Result<Result<(), VamvsError>, VamvsError> {
        let (range, photo) = match range(&refined.map).and_then(|range| Ok((range, self.photo(map)?))) {
            Ok(found) => found,
            Err(error) => return Ok(Err(error)),
        };
        let begin = Instant::now();
        let Refined { map: map_of_view, normals, sigma } = refined.in_world();
        let colour = image::resize(&photo.image, map_of_view.depth.size());
        let (normals, sigma) = (Some(&normals), Some(&sigma));
        let saved = SavedMap { map: &map_of_view, range, colour: &colour, normals, sigma };
        folder.save(&self.job.maps.names()[map], &saved, record)?;
        self.summary.writing += begin.elapsed();
        Ok(Ok(()))
    }

    /// A depth map refined by the photographs and then with the depth maps of the source views. The outer error means that a
    /// file could not be written.
    fn refined_again(&mut self, map: usize) -> Result<Result<Refined, VamvsError>, VamvsError> {
        if let Err(error) = self.ensure_first(map)? {
            return Ok(Err(error));
        }
        // A source view without photograph is skipped; the warning comes with its own turn.
        let names = self.job.maps.names();
        let mut sources = Vec::new();
        for source in self.sources[map].clone() {
            if let Ok(photo) = self.photo(source) {
                // What it could not be refined for is told in its own turn; it has no depth map here.
                self.ensure_first(source)?.ok();
                sources.push((source, photo));
            }
        }
        let reference = match self.photo(map) {
            Ok(reference) => reference,
            Err(error) => return Ok(Err(error)),
        };
        let begin = Instant::now();
        let first = |map: usize, needed| geometric::loaded(&self.first, &names[map], needed);
        let refined = self.place.refined(self.job.options, |device, options| {
            geometric::refined(first, (map, &reference), &sources, (options, device))
        });
        self.summary.geometric += begin.elapsed();
        Ok(refined)
    }

    /// Makes the photometric depth map of a view unless it exists. The outer error means that a file could not be written.
    fn ensure_first(&mut self, map: usize) -> Result<Result<(), VamvsError>, VamvsError> {
        if self.has_first.contains(&map) {
            return Ok(Ok(()));
        }
        let record = match self.record(map, false) {
            Ok(record) => record,
            Err(error) => return Ok(Err(error)),
        };
        let folder = self.first.clone();
        if !self.is_there(&folder, map, &record) {
            let saved = match self.refined(map) {
                Ok(refined) => self.save(&folder, map, refined, &record)?,
                Err(error) => Err(error),
            };
            if saved.is_err() {
                return Ok(saved);
            }
        }
        self.has_first.insert(map);
        Ok(Ok(()))
    }

    /// A depth map refined by the photographs alone.
    fn refined(&mut self, map: usize) -> Result<Refined, VamvsError> {
        let begin = Instant::now();
        let seed = self.job.maps.depth_map(map)?;
        self.summary.reading += begin.elapsed();
        let reference = self.photo(map)?;
        let sources: Vec<Rc<Photo>> =
            self.sources[map].clone().into_iter().filter_map(|source| self.photo(source).ok()).collect();
        let sources: Vec<&Photo> = sources.iter().map(Rc::as_ref).collect();
        let begin = Instant::now();
        let options = *self.job.options;
        let geometric_follows = self.job.geometric;
        let options =
            if geometric_follows { geometric::first_pass(&options, reference.image.size()) } else { options };
        let refined = self.place.refined(&options, |device, options| {
            Ok(refine_on(device, &reference, &sources, (&seed, &[]), options)?)
        })?;
        self.summary.photometric += begin.elapsed();
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

    fn record(&mut self, map: usize, geometric: bool) -> Result<Record, VamvsError> {
        let mut hasher = blake3::Hasher::new();
        let photographs = self.job.photographs;
        let options = (VERSION, self.job.options, geometric, photographs.max_size());
        hasher.update(format!("{options:?} {:?}", photographs.shape()).as_bytes());
        if self.job.device.is_some() {
            hasher.update(b"on a device");
        }
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
            confidence: ConfidenceKind::Refined,
            photograph: None,
        })
    }

    /// The hash of a view's photograph, mask, camera and pose, and of all files of its depth map.
    fn hash(&mut self, map: usize) -> Result<blake3::Hash, VamvsError> {
        if let Some(hash) = self.hashes.get(&map) {
            return Ok(*hash);
        }
        let mut hasher = blake3::Hasher::new();
        if let Some(view) = self.views[map].map(|view| &self.job.scene.views[view]) {
            hasher.update(format!("{:?} {:?}", view.camera, view.cam_from_world).as_bytes());
            self.job.photographs.hash(view, &mut hasher);
        }
        let maps = self.job.maps;
        hasher.update(format!("{:?} {:?}", maps.camera(map), maps.pose(map)).as_bytes());
        maps.files(map).for_each(|file| hash_file(&file, &mut hasher));
        let hash = hasher.finalize();
        self.hashes.insert(map, hash);
        Ok(hash)
    }

    fn leave_out(
        &mut self,
        name: &str,
        reason: String,
        on_event: &mut OnEvent<'_>,
    ) -> Result<(), VamvsError> {
        let left_out = LeftOut { view: name.to_owned(), reason };
        tell(on_event, Event::left_out(&left_out))?;
        self.summary.skipped.push(left_out);
        self.job.output.discard(name)
    }

    /// Writes `pair.txt` and `left-out.json`; an error if nothing could be refined.
    fn finish(self, names: &[&str]) -> Result<RefineSummary, VamvsError> {
        let skipped = &self.summary.skipped;
        let there: Vec<usize> = (0..names.len())
            .filter(|&map| skipped.iter().all(|left_out| left_out.view != names[map]))
            .collect();
        if let (true, Some(LeftOut { view, reason })) = (there.is_empty(), skipped.first()) {
            self.job.output.remove(names)?;
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

/// What refining the largest view takes with its source views' photographs, bytes.
fn needed(job: &RefineJob<'_>) -> u64 {
    let sizes = working_cameras(job.photographs, job.scene).into_iter().map(|camera| camera.size);
    let photographs = 4 * job.views as u64;
    let bytes = |size: Size| peak_bytes(size, job.options, job.device) + photographs * size.area() as u64;
    sizes.map(bytes).max().unwrap_or(0)
}

/// The range of a map's depths, widened by 1 %.
fn range(map: &DepthMap) -> Result<DepthRange, VamvsError> {
    let valid = map.depth.data().iter().copied().filter(|&depth| is_valid(depth));
    let (near, far) = valid.fold((f32::MAX, 0.0_f32), |(near, far), depth| (near.min(depth), far.max(depth)));
    let widened = DepthRange::try_new(f64::from(near) * 0.99, f64::from(far) * 1.01);
    widened.map_err(|_| VamvsError::Request("no pixel has a depth".to_owned()))
}
