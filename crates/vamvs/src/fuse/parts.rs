//! Fusion spread over processes, also on different machines that share the folder: the first pass
//! over parts of the views, the second pass over parts of them, and a last step that joins the
//! cloud. The cloud is byte for byte that of [`crate::fuse()`].

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use vamvs_core::Part;
use vamvs_fusion::{
    Batch, Collector, ConsistentPixels, ConsistentViews, Counts, FuseError, FuseEvent, FuseJob, FuseReport,
    MapSource, Schedule,
};

use super::{FuseSummary, Sink, warn_of_memory, with_own_confidence, working_memory, write_cloud};
use crate::event::OnEvent;
use crate::memory::KeptMemory;
use crate::part_files::{FrameReader, Kind, PartFiles, path};
use crate::photographs::hash_file;
use crate::{Event, ExportOptions, FusionOptions, Maps, VamvsError};

/// Increased whenever a change gives other part files for the same depth maps.
const VERSION: u32 = 4;

/// A fusion that is done in parts.
pub struct PartialFusion<'a> {
    maps: &'a Maps,
    options: FusionOptions,
    neighbours: Vec<Vec<usize>>,
    schedule: Schedule,
    files: PartFiles,
}

impl<'a> PartialFusion<'a> {
    /// A fusion of these depth maps, with part files in the folder `parts/` next to them.
    ///
    /// # Errors
    /// If an option is invalid, or asks for the network's confidence, which the depth maps do not have.
    pub fn new(maps: &'a Maps, options: &FusionOptions) -> Result<Self, VamvsError> {
        options.validate()?;
        let options = with_own_confidence(maps, options)?;
        let neighbours = maps.neighbours(options.neighbours);
        let schedule = Schedule::new(&neighbours, maps.len())?;
        let files = PartFiles::new(maps.root(), made_of(maps, &options, &neighbours));
        Ok(Self { maps, options, neighbours, schedule, files })
    }

    /// The file that a finished part of the first pass leaves.
    #[must_use]
    pub fn confirmed_file(root: &Path, part: Part) -> PathBuf {
        path(root, Kind::Counts, part)
    }

    /// The file that a finished part of the second pass leaves.
    #[must_use]
    pub fn merged_file(root: &Path, part: Part) -> PathBuf {
        path(root, Kind::Points, part)
    }

    /// The first pass over a part of the views, unless that is done: finds their consistent pixels.
    /// Returns whether it did anything.
    ///
    /// # Errors
    /// If a depth map cannot be read, a file cannot be written, or `on_event` breaks.
    pub fn confirm(&self, part: Part, on_event: &mut OnEvent<'_>) -> Result<bool, VamvsError> {
        if self.files.is_there(Kind::Pixels, part) && self.files.is_there(Kind::Counts, part) {
            return Ok(false);
        }
        let (mut done, total) = (0, self.schedule.confirmed_in(part).len());
        let mut progress = |_: FuseEvent| {
            done += 1;
            on_event(Event::Fusion { done, total })
        };
        let job = self.job();
        let _kept = KeptMemory::new();
        let (views, memory) = vamvs_fusion::confirm(&job, &self.schedule, part, &mut progress)?;
        let mut pixels = self.files.create(Kind::Pixels, part)?;
        views.iter().try_for_each(|view| pixels.push(&view))?;
        pixels.finish()?;
        let counts: BTreeMap<usize, Counts> =
            views.into_iter().map(|(view, pixels)| (view, pixels.counts)).collect();
        let mut file = self.files.create(Kind::Counts, part)?;
        file.push(&counts)?;
        file.finish()?;
        warn_of_memory(memory, job.memory, self.options.max_memory, on_event)?;
        Ok(true)
    }

    /// The second pass over a part of the views, unless that is done: makes their points. The first
    /// pass must be done for all parts, with the same number of parts. Returns whether it did
    /// anything.
    ///
    /// # Errors
    /// As [`PartialFusion::confirm`], and if a file of the first pass is missing or damaged.
    pub fn merge(&self, part: Part, on_event: &mut OnEvent<'_>) -> Result<bool, VamvsError> {
        if self.files.is_there(Kind::Points, part) {
            return Ok(false);
        }
        let counts = self.counts(part.count())?;
        let views = self.schedule.merged_in(part);
        let pixels = self.pixels(&views, part.count())?;
        let mut file = self.files.create(Kind::Points, part)?;
        let (mut done, total) = (0, views.len());
        let mut take = |batch: Batch| -> Result<(), FuseError> {
            file.push(&batch).map_err(|error| FuseError::Sink(error.into()))?;
            done += usize::from(batch.is_last);
            let goes_on = !batch.is_last || on_event(Event::Fusion { done, total }).is_continue();
            if goes_on { Ok(()) } else { Err(FuseError::Cancelled) }
        };
        let job = self.job();
        let _kept = KeptMemory::new();
        let memory = vamvs_fusion::merge(&job, &self.schedule, part, (&pixels, &counts), &mut take)?;
        file.finish()?;
        warn_of_memory(memory, job.memory, self.options.max_memory, on_event)?;
        Ok(true)
    }

    /// Joins the points of all `parts` parts into the cloud, writes the exports, and removes the
    /// part files if there are any points.
    ///
    /// # Errors
    /// If a file of a part is missing or damaged, or as [`crate::fuse()`].
    pub fn concatenate(
        &self,
        parts: usize,
        cloud: &Path,
        exports: &ExportOptions,
        on_event: &mut OnEvent<'_>,
    ) -> Result<FuseSummary, VamvsError> {
        let counts = self.counts(parts)?;
        let total = self.maps.len();
        let run = |sink: &mut Sink<'_>, on_event: &mut OnEvent<'_>| {
            let mut done = 0;
            let mut progress = |_: FuseEvent| {
                done += 1;
                on_event(Event::Fusion { done, total })
            };
            let mut collector = Collector::new(&counts, &self.options.filter, sink, &mut progress);
            for part in Part::all(parts) {
                let mut file = self.files.open(Kind::Points, part)?;
                while let Some(batch) = file.next::<Batch>()? {
                    collector.take(batch)?;
                }
            }
            Ok(FuseReport { views: collector.finish(), memory: 0 })
        };
        let wanted = (&self.options, exports);
        let fused = write_cloud((self.maps, &self.neighbours), cloud, wanted, run, on_event)?;
        if fused.points > 0 {
            self.files.remove(&[Kind::Counts, Kind::Pixels, Kind::Points], parts);
        }
        Ok(fused)
    }

    fn job(&self) -> FuseJob<'_, Maps> {
        FuseJob {
            source: self.maps,
            neighbours: &self.neighbours,
            options: &self.options.filter,
            roi: self.options.roi,
            memory: working_memory(self.options.max_memory),
        }
    }

    /// The counts of the first pass for all views.
    fn counts(&self, parts: usize) -> Result<Vec<Counts>, VamvsError> {
        let mut counts = BTreeMap::new();
        for part in Part::all(parts) {
            let found: Option<BTreeMap<usize, Counts>> = self.files.open(Kind::Counts, part)?.next()?;
            counts.extend(found.unwrap_or_default());
        }
        if counts.keys().copied().eq(0..self.maps.len()) {
            return Ok(counts.into_values().collect());
        }
        let problem = format!(
            "expected results of the first pass for {} views, found them for {}",
            self.maps.len(),
            counts.len()
        );
        Err(VamvsError::Folder { path: self.files.folder(), problem })
    }

    /// The consistent pixels that the second pass over these views needs.
    fn pixels(&self, views: &[usize], parts: usize) -> Result<ConsistentViews, VamvsError> {
        let needed = self.schedule.needed_to_merge(views);
        let mut all = ConsistentViews::new();
        for part in Part::all(parts) {
            if self.schedule.confirmed_in(part).iter().any(|view| needed.contains(view)) {
                self.read_pixels(part, |view| needed.contains(&view), &mut all)?;
            }
        }
        Ok(all)
    }

    /// Adds the consistent pixels of the views of a part of the first pass for which `is_needed` holds.
    fn read_pixels(
        &self,
        part: Part,
        is_needed: impl Fn(usize) -> bool,
        all: &mut ConsistentViews,
    ) -> Result<(), VamvsError> {
        let mut file: FrameReader = self.files.open(Kind::Pixels, part)?;
        while let Some((view, pixels)) = file.next::<(usize, ConsistentPixels)>()? {
            if is_needed(view) {
                all.insert(view, pixels);
            }
        }
        Ok(())
    }

    /// The depth maps.
    pub(crate) fn maps(&self) -> &'a Maps {
        self.maps
    }

    /// The views of a part of the first pass.
    pub(crate) fn views_in(&self, part: Part) -> &[usize] {
        self.schedule.confirmed_in(part)
    }

    /// The hash of all inputs.
    pub(crate) fn made_of(&self) -> &str {
        &self.files.made_of
    }

    /// Adds the consistent pixels of a view, and those of all views of its part of the first pass, unless they are there.
    pub(crate) fn expect_pixels(
        &self,
        view: usize,
        parts: usize,
        all: &mut ConsistentViews,
    ) -> Result<(), VamvsError> {
        let is_in = |part: &Part| self.views_in(*part).contains(&view);
        match Part::all(parts).find(is_in) {
            Some(part) if !all.contains_key(&view) => self.read_pixels(part, |_| true, all),
            _ => Ok(()),
        }
    }
}

/// The hash of all inputs of the fusion: settings, and for each view its camera, its mask, and the hash in its record or,
/// without one, the content of its files.
fn made_of(maps: &Maps, options: &FusionOptions, neighbours: &[Vec<usize>]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{VERSION} {:?} {:?} {neighbours:?}", options.filter, options.roi).as_bytes());
    for (view, name) in maps.names().iter().enumerate() {
        hasher.update(format!("{name} {:?} {:?}", maps.camera(view), maps.pose(view)).as_bytes());
        match maps.record(view) {
            Some(record) => {
                hasher.update(record.made_of.as_bytes());
                maps.mask_file(view).iter().for_each(|file| hash_file(file, &mut hasher));
            }
            None => maps.files(view).for_each(|file| hash_file(&file, &mut hasher)),
        }
    }
    hasher.finalize().to_hex().to_string()
}
