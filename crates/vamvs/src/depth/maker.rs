//! Makes the depth maps of single views from photographs. The caller stores them.

use std::collections::BTreeMap;
use std::rc::Rc;

use rayon::prelude::*;
use vamvs_core::depth_range::RangeOrigin;
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, DepthRange, Grid, Photo, Planes, Rgb};
use vamvs_io::image;
use vamvs_refine::{RefineOptions, Refined};

use super::region::{covered, remove_masked, rescaled, unmasked};
use crate::ceiling::Ceiling;
use crate::event::{OnEvent, tell, warn};
use crate::feature_cache::{FeatureCache, Seen};
use crate::fit::most_bytes;
use crate::geometric::Needed;
use crate::memory::{self, KeptMemory};
use crate::method::{Clock, Encoded, Estimated, Task};
use crate::output::LoadedMap;
use crate::photographs::working_cameras;
use crate::place::peak_bytes;
use crate::refinement::{Refinement, Seed};
use crate::region::shares;
use crate::{Event, Prepared, VamvsError, ViewPlan};

/// A depth within this share of the planes from either end counts as being at that end.
const END_SHARE: f64 = 0.01;

/// Above this share of depths at one end of the range, a warning is given.
const MANY_AT_END: f64 = 0.25;

/// Makes depth maps; keeps what the next ones need too, as far as memory allows.
pub(super) struct Maker<'a> {
    pub work: &'a Prepared,
    pub features: FeatureCache<'a>,
    pub refinement: Option<Refinement<'a>>,
    /// Where the method's time went.
    pub clock: Clock,
    pub ceiling: Ceiling,
    /// Views whose photographs cannot be used, with the reason.
    unusable: BTreeMap<usize, String>,
    _kept: Option<KeptMemory>,
}

/// A view's depth maps, the coarsest first, and what they were made of.
pub(super) struct Made {
    pub maps: Vec<MadeMap>,
    /// The visibility of the view's pixels in each of these source views, as far as the network predicts it.
    pub visibility: Vec<Grid<f32>>,
    /// The plan with the source views that could be used.
    pub plan: ViewPlan,
    /// Largest longer side of the photographs that the method saw, pixels.
    pub network_size: usize,
}

/// What the method found in photographs of one size.
struct Found {
    reference: Rc<Encoded>,
    /// The source views that could be used.
    used: Vec<usize>,
    /// Depth maps, the coarsest first.
    maps: Vec<DepthMap>,
    visibility: Vec<Grid<f32>>,
    /// The part of the reference view's photograph in which depth is wanted.
    region: Option<PixelBox>,
}

/// A depth map with its photograph and, if it was refined, its normals in the world and the standard deviations of its
/// depths.
pub(super) struct MadeMap {
    pub map: DepthMap,
    pub colour: Grid<Rgb>,
    pub normals: Option<Grid<[f32; 3]>>,
    pub sigma: Option<Grid<f32>>,
}

impl Prepared {
    /// Whether depth maps are refined twice; with `--fovea` they are not.
    pub(super) fn has_two_passes(&self) -> bool {
        self.options.refine && self.options.geometric && !self.options.fovea
    }

    /// A final refined map, with the calibrated confidence if the method has a calibration. The second pass begins with
    /// confidences as they are.
    fn calibrated(&self, mut made: MadeMap) -> MadeMap {
        if let Some(calibration) = self.method.refined_calibration() {
            let MadeMap { map: DepthMap { depth, confidence, .. }, .. } = &mut made;
            confidence.data_mut().par_iter_mut().zip(depth.data()).for_each(|(confidence, depth)| {
                if *depth > 0.0 {
                    *confidence = calibration.at(f64::from(*confidence)) as f32;
                }
            });
        }
        made
    }

    /// The names of a view's depth maps, the coarsest first. With `--fovea`, coarser maps come
    /// before the finest, `name`, and their names end with their scale: `NAME@8` (with a coarse
    /// stride of 8), `NAME@4`, `NAME`.
    pub(super) fn map_names(&self, view: usize, name: &str) -> Vec<String> {
        let coarser = |scale: &usize| format!("{name}@{scale}");
        match &self.plan.views[view] {
            Ok(ViewPlan { foveated: true, region, .. }) => {
                let scales = self.method.scales();
                let (finest, coarse) = scales.split_last().expect("the coarse stage has a scale");
                match region {
                    Some(_) => coarse.iter().map(coarser).chain([name.to_owned()]).collect(),
                    None => vec![coarser(coarse.first().unwrap_or(finest))],
                }
            }
            _ => vec![name.to_owned()],
        }
    }

    /// What refining the largest depth map takes, bytes.
    fn refinement_bytes(&self) -> u64 {
        if !self.options.refine {
            return 0;
        }
        let cameras = working_cameras(&self.photographs.full(), &self.scene);
        let bytes = |size| peak_bytes(size, &RefineOptions::default(), self.method.device());
        cameras.iter().map(|camera| bytes(camera.size)).max().unwrap_or(0)
    }
}

impl<'a> Maker<'a> {
    pub fn new(work: &'a Prepared) -> Self {
        let limit = work.options.max_memory;
        let memory = work.method.memory(limit);
        let for_method = most_bytes(&work.plan, &work.method);
        let for_maps = memory.in_process(for_method).max(work.refinement_bytes());
        // Features are where the network is. In the process refinement needs room beside them.
        let for_others = for_method.max(memory.in_process(for_maps));
        let capacity = usize::try_from(memory.for_features(for_others)).unwrap_or(usize::MAX);
        let (scene, photographs) = (&work.scene, &work.photographs);
        let two_passes = work.has_two_passes();
        Self {
            work,
            features: FeatureCache::new(scene, photographs.clone(), &work.method, capacity),
            refinement: work
                .options
                .refine
                .then(|| Refinement::new(scene, photographs, &work.method, two_passes)),
            clock: work.method.clock(),
            ceiling: Ceiling::new(limit, for_maps),
            unusable: BTreeMap::new(),
            _kept: work.method.keep_memory(),
        }
    }

    /// Makes a view's depth maps; if memory runs out, tries again with less, then at half the size.
    pub fn make(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Made, VamvsError> {
        match self.make_once(view, plan, on_event) {
            Err(error) if error.is_out_of_memory() => self.make_with_less(view, plan, on_event),
            made => made,
        }
    }

    /// Refines a view's depth map once more with those of its source views; `first` gives the
    /// first-pass maps.
    pub fn refine_again(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        first: impl Fn(usize, Needed) -> Result<Option<Rc<LoadedMap>>, VamvsError>,
        on_event: &mut OnEvent<'_>,
    ) -> Result<MadeMap, VamvsError> {
        let refinement = self.refinement.as_mut().expect("there are two passes of refinement");
        let refined = refinement.refine_again(view, &plan.sources, first)?;
        warn(on_event, refinement.warning())?;
        Ok(self.work.calibrated(refined_map(refined)))
    }

    /// Drops all features; the method is not needed any more.
    pub fn end_method(&mut self) {
        self.features.clear();
        memory::give_back();
    }

    /// The plan without source views that are known to be unusable.
    pub fn usable(&self, plan: &ViewPlan) -> ViewPlan {
        let mut usable = plan.clone();
        usable.sources.retain(|source| !self.unusable.contains_key(source));
        usable
    }

    /// Makes a view's depth maps with the source views that can be used.
    pub fn make_once(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Made, VamvsError> {
        self.features.keep_only(&[&[view], &plan.sources[..]].concat());
        let Found { reference, used, maps, visibility, region } = self.find_in_range(view, plan, on_event)?;
        let mut maps: Vec<MadeMap> =
            maps.into_iter().map(|map| MadeMap::new(map, &reference.photo)).collect();
        if let (Some(refinement), Some(finest)) = (&mut self.refinement, maps.last_mut()) {
            let of_image = |region: PixelBox| shares(region, reference.photo.camera.size);
            let knows = region.map_or([[0.0, 0.0], [1.0, 1.0]], of_image);
            let region = region.filter(|_| plan.region.is_some()).map(of_image);
            // A view that does not see the region has only a coarse map, which is not refined.
            if !plan.foveated || region.is_some() {
                let knows_surfaces = self.work.method.knows_surfaces().then_some(knows);
                let seed = Seed { map: &finest.map, visibility: &visibility, region, knows_surfaces };
                let refined = refined_map(refinement.refine(view, &used, &seed)?);
                warn(on_event, refinement.warning())?;
                *finest = if self.work.has_two_passes() { refined } else { self.work.calibrated(refined) };
            }
        }
        let network_size = self.features.photographs.max_size();
        Ok(Made { maps, visibility, plan: self.usable(plan), network_size })
    }

    /// A view's depth map by the method alone, the finest, in the planned range.
    pub fn draft(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<DepthMap, VamvsError> {
        self.features.keep_only(&[&[view], &plan.sources[..]].concat());
        let maps = self.find(view, plan, on_event)?.maps;
        Ok(maps.into_iter().next_back().expect("a method makes at least one depth map"))
    }

    /// A view's depth maps by the method alone. Where depths crowd at an end of a range that was estimated, they are made again with a
    /// wider one, once.
    fn find_in_range(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Found, VamvsError> {
        let found = self.find(view, plan, on_event)?;
        let name = &self.work.scene.views[view].name;
        let crowded = |found: &Found, planes: &Planes| {
            found
                .maps
                .last()
                .filter(|_| plan.region.is_none())
                .map_or([None; 2], |map| crowded_ends(map, planes))
        };
        let ends = crowded(&found, &plan.planes);
        let is_estimated =
            matches!(plan.origin, Some(RangeOrigin::Points | RangeOrigin::Geometry | RangeOrigin::Draft));
        if !is_estimated || plan.foveated || ends == [None; 2] {
            warn(on_event, warn_of_ends(name, ends, plan.planes.range))?;
            return Ok(found);
        }
        let range = plan.planes.range.widened(ends.map(|end| end.is_some()));
        // No more planes than the view with most has, for which there is memory.
        let most = self.work.plan.views.iter().flatten().map(|plan| plan.planes.count).max();
        let planes = match self.work.options.planes {
            Some(_) => Planes { range, ..plan.planes },
            None => plan.planes.for_range(range, most.unwrap_or(plan.planes.count)),
        };
        let shares = ends.map(|share| 100.0 * share.unwrap_or(0.0));
        tell(
            on_event,
            Event::Warning(format!(
                "{name}: {:.0} and {:.0} % of the depths are at the near and the far end of the range from {}, {:.4} to {:.4}: it is made \
             again with {:.4} to {:.4}",
                shares[0],
                shares[1],
                plan.origin.expect("an estimated range has an origin"),
                plan.planes.range.near,
                plan.planes.range.far,
                range.near,
                range.far
            )),
        )?;
        drop(found);
        let wider = ViewPlan { planes, ..plan.clone() };
        let found = self.find(view, &wider, on_event)?;
        let ends = crowded(&found, &wider.planes);
        warn(on_event, warn_of_ends(name, ends, range))?;
        Ok(found)
    }

    /// A view's depth maps by the method alone. A small photograph that would be enlarged is seen as it is too, by methods to which
    /// that makes a difference; of the depth maps those stay that the method is surer of. Sharp photographs have more to find when they are enlarged, in
    /// noisy ones a surface without texture is smaller, and more is seen of it, as they are.
    fn find(
        &mut self,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Found, VamvsError> {
        let planned = self.find_in(Seen::Planned, view, plan, on_event)?;
        let enlarged_by = self.features.photographs.enlarged_by(&self.work.scene.views[view].camera);
        if enlarged_by <= 1.0 || !self.work.method.compares_sizes() {
            return Ok(planned);
        }
        let mut smaller = plan.clone();
        if self.work.options.planes.is_none() {
            smaller.planes = plan.planes.for_smaller(1.0 / enlarged_by);
        }
        let as_it_is = self.find_in(Seen::AsItIs, view, &smaller, on_event)?;
        Ok(if as_it_is.confidence() > planned.confidence() { as_it_is } else { planned })
    }

    /// A view's depth maps by the method alone, in photographs of one size.
    fn find_in(
        &mut self,
        seen: Seen,
        view: usize,
        plan: &ViewPlan,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Found, VamvsError> {
        let reference = self.encoded((view, seen), on_event)?;
        let mut sources = Vec::with_capacity(plan.sources.len());
        let mut used = Vec::with_capacity(plan.sources.len());
        for &source in &plan.sources {
            match self.encoded((source, seen), on_event) {
                Ok(encoded) => {
                    sources.push(encoded);
                    used.push(source);
                }
                Err(error) if error.ends_run() => return Err(error),
                Err(_) => {} // Reported when the view itself is processed.
            }
        }
        if sources.is_empty() {
            return Err(VamvsError::Request("none of its source views can be used".to_owned()));
        }
        let planned_size = self.work.plan.cameras[view].size;
        let region = plan.region.map(|region| rescaled(region, planned_size, reference.photo.camera.size));
        let region = if plan.foveated { region } else { unmasked(region, &reference.photo) };
        let (maps, visibility) = self.maps(&reference, &sources, (plan, region))?;
        Ok(Found { reference, used, maps, visibility, region })
    }

    /// A photograph's features. A photograph that could not be read is not tried again.
    fn encoded(
        &mut self,
        (view, seen): (usize, Seen),
        on_event: &mut OnEvent<'_>,
    ) -> Result<Rc<Encoded>, VamvsError> {
        if let Some(reason) = self.unusable.get(&view) {
            return Err(VamvsError::Request(reason.clone()));
        }
        let encoded = self.features.get((view, seen), &mut self.clock, on_event);
        if let Err(error) = &encoded
            && !error.ends_run()
        {
            self.unusable.insert(view, error.with_causes());
        }
        encoded
    }

    fn maps(
        &mut self,
        reference: &Encoded,
        sources: &[Rc<Encoded>],
        (plan, region): (&ViewPlan, Option<PixelBox>),
    ) -> Result<Estimated, VamvsError> {
        let sources: Vec<&Encoded> = sources.iter().map(Rc::as_ref).collect();
        let task = Task { reference, sources: &sources, plan, region };
        let (mut maps, visibility) = self.work.method.estimate(&task, &mut self.clock)?;
        let photo = &reference.photo;
        if let Some(mask) = &photo.mask {
            maps.iter_mut().for_each(|map| remove_masked(map, mask, map.scale_in(&photo.camera)));
        }
        Ok((maps, visibility))
    }
}

impl Found {
    /// How sure the method is of the finest depth map on the whole: the mean confidence of its depths.
    fn confidence(&self) -> f64 {
        let Some(DepthMap { depth, confidence, .. }) = self.maps.last() else { return 0.0 };
        let known = depth.data().iter().zip(confidence.data()).filter(|(depth, _)| **depth > 0.0);
        let (sum, count) = known.fold((0.0, 0), |(sum, count), (_, c)| (sum + f64::from(*c), count + 1));
        sum / f64::from(count.max(1))
    }
}

impl MadeMap {
    /// An unrefined depth map, with the photograph at its size.
    fn new(map: DepthMap, photo: &Photo) -> Self {
        let size = map.depth.size();
        let scale = map.scale_in(&photo.camera);
        let colour = image::resize(&covered(&photo.image, size, scale), size);
        Self { map, colour, normals: None, sigma: None }
    }
}

/// A refined depth map with its photograph.
fn refined_map((refined, photo): (Refined, Rc<Photo>)) -> MadeMap {
    let Refined { map, normals, sigma } = refined.in_world();
    let colour = image::resize(&photo.image, map.depth.size());
    MadeMap { map, colour, normals: Some(normals), sigma: Some(sigma) }
}

/// The share of the confident depths at each end of the range, near and far, if many are there.
fn crowded_ends(map: &DepthMap, planes: &Planes) -> [Option<f64>; 2] {
    let last = (planes.count - 1) as f64;
    let confident =
        map.depth.data().iter().zip(map.confidence.data()).filter(|(d, c)| **d > 0.0 && **c > 0.5);
    let (mut total, mut ends) = (0_usize, [0_usize; 2]);
    for (depth, _) in confident {
        let share = planes.coordinate(f64::from(*depth)) / last;
        total += 1;
        ends[0] += usize::from(share < END_SHARE);
        ends[1] += usize::from(share > 1.0 - END_SHARE);
    }
    ends.map(|count| Some(count as f64 / total as f64).filter(|share| *share > MANY_AT_END))
}

/// A warning that a depth range may be too narrow.
fn warn_of_ends(name: &str, ends: [Option<f64>; 2], range: DepthRange) -> Option<String> {
    let of = |(share, end, value): (Option<f64>, &str, f64)| {
        Some(format!("{:.0} % of the depths are at the {end} end ({value:.4})", 100.0 * share?))
    };
    let found: Vec<String> =
        [(ends[0], "near", range.near), (ends[1], "far", range.far)].into_iter().filter_map(of).collect();
    (!found.is_empty()).then(|| {
        format!("{name}: {} of the range, which may be too narrow (--depth-range)", found.join(" and "))
    })
}
