//! The first pass over the views, written to a folder, and the files written at the end of a run.

use std::collections::{BTreeSet, HashMap};
use std::time::Instant;

use vamvs_core::Source;
use vamvs_core::depth_map::is_valid;

use super::maker::{Made, MadeMap, Maker};
use super::{DepthJob, DepthSummary};
use crate::event::{OnEvent, tell};
use crate::identity::Identity;
use crate::order::by_photographs;
use crate::output::{ConfidenceKind, LeftOut, Record, SavedMap, names};
use crate::refinement::Refinement;
use crate::{Event, OutputFolder, Pass, Prepared, VamvsError, ViewPlan};

pub(super) struct Run<'a> {
    pub maker: Maker<'a>,
    pub work: &'a Prepared,
    pub output: &'a OutputFolder,
    pub force: bool,
    pub names: Vec<String>,
    identity: Identity<'a>,
    /// Where the first pass leaves its depth maps.
    pub first: OutputFolder,
    /// With two passes, the views whose final depth maps existed before.
    pub done: BTreeSet<usize>,
    pub left_out: BTreeSet<usize>,
    pub summary: DepthSummary,
}

/// What became of a view.
enum Outcome {
    Made,
    Resumed,
    /// Has no depth map, for this reason.
    LeftOut(String),
}

/// The folder of first-pass maps: the output folder or, with two passes, `photometric/` in it.
pub(super) fn first_folder(job: &DepthJob<'_>) -> OutputFolder {
    if job.work.has_two_passes() { job.output.photometric() } else { job.output.clone() }
}

impl<'a> Run<'a> {
    pub fn new(job: &DepthJob<'a>) -> Self {
        let (names, first) = (names(&job.work.scene.views), first_folder(job));
        Self {
            maker: Maker::new(job.work),
            work: job.work,
            output: job.output,
            force: job.force,
            identity: Identity::new(job.work, [job.output.clone(), first.clone()], names.clone()),
            names,
            first,
            done: BTreeSet::new(),
            left_out: BTreeSet::new(),
            summary: DepthSummary::default(),
        }
    }

    pub fn all_views(mut self, on_event: &mut OnEvent<'_>) -> Result<DepthSummary, VamvsError> {
        let all = (0..self.names.len()).collect();
        if self.work.has_two_passes() {
            self.find_done(&all);
            self.all_first_passes(&all, &all, on_event)?;
            self.geometric_pass(&all, on_event)?;
            self.remove_first()?;
        } else {
            self.first_pass(Pass::Final, &all, on_event)?;
        }
        self.finish()
    }

    /// The first pass over these views.
    pub fn first_pass(
        &mut self,
        pass: Pass,
        views: &BTreeSet<usize>,
        on_event: &mut OnEvent<'_>,
    ) -> Result<(), VamvsError> {
        let work = self.work;
        let total = views.iter().filter(|&&view| work.plan.views[view].is_ok()).count();
        let mut done = 0;
        for view in by_photographs(&work.plan, views) {
            let plan = &work.plan.views[view];
            let name = work.scene.views[view].name.clone();
            let begin = Instant::now();
            self.maker.stay_below_ceiling(on_event)?;
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
            tell(on_event, Event::DepthMap { name, pass, done, total, resumed, time: begin.elapsed() })?;
        }
        Ok(())
    }

    pub fn count(&mut self, resumed: bool) {
        let count = if resumed { &mut self.summary.resumed } else { &mut self.summary.made };
        *count += 1;
    }

    pub fn leave_out(
        &mut self,
        view: usize,
        left_out: LeftOut,
        on_event: &mut OnEvent<'_>,
    ) -> Result<(), VamvsError> {
        tell(on_event, Event::left_out(&left_out))?;
        self.left_out.insert(view);
        self.summary.skipped.push(left_out);
        self.map_names(view).iter().try_for_each(|name| {
            self.first.discard(name)?;
            self.output.discard(name)
        })
    }

    pub fn map_names(&self, view: usize) -> Vec<String> {
        self.work.map_names(view, &self.names[view])
    }

    /// The hash of the plan and of the settings.
    pub fn settings(&self) -> String {
        self.identity.of_settings(self.work)
    }

    /// Makes a view's depth maps unless they exist. Fails only if one cannot be saved or the caller
    /// cancels.
    fn view(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Outcome, VamvsError> {
        if self.is_there(view, &self.planned_record(view, plan)) {
            return Ok(Outcome::Resumed);
        }
        let made = match self.maker.make(view, plan, on_event) {
            Ok(made) => made,
            Err(error) if error.ends_all() => return Err(error),
            Err(error) => return Ok(Outcome::LeftOut(error.with_causes())),
        };
        let record = self.record(view, plan, &made.plan.sources, made.network_size);
        if self.is_there(view, &record) {
            return Ok(Outcome::Resumed);
        }
        self.save(view, &made, &record)?;
        self.warn_of_empty(view, &made, on_event)?;
        Ok(Outcome::Made)
    }

    fn warn_of_empty(&self, view: usize, made: &Made, on_event: &mut OnEvent<'_>) -> Result<(), VamvsError> {
        let maps = self.map_names(view).into_iter().zip(&made.maps);
        let mut empty = maps.filter(|(_, made)| !made.map.depth.data().iter().copied().any(is_valid));
        empty.try_for_each(|(name, _)| {
            let look = "look at its mask, the brightness limits and the region of interest";
            tell(on_event, Event::Warning(format!("{name}: no pixel has a depth; {look}")))
        })
    }

    fn save(&mut self, view: usize, made: &Made, record: &Record) -> Result<(), VamvsError> {
        let begin = Instant::now();
        // Beside the final depth map, also of a first pass: the next one does not change it. What is not asked for would be
        // that of a former depth map.
        let tiles = self.work.options.visibility.then_some(&made.visibility[..]);
        self.output.save_visibility(&self.names[view], tiles)?;
        for (name, MadeMap { map, colour, normals, sigma }) in self.map_names(view).iter().zip(&made.maps) {
            let (normals, sigma) = (normals.as_ref(), sigma.as_ref());
            let saved = SavedMap { map, range: made.plan.planes.range, colour, normals, sigma };
            self.first.save(name, &saved, record)?;
        }
        self.summary.writing += begin.elapsed();
        Ok(())
    }

    /// Whether the view has undamaged depth maps made from the same inputs.
    fn is_there(&self, view: usize, record: &Record) -> bool {
        let output = &self.first;
        let same = |saved: Record| saved.made_of == record.made_of;
        let is_saved = |name: &String| output.saved(name).is_some_and(same) && output.is_readable(name);
        !self.force && self.has_visibility(view) && self.map_names(view).iter().all(is_saved)
    }

    /// Whether the view's predicted visibility is there, if it is asked for.
    pub fn has_visibility(&self, view: usize) -> bool {
        !self.work.options.visibility || self.output.visibility(&self.names[view]).is_file()
    }

    /// The record of a depth map made with all source views not known to be unusable.
    pub fn planned_record(&self, view: usize, plan: &ViewPlan) -> Record {
        let used = self.maker.usable(plan).sources;
        self.record(view, plan, &used, self.maker.features.photographs.max_size())
    }

    /// The record of a depth map that is made with the source views `used`. Its hash is that of all planned ones: which of
    /// them can be used follows from their photographs.
    fn record(&self, view: usize, plan: &ViewPlan, used: &[usize], network_size: usize) -> Record {
        let photographs = self.work.photographs.reduced_to(network_size);
        let refined = self.maker.refinement.as_ref().map(Refinement::options);
        Record {
            made_of: self.identity.of(view, plan, &photographs, refined),
            planes: Some(plan.planes),
            sources: used.iter().map(|&source| self.names[source].clone()).collect(),
            confidence: match refined {
                Some(_) => ConfidenceKind::Refined,
                None => self.work.method.confidence(),
            },
            photograph: self.identity.photograph(view, &photographs),
        }
    }

    /// Writes `pair.txt` for the views with a depth map, and `left-out.json` for the others; an
    /// error if no view has one.
    pub fn finish(self) -> Result<DepthSummary, VamvsError> {
        let there: Vec<usize> = (0..self.names.len()).filter(|view| !self.left_out.contains(view)).collect();
        if let (true, Some(left_out)) = (there.is_empty(), self.summary.skipped.first()) {
            return Err(left_out.clone().of_all());
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
            self.work.plan.neighbours[*view].iter().flat_map(maps_of).collect()
        };
        let names: Vec<&str> = maps.iter().map(|(_, name)| name.as_str()).collect();
        self.output.write_pairs(&names, &maps.iter().map(neighbours).collect::<Vec<_>>())?;
        self.output.write_left_out(&self.summary.skipped)?;
        Ok(self.timed())
    }

    /// The summary with all times.
    pub fn timed(self) -> DepthSummary {
        let Self { mut summary, maker, .. } = self;
        summary.stages = maker.clock.stages();
        summary.reading += maker.features.reading;
        if let Some(refinement) = &maker.refinement {
            summary.reading += refinement.reading;
            summary.refining += refinement.refining;
            summary.refining_again += refinement.refining_again;
        }
        summary
    }
}
