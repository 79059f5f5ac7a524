//! What is done where memory is short.

use super::maker::{Made, Maker};
use crate::event::{OnEvent, tell, warn};
use crate::feature_cache::FeatureCache;
use crate::refinement::Refinement;
use crate::{Event, VamvsError, ViewPlan, memory};

impl Maker<'_> {
    /// If the next depth map would exceed the ceiling, returns free memory to the system and, if
    /// that is not enough, empties the caches.
    pub(super) fn stay_below_ceiling(&mut self, on_event: &mut OnEvent<'_>) -> Result<(), VamvsError> {
        if self.ceiling.has_room() {
            return Ok(());
        }
        memory::give_back();
        if self.ceiling.has_room() {
            return Ok(());
        }
        self.features.clear();
        self.refinement.iter_mut().for_each(Refinement::clear);
        memory::give_back();
        warn(on_event, self.ceiling.warning())
    }

    /// Makes a view's depth maps with an empty feature cache or, if memory still runs out, at half
    /// the size.
    pub(super) fn make_with_less(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Made, VamvsError> {
        self.features.clear();
        match self.make_once(view, plan, on_event) {
            Err(error) if error.is_out_of_memory() => self.make_smaller(view, plan, on_event),
            made => made,
        }
    }

    /// Makes a view's depth maps from photographs of half the size, which take a quarter of the
    /// memory.
    fn make_smaller(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Made, VamvsError> {
        let work = self.work;
        let planned = work.plan.cameras[view].size;
        let half = self.features.photographs.max_size().min(planned.longer_side()) / 2;
        let name = &work.scene.views[view].name;
        let text = format!("{name}: out of memory; trying again with photographs of {half} pixels");
        tell(on_event, Event::Warning(text))?;
        self.features.clear();
        let photographs = work.photographs.reduced_to(half);
        let smaller = FeatureCache::new(&work.scene, photographs, &work.method, 0);
        let whole = std::mem::replace(&mut self.features, smaller);
        let made = self.make_once(view, plan, on_event);
        self.features = whole;
        made
    }
}
