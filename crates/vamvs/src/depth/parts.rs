//! Depth estimation spread over processes, also on different machines that share the folder: each
//! pass over parts of the views, then a last step that completes the folder. The depth maps are
//! byte for byte those of [`super::estimate`].

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use vamvs_core::Part;
use vamvs_fusion::Schedule;

use super::run::{Run, first_folder};
use super::{DepthJob, DepthSummary, planned_maps, prepare_alone};
use crate::event::OnEvent;
use crate::output::Lock;
use crate::output::{LeftOut, make_folder, read_json, remove_unfinished, write_json};
use crate::{OutputFolder, Pass, Prepared, VamvsError};

/// A pass over the views.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DepthStep {
    /// The network and the refinement by photographs alone; the only step if depth maps are not
    /// refined twice.
    Photometric,
    /// The refinement with the depth maps of the source views.
    Geometric,
}

impl fmt::Display for DepthStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Photometric => "photometric",
            Self::Geometric => "geometric",
        })
    }
}

/// What a finished part leaves in the folder `parts/`.
#[derive(Serialize, Deserialize)]
struct PartRecord {
    /// The hash of the plan and of the settings that it was made with.
    made_with: String,
    /// The views of the part that have no depth map.
    left_out: Vec<LeftOut>,
}

/// Does one step for a part of the views. Depth maps that exist already and were made from the same
/// inputs are kept. The geometric step needs the photometric steps of its views and their source
/// views, in as many parts.
///
/// # Errors
/// As [`super::estimate`], or if there are more parts than views, or a photometric step is not done that the geometric one
/// needs.
pub fn estimate_part(
    job: &DepthJob<'_>,
    step: DepthStep,
    part: Part,
    on_event: &mut OnEvent<'_>,
) -> Result<DepthSummary, VamvsError> {
    if step == DepthStep::Geometric && !job.work.has_two_passes() {
        let problem = "there is no geometric step: these depth maps are refined once, or not at all";
        return Err(VamvsError::Request(problem.to_owned()));
    }
    make_folders(job)?;
    let _lock = Lock::shared(job.output.root())?;
    let run = Run::new(job);
    let own = job.work.views_of(part)?;
    let made_with = run.settings();
    let summary = match step {
        DepthStep::Photometric => run.photometric_part(&own, on_event)?,
        DepthStep::Geometric => run.geometric_part(&own, (job, part), on_event)?,
    };
    let record = PartRecord { made_with, left_out: summary.skipped.clone() };
    let file = record_file(job.output, step, part);
    write_json(&file, &record)?;
    Ok(summary)
}

/// Checks that all `parts` parts are done, and writes `pair.txt` and `left-out.json`. The folder is
/// then as [`super::estimate`] leaves it, apart from the records of the parts.
///
/// # Errors
/// If a part is not done, no view has a depth map, or a file cannot be written.
pub fn collect(
    job: &DepthJob<'_>,
    parts: usize,
    on_event: &mut OnEvent<'_>,
) -> Result<DepthSummary, VamvsError> {
    let _lock = prepare_alone(job)?;
    remove_unfinished(&job.output.root().join("parts"))?;
    let run = Run::new(job);
    let (settings, mut reasons) = (run.settings(), BTreeMap::new());
    let last = job.work.steps().last().copied();
    for &step in job.work.steps() {
        for part in Part::all(parts) {
            match read_json::<PartRecord>(&record_file(job.output, step, part)) {
                Ok(record) if record.made_with == settings => {
                    reasons
                        .extend(record.left_out.into_iter().map(|LeftOut { view, reason }| (view, reason)));
                }
                // Once the last step is done, the records of the one before are not needed.
                _ if Some(step) != last => {}
                _ => return Err(not_done(job, step, part)),
            }
        }
    }
    run.collect(&reasons, on_event)
}

fn not_done(job: &DepthJob<'_>, step: DepthStep, part: Part) -> VamvsError {
    let problem = format!(
        "part {part} of the {step} step is not done with these settings: run --step {step} --part {part}"
    );
    VamvsError::Folder { path: job.output.root().to_owned(), problem }
}

/// The file that a finished part leaves.
#[must_use]
pub fn record_file(output: &OutputFolder, step: DepthStep, part: Part) -> PathBuf {
    output.root().join("parts").join(format!("{step}-{}.json", part.to_string().replace('/', "-of-")))
}

/// Makes the folders of depth maps. Other parts may be writing to them.
fn make_folders(job: &DepthJob<'_>) -> Result<(), VamvsError> {
    job.output.expect_apart(job.work.photographs.folder())?;
    let maps = planned_maps(job.work);
    let maps: Vec<&str> = maps.iter().map(String::as_str).collect();
    job.output.make_folders(&maps)?;
    first_folder(job).make_folders(&maps)?;
    Ok(make_folder(&job.output.root().join("parts"))?)
}

impl Prepared {
    /// The steps in which depth maps are made, the first one first.
    #[must_use]
    pub fn steps(&self) -> &'static [DepthStep] {
        if self.has_two_passes() {
            &[DepthStep::Photometric, DepthStep::Geometric]
        } else {
            &[DepthStep::Photometric]
        }
    }

    /// The views of a part. Views that see the same surfaces are mostly in the same part.
    ///
    /// # Errors
    /// If there are more parts than views, or the plan names a source view that does not exist.
    pub fn views_of(&self, part: Part) -> Result<BTreeSet<usize>, VamvsError> {
        let schedule = self.schedule(part.count())?;
        Ok(schedule.confirmed_in(part).iter().copied().collect())
    }

    /// The parts with the views of each.
    ///
    /// # Errors
    /// As [`Prepared::views_of`].
    pub fn parts(&self, count: usize) -> Result<Vec<(Part, BTreeSet<usize>)>, VamvsError> {
        let schedule = self.schedule(count)?;
        let views = |part: Part| (part, schedule.confirmed_in(part).iter().copied().collect());
        Ok(Part::all(count).map(views).collect())
    }

    /// The order of the views, of which a part takes consecutive ones.
    fn schedule(&self, parts: usize) -> Result<Schedule, VamvsError> {
        let plans = &self.plan.views;
        if parts > plans.len() {
            let problem = format!("expected at most as many parts as the {} views, got {parts}", plans.len());
            return Err(VamvsError::Request(problem));
        }
        let sources = plans.iter().map(|plan| plan.as_ref().map_or(Vec::new(), |plan| plan.sources.clone()));
        Ok(Schedule::new(&sources.collect::<Vec<_>>(), plans.len())?)
    }
}

impl Run<'_> {
    fn photometric_part(
        mut self,
        own: &BTreeSet<usize>,
        on_event: &mut OnEvent<'_>,
    ) -> Result<DepthSummary, VamvsError> {
        if self.work.has_two_passes() {
            let users = self.users(own);
            self.find_done(&users);
            self.all_first_passes(&users, own, on_event)?;
        } else {
            self.first_pass(Pass::Final, own, on_event)?;
        }
        Ok(self.timed())
    }

    fn geometric_part(
        mut self,
        own: &BTreeSet<usize>,
        (job, part): (&DepthJob<'_>, Part),
        on_event: &mut OnEvent<'_>,
    ) -> Result<DepthSummary, VamvsError> {
        self.find_done(own);
        let missing: BTreeSet<usize> = own.difference(&self.done).copied().collect();
        self.left_out = self.without_first(&missing, (job, part))?;
        // Those that are left out need none of their source views.
        let sources = self.needed(own).difference(&missing).copied().collect();
        self.without_first(&sources, (job, part))?;
        self.geometric_pass(own, on_event)?;
        Ok(self.timed())
    }

    /// Those of the `needed` views that their photometric parts have left out. It is an error if one of these parts is not
    /// done with the same settings, or another view has no undamaged photometric depth map.
    fn without_first(
        &self,
        needed: &BTreeSet<usize>,
        (job, part): (&DepthJob<'_>, Part),
    ) -> Result<BTreeSet<usize>, VamvsError> {
        let is_missing = |&view: &usize| {
            let name = &self.names[view];
            self.work.plan.views[view].is_ok()
                && !(self.first.saved(name).is_some() && self.first.is_readable(name))
        };
        let mut left_out = BTreeSet::new();
        if needed.is_empty() {
            return Ok(left_out);
        }
        let settings = self.settings();
        for (part, views) in self.work.parts(part.count())? {
            let needed: Vec<usize> = views.intersection(needed).copied().collect();
            if needed.is_empty() {
                continue;
            }
            let record = read_json::<PartRecord>(&record_file(job.output, DepthStep::Photometric, part)).ok();
            let record = record.filter(|record| record.made_with == settings);
            let record = record.ok_or_else(|| not_done(job, DepthStep::Photometric, part))?;
            let is_told = |view: &usize| {
                record.left_out.iter().any(|left| left.view == self.work.scene.views[*view].name)
            };
            let missing: Vec<usize> = needed.into_iter().filter(is_missing).collect();
            if !missing.iter().all(is_told) {
                return Err(not_done(job, DepthStep::Photometric, part));
            }
            left_out.extend(missing);
        }
        Ok(left_out)
    }

    /// The views of `own`, and those that have one of them as a source view.
    fn users(&self, own: &BTreeSet<usize>) -> BTreeSet<usize> {
        let uses = |sources: &[usize]| sources.iter().any(|source| own.contains(source));
        let plans = self.work.plan.views.iter().enumerate();
        let users = plans
            .filter(|(view, plan)| own.contains(view) || plan.as_ref().is_ok_and(|plan| uses(&plan.sources)));
        users.map(|(view, _)| view).collect()
    }

    /// Completes a run whose parts are done; `reasons` tells why views have no depth map.
    fn collect(
        mut self,
        reasons: &BTreeMap<String, String>,
        on_event: &mut OnEvent<'_>,
    ) -> Result<DepthSummary, VamvsError> {
        for view in 0..self.names.len() {
            let is_there = self.work.plan.views[view].is_ok()
                && self.map_names(view).iter().all(|name| self.output.saved(name).is_some());
            if is_there {
                self.count(true);
                continue;
            }
            let name = self.work.scene.views[view].name.clone();
            let reason = match &self.work.plan.views[view] {
                Err(reason) => reason.clone(),
                Ok(_) => reasons.get(&name).cloned().unwrap_or_else(|| "its depth map is missing".to_owned()),
            };
            self.leave_out(view, LeftOut { view: name, reason }, on_event)?;
        }
        if self.work.has_two_passes() {
            self.remove_first()?;
        }
        self.finish()
    }
}
