//! What is done where memory is short.

use super::{Made, Run};
use crate::feature_cache::FeatureCache;
use crate::refinement::Refinement;
use crate::{Event, VamvsError, ViewPlan, memory};
use vamvs_net::Profile;

impl Run<'_> {
    /// Gives memory back and then drops what is kept, where the next depth map would not fit beneath the ceiling.
    pub(super) fn stay_below_ceiling(&mut self, on_event: &mut dyn FnMut(Event)) {
        if self.ceiling.has_room() {
            return;
        }
        memory::give_back();
        if self.ceiling.has_room() {
            return;
        }
        self.features.clear();
        self.refinement.iter_mut().for_each(Refinement::clear);
        memory::give_back();
        if let Some(warning) = self.ceiling.warning() {
            on_event(Event::Warning(warning));
        }
    }

    /// Makes one depth map without features of other views in memory, or if that does not suffice, a smaller one.
    pub(super) fn make_with_less(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        profile: &mut Profile,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<Made, VamvsError> {
        self.features.clear();
        match self.make(view, plan, profile, on_event) {
            Err(error) if error.is_out_of_memory() => self.make_smaller(view, plan, profile, on_event),
            made => made,
        }
    }

    /// Makes one depth map of photographs of half the size, which take a quarter of the memory.
    fn make_smaller(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        profile: &mut Profile,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<Made, VamvsError> {
        let planned = self.job.plan.cameras[view].size;
        let half = self.features.photographs.max_size().min(planned.width.max(planned.height)) / 2;
        let name = &self.job.scene.views[view].name;
        on_event(Event::Warning(format!("{name}: memory does not suffice; tried again at {half} pixels")));
        self.features.clear();
        let (scene, network) = (self.job.scene, self.job.estimator.network());
        let smaller = FeatureCache::new(scene, self.job.photographs.reduced_to(half), network, (0, 1));
        let whole = std::mem::replace(&mut self.features, smaller);
        let made = self.make(view, plan, profile, on_event);
        self.features = whole;
        made
    }
}
