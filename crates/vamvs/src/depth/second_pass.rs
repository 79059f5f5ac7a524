//! The second pass over the views: each depth map of the first pass is refined with those of its source views.

use std::collections::BTreeSet;
use std::rc::Rc;
use std::time::Instant;

use super::maker::MadeMap;
use super::run::Run;
use crate::event::{OnEvent, tell};
use crate::output::{LeftOut, Record, SavedMap};
use crate::{Event, Pass, VamvsError, ViewPlan};

impl Run<'_> {
    /// Finds the views whose depth maps are there, made of the same as they would be now.
    pub fn find_done(&mut self) {
        for (view, plan) in self.work.plan.views.iter().enumerate() {
            let (Ok(plan), Some(saved)) = (plan, self.output.saved(&self.names[view])) else { continue };
            let planned = |view: usize| {
                let plan = self.work.plan.views[view].as_ref().ok();
                plan.map(|plan| self.planned_record(view, plan).made_of)
            };
            let is_same = saved.made_of == made_again_of(view, plan, planned);
            if !self.force && is_same && self.output.is_readable(&self.names[view]) {
                self.done.insert(view);
            }
        }
    }

    /// The views whose depth maps of the first pass are needed.
    pub fn needed(&self) -> BTreeSet<usize> {
        let plans = self.work.plan.views.iter().enumerate();
        let missing = plans.filter(|(view, _)| !self.done.contains(view));
        let with_sources = |(view, plan): (usize, &Result<ViewPlan, String>)| {
            let sources = plan.as_ref().map_or(Vec::new(), |plan| plan.sources.clone());
            std::iter::once(view).chain(sources)
        };
        missing.flat_map(with_sources).collect()
    }

    /// Refines the depth maps of the first pass with those of the source views, and removes them.
    pub fn geometric_pass(&mut self, on_event: &mut OnEvent<'_>) -> Result<(), VamvsError> {
        self.maker.end_network();
        let planned = (0..self.names.len()).filter(|&view| self.work.plan.views[view].is_ok());
        let views: Vec<usize> = planned.collect();
        let total = views.len();
        for (done, &view) in views.iter().enumerate() {
            if self.left_out.contains(&view) {
                continue;
            }
            let (name, begin) = (self.work.scene.views[view].name.clone(), Instant::now());
            let resumed = self.done.contains(&view);
            if !resumed && let Err(error) = self.refine_again(view)? {
                self.leave_out(view, LeftOut { view: name, reason: error.in_full() }, on_event)?;
                continue;
            }
            self.count(resumed);
            let (pass, done) = (Pass::Final, done + 1);
            tell(on_event, Event::DepthMap { name, pass, done, total, resumed, time: begin.elapsed() })?;
        }
        let names: Vec<&str> = views.iter().map(|&view| self.names[view].as_str()).collect();
        self.first.remove(&names)
    }

    /// The geometric pass of one view. The outer error is one of writing.
    fn refine_again(&mut self, view: usize) -> Result<Result<(), VamvsError>, VamvsError> {
        let Ok(plan) = &self.work.plan.views[view] else { return Ok(Ok(())) };
        let first = |view: usize| self.first.load(&self.names[view]).map(Rc::new);
        let MadeMap { map, colour, normals } = match self.maker.refine_again(view, plan, first) {
            Ok(made) => made,
            Err(error) => return Ok(Err(error)),
        };
        let first = |view: usize| self.first.saved(&self.names[view]).map(|record| record.made_of);
        let record = Record { made_of: made_again_of(view, plan, first), ..self.planned_record(view, plan) };
        let begin = Instant::now();
        let saved =
            SavedMap { map: &map, range: plan.planes.range, colour: &colour, normals: normals.as_ref() };
        self.output.save(&self.names[view], &saved, &record)?;
        self.summary.writing += begin.elapsed();
        Ok(Ok(()))
    }
}

/// The hash of what makes the depth map of the geometric pass, from those of the first pass.
fn made_again_of(view: usize, plan: &ViewPlan, first: impl Fn(usize) -> Option<String>) -> String {
    let mut hasher = blake3::Hasher::new();
    for view in std::iter::once(view).chain(plan.sources.iter().copied()) {
        hasher.update(format!("geometric {:?}", first(view)).as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}
