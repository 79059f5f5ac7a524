//! The second pass over the views: each depth map of the first pass is refined with those of its source views.

use std::collections::BTreeSet;
use std::time::Instant;

use super::maker::MadeMap;
use super::run::Run;
use crate::event::{OnEvent, tell};
use crate::geometric::loaded;
use crate::order::by_photographs;
use crate::output::{LeftOut, Record, SavedMap};
use crate::{Event, Pass, VamvsError, ViewPlan};

impl Run<'_> {
    /// Finds the views whose final depth maps exist and were made from the same inputs.
    pub fn find_done(&mut self, views: &BTreeSet<usize>) {
        for &view in views {
            let plan = &self.work.plan.views[view];
            let (Ok(plan), Some(saved)) = (plan, self.output.saved(&self.names[view])) else { continue };
            let is_same = saved.made_of == made_again_of(view, plan, |view| self.planned_hash(view));
            let is_there = self.has_visibility(view) && self.output.is_readable(&self.names[view]);
            if !self.force && is_same && is_there {
                self.done.insert(view);
            }
        }
    }

    /// Makes the first-pass maps of those views of `own` that the final maps of `views` need. Views without a final map
    /// come first: those that are left out need none of their source views.
    pub fn all_first_passes(
        &mut self,
        views: &BTreeSet<usize>,
        own: &BTreeSet<usize>,
        on_event: &mut OnEvent<'_>,
    ) -> Result<(), VamvsError> {
        let missing = views.intersection(own).filter(|view| !self.done.contains(view)).copied().collect();
        self.first_pass(Pass::Photometric, &missing, on_event)?;
        let needed: BTreeSet<usize> = self.needed(views).intersection(own).copied().collect();
        let sources = needed.difference(&missing).copied().collect();
        self.first_pass(Pass::Photometric, &sources, on_event)
    }

    /// The views whose first-pass maps are needed to make the final maps of `views`.
    pub fn needed(&self, views: &BTreeSet<usize>) -> BTreeSet<usize> {
        let missing = views.iter().filter(|view| !self.done.contains(view) && !self.left_out.contains(view));
        let with_sources = |&view: &usize| {
            let plan = self.work.plan.views[view].as_ref();
            std::iter::once(view).chain(plan.map_or(Vec::new(), |plan| plan.sources.clone()))
        };
        missing.flat_map(with_sources).collect()
    }

    /// The hash of what a view's depth map of the first pass is planned to be made of.
    fn planned_hash(&self, view: usize) -> Option<String> {
        let plan = self.work.plan.views[view].as_ref().ok();
        plan.map(|plan| self.planned_record(view, plan).made_of)
    }

    /// Refines the first-pass maps of these views with those of their source views.
    pub fn geometric_pass(
        &mut self,
        views: &BTreeSet<usize>,
        on_event: &mut OnEvent<'_>,
    ) -> Result<(), VamvsError> {
        self.maker.end_method();
        let views = views.iter().copied().filter(|&view| self.work.plan.views[view].is_ok()).collect();
        let views = by_photographs(&self.work.plan, &views);
        let total = views.len();
        for (done, &view) in views.iter().enumerate() {
            if self.left_out.contains(&view) {
                continue;
            }
            let (name, begin) = (self.work.scene.views[view].name.clone(), Instant::now());
            let resumed = self.done.contains(&view);
            self.maker.stay_below_ceiling(on_event)?;
            if !resumed && let Err(error) = self.refine_again(view, on_event)? {
                self.leave_out(view, LeftOut { view: name, reason: error.with_causes() }, on_event)?;
                continue;
            }
            self.count(resumed);
            let (pass, done) = (Pass::Final, done + 1);
            tell(on_event, Event::DepthMap { name, pass, done, total, resumed, time: begin.elapsed() })?;
        }
        Ok(())
    }

    /// Removes the depth maps of the first pass.
    pub fn remove_first(&self) -> Result<(), VamvsError> {
        let planned = (0..self.names.len()).filter(|&view| self.work.plan.views[view].is_ok());
        self.first.remove(&planned.map(|view| self.names[view].as_str()).collect::<Vec<_>>())
    }

    /// The geometric pass of one view. The outer error means that a file could not be written,
    /// or that no view can be made any more.
    fn refine_again(
        &mut self,
        view: usize,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Result<(), VamvsError>, VamvsError> {
        let Ok(plan) = &self.work.plan.views[view] else { return Ok(Ok(())) };
        let first = |view: usize, needed| loaded(&self.first, &self.names[view], needed);
        let MadeMap { map, colour, normals, sigma } =
            match self.maker.refine_again(view, plan, first, on_event) {
                Ok(made) => made,
                Err(error) if error.ends_all() => return Err(error),
                Err(error) => return Ok(Err(error)),
            };
        // A view that was left out has no depth map of the first pass, and never has one with this photograph.
        let saved = |view: usize| self.first.saved(&self.names[view]);
        let first =
            |view: usize| saved(view).map(|record| record.made_of).or_else(|| self.planned_hash(view));
        let planned = self.planned_record(view, plan);
        // The first pass knows which source views could be used; another process may have done it.
        let sources = saved(view).map_or(planned.sources, |record| record.sources);
        let record = Record { made_of: made_again_of(view, plan, first), sources, ..planned };
        let begin = Instant::now();
        let (normals, sigma) = (normals.as_ref(), sigma.as_ref());
        let saved = SavedMap { map: &map, range: plan.planes.range, colour: &colour, normals, sigma };
        self.output.save(&self.names[view], &saved, &record)?;
        self.summary.writing += begin.elapsed();
        Ok(Ok(()))
    }
}

/// The hash of a final depth map: of the hashes of the first-pass maps that it is made from.
fn made_again_of(view: usize, plan: &ViewPlan, first: impl Fn(usize) -> Option<String>) -> String {
    let mut hasher = blake3::Hasher::new();
    for view in std::iter::once(view).chain(plan.sources.iter().copied()) {
        hasher.update(format!("geometric {:?}", first(view)).as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}
