//! Depth maps of all views, kept in the output folder.

mod less_memory;
mod region;
mod second_pass;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::rc::Rc;
use std::time::{Duration, Instant};

use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Photo, Planes, Rgb, Scene, Source};
use vamvs_io::image;
use vamvs_net::{EncodedView, Estimator, Profile};
use vamvs_refine::Refined;

use region::{covered, placed, remove_masked, rescaled, unmasked, widened};

use crate::ceiling::Ceiling;
use crate::feature_cache::{Encoded, FeatureCache};
use crate::fit::most_bytes;
use crate::identity::Identity;
use crate::output::{LeftOut, Record, SavedMap, names};
use crate::photographs::working_cameras;
use crate::refinement::{BYTES_PER_PIXEL, Refinement, Seed, shares};
use crate::{DepthOptions, Event, OutputFolder, Pass, Photographs, Plan, VamvsError, ViewPlan};

/// A depth this close to an end of its planes, as a share of them, sits at that end.
const END_SHARE: f64 = 0.01;

/// Share of the depths at an end of the range above which a warning is due.
const MANY_AT_END: f64 = 0.25;

/// Views whose features are kept beside those that one depth map compares.
const BESIDE: usize = 3;

/// What became of the views.
#[derive(Clone, Debug, Default)]
pub struct DepthSummary {
    /// Depth maps made now.
    pub made: usize,
    /// Depth maps that were there already.
    pub resumed: usize,
    /// Views without depth map.
    pub skipped: Vec<LeftOut>,
    /// Where the network's time went.
    pub profile: Profile,
    /// Time to find out what is there already, and to read, undistort and reduce photographs.
    pub reading: Duration,
    /// Time to refine depth maps to the size of their photographs, by these alone.
    pub refining: Duration,
    /// Time to refine them once more with the depth maps of the source views.
    pub refining_again: Duration,
    /// Time to write depth maps.
    pub writing: Duration,
}

/// What depth estimation works on.
pub struct DepthJob<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its photographs.
    pub photographs: &'a Photographs,
    /// What to do for each view.
    pub plan: &'a Plan,
    /// The network and its options.
    pub estimator: &'a Estimator,
    /// The bytes of the network's module, which the identity of depth maps depends on.
    pub module: &'a [u8],
    /// The user's options.
    pub options: &'a DepthOptions,
    /// Where depth maps go.
    pub output: &'a OutputFolder,
    /// Whether to make depth maps anew that are there already.
    pub force: bool,
}

/// Estimates the depth maps of all planned views. Those that are in the output folder already, made of
/// the same photographs, cameras, network and options, are left as they are.
///
/// # Errors
/// If no view has a depth map in the end, or a file cannot be written. Depth maps finished until then stay. A view
/// whose photograph cannot be read, or for which memory does not suffice, not even at half the size, is left
/// out and has no part in others.
pub fn estimate(job: &DepthJob, on_event: &mut dyn FnMut(Event)) -> Result<DepthSummary, VamvsError> {
    let names = names(&job.scene.views);
    prepare(job)?;
    let begin = Instant::now();
    let identity = Identity::new(job.module, job.estimator, job.scene);
    let summary = DepthSummary { reading: begin.elapsed(), ..DepthSummary::default() };
    let for_maps = most_bytes(job.plan, job.estimator).max(refinement_bytes(job));
    let capacity = job.options.max_memory.left().saturating_sub(for_maps) as usize;
    let most = job.options.views + BESIDE;
    let features =
        FeatureCache::new(job.scene, job.photographs.clone(), job.estimator.network(), (capacity, most));
    let (first, done) = (first_folder(job), BTreeSet::new());
    let has_more = first != *job.output;
    let refinement = job.options.refine.then(|| Refinement::new(job.scene, job.photographs, has_more));
    let (unusable, left_out) = (BTreeMap::new(), BTreeSet::new());
    let ceiling = Ceiling::new(job.options.max_memory, for_maps);
    let mut run =
        Run { job, names, identity, features, refinement, ceiling, first, done, unusable, left_out, summary };
    if has_more {
        run.find_done();
    }
    run.first_pass(on_event)?;
    if has_more {
        run.geometric_pass(on_event)?;
    }
    run.summary.reading += run.features.reading;
    if let Some(refinement) = &run.refinement {
        run.summary.reading += refinement.reading;
        run.summary.refining += refinement.refining;
        run.summary.refining_again += refinement.refining_again;
    }
    run.finish()
}

/// Where the first pass leaves its depth maps: where they stay, or beside, if there is another pass. The coarse maps
/// around a fovea have no other.
fn first_folder(job: &DepthJob) -> OutputFolder {
    let has_more = job.options.refine && job.options.geometric && !job.options.fovea;
    if has_more { job.output.photometric() } else { job.output.clone() }
}

/// What refining the largest depth map takes, bytes.
fn refinement_bytes(job: &DepthJob) -> u64 {
    if !job.options.refine {
        return 0;
    }
    let cameras = working_cameras(&job.photographs.full(), job.scene);
    let largest = cameras.iter().map(|camera| camera.size.area() as u64).max();
    largest.unwrap_or(0) * BYTES_PER_PIXEL
}

/// Makes the output folder for the views that will have a depth map; [`estimate`] does it too.
///
/// # Errors
/// If the folder is the scene's own, holds depth maps of other views, or cannot be made.
pub fn prepare(job: &DepthJob) -> Result<(), VamvsError> {
    job.output.expect_apart([job.photographs.folder()])?;
    let names = names(&job.scene.views);
    let planned = (0..names.len()).filter(|&view| job.plan.views[view].is_ok());
    let maps: Vec<String> = planned.flat_map(|view| map_names(job, view, &names[view])).collect();
    let maps: Vec<&str> = maps.iter().map(String::as_str).collect();
    job.output.prepare(&maps)?;
    let first = first_folder(job);
    if first == *job.output {
        // A run with two passes may have been stopped here.
        job.output.photometric().remove(&maps)?;
    } else {
        first.expect_apart([job.photographs.folder()])?;
        first.prepare(&maps)?;
    }
    job.output.forget_views()
}

/// The names of a view's depth maps: its own, and with `--fovea` those of its coarser maps before it, with
/// what their size is divided by: `NAME@8` (with cells of 8), `NAME@4`, `NAME`.
fn map_names(job: &DepthJob, view: usize, name: &str) -> Vec<String> {
    let coarser = |scale: &usize| format!("{name}@{scale}");
    match &job.plan.views[view] {
        Ok(ViewPlan { foveated: true, region, .. }) => {
            let scales = job.estimator.scales();
            let (finest, coarse) = scales.split_last().expect("the coarse stage has a scale");
            match region {
                Some(_) => coarse.iter().map(coarser).chain([name.to_owned()]).collect(),
                None => vec![coarser(coarse.first().unwrap_or(finest))],
            }
        }
        _ => vec![name.to_owned()],
    }
}

struct Run<'a> {
    job: &'a DepthJob<'a>,
    names: Vec<String>,
    identity: Identity<'a>,
    features: FeatureCache<'a>,
    refinement: Option<Refinement<'a>>,
    ceiling: Ceiling,
    /// Where the first pass leaves its depth maps.
    first: OutputFolder,
    /// With two passes, the views whose depth maps were there before.
    done: BTreeSet<usize>,
    /// Views whose photographs cannot be used, with the reason.
    unusable: BTreeMap<usize, String>,
    left_out: BTreeSet<usize>,
    summary: DepthSummary,
}

/// What became of a view.
enum Outcome {
    Made,
    Resumed,
    /// Has no depth map, for this reason.
    LeftOut(String),
}

/// A view's depth maps, and what is kept of how they were made.
struct Made {
    maps: Vec<MadeMap>,
    record: Record,
}

/// A depth map with its photograph and, if it was refined, its normals in the world.
struct MadeMap {
    map: DepthMap,
    colour: Grid<Rgb>,
    normals: Option<Grid<[f32; 3]>>,
}

impl Run<'_> {
    fn first_pass(&mut self, on_event: &mut dyn FnMut(Event)) -> Result<(), VamvsError> {
        let needed = self.needed();
        let plans = self.job.plan.views.iter().enumerate().filter(|(view, _)| needed.contains(view));
        let total = plans.clone().filter(|(_, plan)| plan.is_ok()).count();
        let pass = if self.first == *self.job.output { Pass::Final } else { Pass::Photometric };
        let mut done = 0;
        for (view, plan) in plans {
            let name = self.job.scene.views[view].name.clone();
            let begin = Instant::now();
            self.stay_below_ceiling(on_event);
            let outcome = match plan {
                Ok(plan) => self.view(view, plan, on_event)?,
                Err(reason) => Outcome::LeftOut(reason.clone()),
            };
            done += usize::from(plan.is_ok());
            if let Outcome::LeftOut(reason) = outcome {
                self.leave_out(view, LeftOut { view: name, reason }, on_event)?;
                continue;
            }
            let resumed = matches!(outcome, Outcome::Resumed);
            if pass == Pass::Final {
                self.count(resumed);
            }
            on_event(Event::DepthMap { name, pass, done, total, resumed, time: begin.elapsed() });
        }
        Ok(())
    }

    fn count(&mut self, resumed: bool) {
        let count = if resumed { &mut self.summary.resumed } else { &mut self.summary.made };
        *count += 1;
    }

    /// Writes `pair.txt` of the views that have a depth map, and which have none. That none has one is an error.
    fn finish(self) -> Result<DepthSummary, VamvsError> {
        let there: Vec<usize> = (0..self.names.len()).filter(|view| !self.left_out.contains(view)).collect();
        if let (true, Some(LeftOut { view, reason })) = (there.is_empty(), self.summary.skipped.first()) {
            return Err(VamvsError::Request(format!("no depth map could be made: {view}: {reason}")));
        }
        let of_view = |&view: &usize| self.map_names(view).into_iter().map(move |name| (view, name));
        let maps: Vec<(usize, String)> = there.iter().flat_map(of_view).collect();
        let mut numbers: HashMap<usize, Vec<usize>> = HashMap::new();
        // The finest map of a view first.
        let finest_first = maps.iter().enumerate().rev();
        finest_first.for_each(|(number, (view, _))| numbers.entry(*view).or_default().push(number));
        let neighbours = |(view, _): &(usize, String)| -> Vec<Source> {
            let maps_of = |&Source { view, score }: &Source| {
                let maps = numbers.get(&view).into_iter().flatten();
                maps.map(move |&number| Source { view: number, score })
            };
            self.job.plan.neighbours[*view].iter().flat_map(maps_of).collect()
        };
        let names: Vec<&str> = maps.iter().map(|(_, name)| name.as_str()).collect();
        self.job.output.write_pairs(&names, &maps.iter().map(neighbours).collect::<Vec<_>>())?;
        self.job.output.write_left_out(&self.summary.skipped)?;
        Ok(self.summary)
    }

    fn leave_out(
        &mut self,
        view: usize,
        left_out: LeftOut,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<(), VamvsError> {
        on_event(Event::left_out(&left_out));
        self.left_out.insert(view);
        self.summary.skipped.push(left_out);
        self.map_names(view).iter().try_for_each(|name| {
            self.first.discard(name)?;
            self.job.output.discard(name)
        })
    }

    fn map_names(&self, view: usize) -> Vec<String> {
        map_names(self.job, view, &self.names[view])
    }

    /// Makes one depth map unless it is there. Fails only if it cannot be saved.
    fn view(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<Outcome, VamvsError> {
        if self.is_there(view, &self.record(view, &self.usable(plan))) {
            return Ok(Outcome::Resumed);
        }
        let mut profile = Profile::default();
        let made = match self.make(view, plan, &mut profile, on_event) {
            Err(error) if error.is_out_of_memory() => self.make_with_less(view, plan, &mut profile, on_event),
            made => made,
        };
        let Made { maps, record } = match made {
            Ok(made) => made,
            Err(error) => return Ok(Outcome::LeftOut(error.in_full())),
        };
        if self.is_there(view, &record) {
            return Ok(Outcome::Resumed);
        }
        let begin = Instant::now();
        for (name, MadeMap { map, colour, normals }) in self.map_names(view).iter().zip(&maps) {
            let saved = SavedMap { map, range: plan.planes.range, colour, normals: normals.as_ref() };
            self.first.save(name, &saved, &record)?;
        }
        self.summary.writing += begin.elapsed();
        self.summary.profile.add(&profile);
        Ok(Outcome::Made)
    }

    /// Whether there are undamaged depth maps that were made of the same.
    fn is_there(&self, view: usize, record: &Record) -> bool {
        let output = &self.first;
        let same = |saved: Record| saved.made_of == record.made_of;
        let is_saved = |name: &String| output.saved(name).is_some_and(same) && output.is_readable(name);
        !self.job.force && self.map_names(view).iter().all(is_saved)
    }

    /// The plan without source views that are known to be unusable.
    fn usable(&self, plan: &ViewPlan) -> ViewPlan {
        let mut usable = plan.clone();
        usable.sources.retain(|source| !self.unusable.contains_key(source));
        usable
    }

    /// Makes one depth map, with the source views that can be used.
    fn make(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        profile: &mut Profile,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<Made, VamvsError> {
        let reference = self.encoded(view, profile, on_event)?;
        let mut sources = Vec::with_capacity(plan.sources.len());
        let mut used = Vec::with_capacity(plan.sources.len());
        for &source in &plan.sources {
            match self.encoded(source, profile, on_event) {
                Ok(encoded) => {
                    sources.push(encoded);
                    used.push(source);
                }
                Err(error) if error.is_out_of_memory() => return Err(error),
                Err(_) => {} // It is told where its own turn comes.
            }
        }
        if sources.is_empty() {
            return Err(VamvsError::Request("none of its source views can be used".to_owned()));
        }
        let planned_size = self.job.plan.cameras[view].size;
        let region = plan.region.map(|region| rescaled(region, planned_size, reference.photo.camera.size));
        let region = if plan.foveated { region } else { unmasked(region, &reference.photo) };
        let (maps, visibility) = self.maps(&reference, &sources, (plan, region), profile)?;
        if plan.region.is_none() {
            let name = &self.job.scene.views[view].name;
            maps.iter().for_each(|map| warn_of_range_ends(name, map, &plan.planes, on_event));
        }
        let with_colour = |map: DepthMap| {
            let size = map.depth.size();
            let scale = map.scale_in(&reference.photo.camera);
            let colour = image::resize(&covered(&reference.photo.image, size, scale), size);
            MadeMap { map, colour, normals: None }
        };
        let mut maps: Vec<MadeMap> = maps.into_iter().map(with_colour).collect();
        drop(sources);
        if let (Some(refinement), Some(finest)) = (&mut self.refinement, maps.last_mut()) {
            let region = region.filter(|_| plan.region.is_some());
            let region = region.map(|region| shares(region, reference.photo.camera.size));
            // Of a view far from the region there is the coarse map alone, which stays coarse.
            if !plan.foveated || region.is_some() {
                let seed = Seed { map: &finest.map, visibility: &visibility, region };
                *finest = refined_map(refinement.refine(view, &used, &seed)?);
            }
        }
        Ok(Made { maps, record: self.record(view, &self.usable(plan)) })
    }

    /// A photograph's features. What cannot be read is not tried twice.
    fn encoded(
        &mut self,
        view: usize,
        profile: &mut Profile,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<Rc<Encoded>, VamvsError> {
        if let Some(reason) = self.unusable.get(&view) {
            return Err(VamvsError::Request(reason.clone()));
        }
        let encoded = self.features.get(view, profile, on_event);
        if let Err(error) = &encoded
            && !error.is_out_of_memory()
        {
            self.unusable.insert(view, error.in_full());
        }
        encoded
    }

    fn record(&self, view: usize, plan: &ViewPlan) -> Record {
        Record {
            made_of: self.identity.of(
                view,
                plan,
                &self.features.photographs,
                self.refinement.as_ref().map(Refinement::options),
            ),
            planes: Some(plan.planes),
            sources: plan.sources.iter().map(|&source| self.names[source].clone()).collect(),
        }
    }

    fn maps(
        &self,
        reference: &Encoded,
        sources: &[Rc<Encoded>],
        (plan, region): (&ViewPlan, Option<PixelBox>),
        profile: &mut Profile,
    ) -> Result<(Vec<DepthMap>, Vec<Grid<f32>>), VamvsError> {
        let (estimator, planes) = (self.job.estimator, &plan.planes);
        let sources: Vec<&EncodedView> = sources.iter().map(|source| &source.features).collect();
        let photo = &reference.photo;
        let mut visibility = Vec::new();
        let mut maps = match region {
            _ if plan.foveated => {
                estimator.estimate_foveated(&reference.features, &sources, planes, region, profile)?
            }
            None => {
                let (map, seen) = estimator.estimate_seen(&reference.features, &sources, planes, profile)?;
                visibility = seen;
                vec![map]
            }
            Some(region) => {
                let (part, place) = reference.features.cropped(&widened(region, photo.camera.size))?;
                let map = estimator.estimate(&part, &sources, planes, profile)?;
                vec![placed(&map, photo.camera, place, region)]
            }
        };
        if let Some(mask) = &photo.mask {
            maps.iter_mut().for_each(|map| remove_masked(map, mask, map.scale_in(&photo.camera)));
        }
        Ok((maps, visibility))
    }
}

/// A refined depth map with its photograph.
fn refined_map((refined, photo): (Refined, Rc<Photo>)) -> MadeMap {
    let normals = Some(refined.normals_in_world());
    MadeMap { colour: image::resize(&photo.image, refined.map.depth.size()), normals, map: refined.map }
}

fn warn_of_range_ends(name: &str, map: &DepthMap, planes: &Planes, on_event: &mut dyn FnMut(Event)) {
    let last = (planes.count - 1) as f64;
    let confident =
        map.depth.data().iter().zip(map.confidence.data()).filter(|(d, c)| **d > 0.0 && **c > 0.5);
    let (mut total, mut near, mut far) = (0_usize, 0_usize, 0_usize);
    for (depth, _) in confident {
        let share = planes.coordinate(f64::from(*depth)) / last;
        total += 1;
        near += usize::from(share < END_SHARE);
        far += usize::from(share > 1.0 - END_SHARE);
    }
    for (count, end, value) in [(near, "near", planes.range.near), (far, "far", planes.range.far)] {
        if count as f64 > MANY_AT_END * total as f64 && total > 0 {
            on_event(Event::Warning(format!(
                "{name}: {:.0} % of the depths sit at the {end} end {value:.4} of the range: it may be too narrow (--depth-range)",
                100.0 * count as f64 / total as f64
            )));
        }
    }
}
