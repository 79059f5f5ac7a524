//! The second pass over the views: each depth map of the first pass is refined with those of its source views.

use std::collections::BTreeSet;
use std::time::Instant;

use super::{MadeMap, Run, refined_map};
use crate::output::{LeftOut, Record, SavedMap};
use crate::{Event, Pass, VamvsError, ViewPlan, memory};

impl Run<'_> {
    /// Finds the views whose depth maps are there, made of the same as they would be now.
    pub(super) fn find_done(&mut self) {
        for (view, plan) in self.job.plan.views.iter().enumerate() {
            let (Ok(plan), Some(saved)) = (plan, self.job.output.saved(&self.names[view])) else { continue };
            let planned = |view: usize| {
                let plan = self.job.plan.views[view].as_ref().ok();
                plan.map(|plan| self.record(view, plan).made_of)
            };
            let is_same = saved.made_of == self.made_again_of(view, plan, planned);
            if !self.job.force && is_same && self.job.output.is_readable(&self.names[view]) {
                self.done.insert(view);
            }
        }
    }

    /// The hash of what makes the depth map of the geometric pass, from those of the first pass.
    fn made_again_of(&self, view: usize, plan: &ViewPlan, first: impl Fn(usize) -> Option<String>) -> String {
        let mut hasher = blake3::Hasher::new();
        for view in std::iter::once(view).chain(plan.sources.iter().copied()) {
            hasher.update(format!("geometric {:?}", first(view)).as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// The views whose depth maps of the first pass are needed.
    pub(super) fn needed(&self) -> BTreeSet<usize> {
        let plans = self.job.plan.views.iter().enumerate();
        let missing = plans.filter(|(view, _)| !self.done.contains(view));
        let with_sources = |(view, plan): (usize, &Result<ViewPlan, String>)| {
            let sources = plan.as_ref().map_or(Vec::new(), |plan| plan.sources.clone());
            std::iter::once(view).chain(sources)
        };
        missing.flat_map(with_sources).collect()
    }

    /// Refines the depth maps of the first pass with those of the source views, and removes them.
    pub(super) fn geometric_pass(&mut self, on_event: &mut dyn FnMut(Event)) -> Result<(), VamvsError> {
        self.features.clear();
        memory::give_back();
        let planned = (0..self.names.len()).filter(|&view| self.job.plan.views[view].is_ok());
        let views: Vec<usize> = planned.collect();
        let total = views.len();
        for (done, &view) in views.iter().enumerate() {
            if self.left_out.contains(&view) {
                continue;
            }
            let (name, begin) = (self.job.scene.views[view].name.clone(), Instant::now());
            let resumed = self.done.contains(&view);
            if !resumed && let Err(error) = self.refine_again(view)? {
                self.leave_out(view, LeftOut { view: name, reason: error.in_full() }, on_event)?;
                continue;
            }
            self.count(resumed);
            let (pass, done) = (Pass::Final, done + 1);
            on_event(Event::DepthMap { name, pass, done, total, resumed, time: begin.elapsed() });
        }
        let names: Vec<&str> = views.iter().map(|&view| self.names[view].as_str()).collect();
        self.first.remove(&names)
    }

    /// The geometric pass of one view. The outer error is one of writing.
    fn refine_again(&mut self, view: usize) -> Result<Result<(), VamvsError>, VamvsError> {
        let (Ok(plan), Some(refinement)) = (&self.job.plan.views[view], &mut self.refinement) else {
            return Ok(Ok(()));
        };
        let refined = match refinement.refine_again(view, &plan.sources, (&self.first, &self.names)) {
            Ok(refined) => refined,
            Err(error) => return Ok(Err(error)),
        };
        let MadeMap { map, colour, normals } = refined_map(refined);
        let first = |view: usize| self.first.saved(&self.names[view]).map(|record| record.made_of);
        let made_of = self.made_again_of(view, plan, first);
        let record = Record { made_of, ..self.record(view, &self.usable(plan)) };
        let begin = Instant::now();
        let saved =
            SavedMap { map: &map, range: plan.planes.range, colour: &colour, normals: normals.as_ref() };
        self.job.output.save(&self.names[view], &saved, &record)?;
        self.summary.writing += begin.elapsed();
        Ok(Ok(()))
    }
}
