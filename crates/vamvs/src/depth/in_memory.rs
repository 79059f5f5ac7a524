//! Depth maps one after the other, for a program that keeps them itself.

use std::collections::{HashMap, VecDeque};
use std::rc::Rc;
use std::time::Instant;

use super::maker::{MadeMap, Maker};
use crate::event::{OnEvent, tell};
use crate::output::{LeftOut, LoadedMap, names};
use crate::{Event, Pass, Prepared, VamvsError, ViewMap, ViewPlan};

/// The depth maps of the planned views in their order, each made when it is asked for. No file is written.
///
/// A view that can have no depth map gives an [`Event::Warning`] and is skipped; if no view has one, the iterator gives an
/// error with the first reason. With two passes of
/// refinement, first-pass maps stay in memory (20 bytes a pixel) as long as a later view needs
/// them. The iterator ends after an error.
pub struct DepthMaps<'a> {
    work: &'a Prepared,
    maker: Maker<'a>,
    on_event: Box<OnEvent<'a>>,
    names: Vec<String>,
    /// Views still to be done.
    waiting: VecDeque<usize>,
    total: usize,
    ready: VecDeque<ViewMap>,
    /// First-pass depth maps by view, or why there is none.
    first: HashMap<usize, Result<Rc<LoadedMap>, String>>,
    /// For each view, how many remaining views need its first-pass depth map.
    needed: Vec<usize>,
    /// Whether a view has a depth map.
    has_any: bool,
    /// The first view without one.
    first_left_out: Option<LeftOut>,
}

impl Prepared {
    /// The depth maps of the planned views, each made when it is asked for.
    pub fn depth_maps<'a>(&'a self, on_event: Box<OnEvent<'a>>) -> DepthMaps<'a> {
        DepthMaps::new(self, on_event)
    }
}

impl Iterator for DepthMaps<'_> {
    type Item = Result<ViewMap, VamvsError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.ready.is_empty() {
            let Some(view) = self.waiting.pop_front() else {
                let left_out = self.first_left_out.take().filter(|_| !self.has_any)?;
                return Some(Err(left_out.of_all()));
            };
            if let Err(error) = self.view(view) {
                self.waiting.clear();
                self.ready.clear();
                self.first_left_out = None;
                return Some(Err(error));
            }
        }
        self.ready.pop_front().map(Ok)
    }
}

impl<'a> DepthMaps<'a> {
    fn new(work: &'a Prepared, on_event: Box<OnEvent<'a>>) -> Self {
        let waiting: VecDeque<usize> = (0..work.plan.views.len()).collect();
        let mut needed = vec![0; waiting.len()];
        waiting.iter().for_each(|&view| first_of(work, view).for_each(|view| needed[view] += 1));
        Self {
            work,
            maker: Maker::new(work),
            on_event,
            names: names(&work.scene.views),
            total: work.plan.views.iter().flatten().count(),
            waiting,
            ready: VecDeque::new(),
            first: HashMap::new(),
            needed,
            has_any: false,
            first_left_out: None,
        }
    }

    /// Makes the depth maps of one view; fails only if the caller cancels.
    fn view(&mut self, view: usize) -> Result<(), VamvsError> {
        let (work, begin) = (self.work, Instant::now());
        let name = work.scene.views[view].name.clone();
        let made = match &work.plan.views[view] {
            Err(reason) => Err(VamvsError::Request(reason.clone())),
            Ok(plan) if work.has_two_passes() => self.twice_refined(view, plan).map(|map| vec![map]),
            Ok(plan) => self.made(view, plan),
        };
        self.forget_first(view);
        let maps = match made {
            Ok(maps) => maps,
            Err(error) if error.ends_all() => return Err(error),
            Err(error) => {
                let left_out = LeftOut { view: name, reason: error.with_causes() };
                let event = Event::left_out(&left_out);
                self.first_left_out.get_or_insert(left_out);
                return tell(&mut self.on_event, event);
            }
        };
        self.has_any = true;
        let map_names = work.map_names(view, &self.names[view]);
        let neighbours = &work.plan.neighbours[view];
        let with_name = |(name, MadeMap { map, colour, normals, sigma })| {
            let neighbours = neighbours.clone();
            ViewMap { name, view, map, normals, sigma, colour, neighbours }
        };
        self.ready.extend(map_names.into_iter().zip(maps).map(with_name));
        let waiting = self.waiting.iter().filter(|&&view| work.plan.views[view].is_ok()).count();
        let (pass, done, total) = (Pass::Final, self.total - waiting, self.total);
        let event = Event::DepthMap { name, pass, done, total, resumed: false, time: begin.elapsed() };
        tell(&mut self.on_event, event)
    }

    fn made(&mut self, view: usize, plan: &ViewPlan) -> Result<Vec<MadeMap>, VamvsError> {
        self.maker.stay_below_ceiling(&mut self.on_event)?;
        Ok(self.maker.make(view, plan, &mut self.on_event)?.maps)
    }

    /// A view's final depth map. Runs the first pass of the view and its source views before.
    fn twice_refined(&mut self, view: usize, plan: &ViewPlan) -> Result<MadeMap, VamvsError> {
        for view in std::iter::once(view).chain(plan.sources.iter().copied()) {
            self.ensure_first(view)?;
        }
        let (made, own) = (&self.first, view);
        let first = |view: usize, _| match made.get(&view) {
            Some(Ok(map)) => Ok(Some(map.clone())),
            Some(Err(reason)) if view == own => Err(VamvsError::Request(reason.clone())),
            _ => Ok(None),
        };
        self.maker.refine_again(view, plan, first, &mut self.on_event)
    }

    /// Runs the first pass of a view unless that is done; if it fails, keeps the reason.
    fn ensure_first(&mut self, view: usize) -> Result<(), VamvsError> {
        let work = self.work;
        let Ok(plan) = &work.plan.views[view] else { return Ok(()) };
        if self.first.contains_key(&view) {
            return Ok(());
        }
        let made = match self.made(view, plan) {
            Err(VamvsError::Cancelled) => return Err(VamvsError::Cancelled),
            Err(error) => Err(error.with_causes()),
            Ok(maps) => {
                let finest = maps.into_iter().next_back().map(|made| {
                    let MadeMap { map, normals, .. } = made;
                    Rc::new(LoadedMap { map, normals })
                });
                finest.ok_or_else(|| "it has no depth map".to_owned())
            }
        };
        self.first.insert(view, made);
        Ok(())
    }

    /// Drops first-pass maps that no view after this one needs.
    fn forget_first(&mut self, view: usize) {
        for first in first_of(self.work, view) {
            self.needed[first] -= 1;
            if self.needed[first] == 0 {
                self.first.remove(&first);
            }
        }
    }
}

/// The views whose first-pass maps a final depth map needs: the view and its source views.
fn first_of(work: &Prepared, view: usize) -> impl Iterator<Item = usize> {
    let plan = work.plan.views[view].as_ref().ok();
    plan.into_iter().flat_map(move |plan| std::iter::once(view).chain(plan.sources.iter().copied()))
}
