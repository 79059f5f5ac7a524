//! What will be done for each view, decided before anything is computed.

use serde::{Deserialize, Serialize};
use vamvs_core::depth_range::{self, RangeOrigin};
use vamvs_core::roi::PixelBox;
use vamvs_core::view_selection;
use vamvs_core::{DepthRange, Pinhole, Planes, Scene, SeenPoints, Size, Source};

use crate::options::MIN_SIZE;
use crate::photographs::working_cameras;
use crate::{DepthOptions, Photographs, Stretching, VamvsError};

/// Number of neighbours stored for each view; fusion uses as many of them as its options say.
const NEIGHBOURS: usize = 30;

/// Least size of the shorter side of a photograph that a network takes, pixels.
const SHORTEST_SIDE: usize = 32;

/// What will be done for one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewPlan {
    /// Source views, best first.
    pub sources: Vec<usize>,
    /// The planes of the sweep.
    pub planes: Planes,
    /// Where the depth range comes from; `None` if the user gave it.
    pub origin: Option<RangeOrigin>,
    /// The part of the image in which depth is wanted, pixels at working size; `None` for all of it
    /// or, if foveated, none of it.
    pub region: Option<PixelBox>,
    /// Whether coarse depth is wanted outside of the region too.
    pub foveated: bool,
}

/// What will be done.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The undistorted cameras at working size.
    pub cameras: Vec<Pinhole>,
    /// For each view what will be done, or why it is left out.
    pub views: Vec<Result<ViewPlan, String>>,
    /// For each view, other views that may see the same surfaces, best first.
    pub neighbours: Vec<Vec<Source>>,
}

/// Chooses source views, depth ranges and planes. Neighbouring planes are about `plane_step` pixels apart
/// in the source views, unless the options give their number.
///
/// # Errors
/// If an option is invalid, the scene contradicts itself ([`Scene::validate`]), or no view has another one that sees the same surfaces.
pub fn plan(
    scene: &Scene,
    photographs: &Photographs,
    options: &DepthOptions,
    plane_step: f64,
) -> Result<Plan, VamvsError> {
    check(options)?;
    scene.validate().map_err(|error| VamvsError::Request(error.to_string()))?;
    let cameras = working_cameras(photographs, scene);
    let mut selected = view_selection::select(scene, &cameras, NEIGHBOURS.max(options.views - 1));
    let as_they_are = photographs.as_they_are();
    let sizes: Vec<Size> =
        scene.views.iter().map(|view| as_they_are.working_size(view.camera.size)).collect();
    let is_there: Vec<bool> = scene.views.iter().map(|view| photographs.may_have(view)).collect();
    // If none is there, reading them says why.
    let is_there = if is_there.contains(&true) { is_there } else { vec![true; is_there.len()] };
    let is_usable =
        |source: &Source| is_there[source.view] && shorter_side(sizes[source.view]) >= SHORTEST_SIDE;
    selected.iter_mut().for_each(|sources| sources.retain(is_usable));
    let seen = SeenPoints::of(scene);
    let planner =
        Planner { scene, seen, cameras: &cameras, selected: &selected, sizes: &sizes, options, plane_step };
    let views: Vec<_> =
        selected.iter().enumerate().map(|(view, sources)| planner.view(view, sources)).collect();
    if let Some(reason) = nothing_to_do(scene, &views) {
        return Err(VamvsError::Request(reason));
    }
    Ok(Plan { cameras, views, neighbours: selected })
}

fn shorter_side(size: Size) -> usize {
    size.width.min(size.height)
}

fn check(options: &DepthOptions) -> Result<(), VamvsError> {
    let wrong = |what: String| Err(VamvsError::Request(what));
    if options.views < 2 {
        return wrong(format!("views must be at least 2 (a reference and a source), got {}", options.views));
    }
    if options.fovea && options.roi.is_none() {
        return wrong("fovea needs a region of interest for fine depth (--roi)".to_owned());
    }
    if options.max_size < MIN_SIZE {
        return wrong(format!("max-size must be at least {MIN_SIZE} pixels, got {}", options.max_size));
    }
    if options.network_size < MIN_SIZE {
        return wrong(format!(
            "network-size must be at least {MIN_SIZE} pixels, got {}",
            options.network_size
        ));
    }
    if !(1.0..=8.0).contains(&options.enlarge) {
        return wrong(format!("enlarge must be from 1 to 8, got {}", options.enlarge));
    }
    let (darkest, brightest) = (options.min_brightness, options.max_brightness);
    if darkest > brightest {
        return wrong(format!(
            "min-brightness {darkest} and max-brightness {brightest} leave no pixel: expected the former below the latter"
        ));
    }
    if let Stretching::Between { low, high } = options.stretch
        && low >= high
    {
        return wrong(format!("stretch needs a low value below the high one, got {low} and {high}"));
    }
    if let Some(range) = options.depth_range {
        DepthRange::try_new(range.near, range.far).map_err(|error| VamvsError::Request(error.to_string()))?;
    }
    if let Some(planes) = options.planes.filter(|planes| !(8..=2048).contains(planes)) {
        return wrong(format!("planes must be from 8 to 2048, got {planes}"));
    }
    if !(8..=2048).contains(&options.max_planes) {
        return wrong(format!("max-planes must be from 8 to 2048, got {}", options.max_planes));
    }
    Ok(())
}

fn nothing_to_do(scene: &Scene, views: &[Result<ViewPlan, String>]) -> Option<String> {
    if views.iter().any(Result::is_ok) {
        return None;
    }
    let reason = views
        .iter()
        .zip(&scene.views)
        .find_map(|(plan, view)| plan.as_ref().err().map(|reason| format!("{}: {reason}", view.name)));
    Some(format!(
        "no depth can be estimated for any of the {} views: {}",
        views.len(),
        reason.unwrap_or_default()
    ))
}

struct Planner<'a> {
    scene: &'a Scene,
    seen: SeenPoints,
    cameras: &'a [Pinhole],
    /// For each view, others that may see the same surfaces, best first.
    selected: &'a [Vec<Source>],
    /// The smallest size at which each photograph is seen.
    sizes: &'a [Size],
    options: &'a DepthOptions,
    plane_step: f64,
}

impl Planner<'_> {
    fn view(&self, view: usize, selected: &[Source]) -> Result<ViewPlan, String> {
        if shorter_side(self.sizes[view]) < SHORTEST_SIDE {
            return Err(format!(
                "its photograph has {} pixels, expected at least {SHORTEST_SIDE} on the shorter side",
                self.sizes[view]
            ));
        }
        let sources: Vec<_> = view_selection::compared(selected, self.options.views - 1).collect();
        if sources.is_empty() {
            return Err("no other view is known to see the same surfaces from another position".to_owned());
        }
        let (range, origin) = self.range(view, &sources)?;
        let (range, region) = self.limited(view, range)?;
        let pose = |view: usize| &self.scene.views[view].cam_from_world;
        let others: Vec<_> = sources.iter().map(|&source| (&self.cameras[source], pose(source))).collect();
        let reference = (&self.cameras[view], pose(view));
        let in_camera = |&point: &usize| pose(view).transform(&self.scene.points[point].x_in_world);
        let surfaces: Vec<_> = self.seen.by(view).iter().map(in_camera).collect();
        let steps = (self.plane_step, self.options.max_planes);
        let mut planes = Planes::for_views(range, reference, &others, &surfaces, steps);
        planes.count = self.options.planes.unwrap_or(planes.count);
        planes.spacing = self.options.spacing.unwrap_or(planes.spacing);
        Ok(ViewPlan { sources, planes, origin, region, foveated: self.options.fovea })
    }

    /// The user's range, or the view's own.
    fn range(&self, view: usize, sources: &[usize]) -> Result<(DepthRange, Option<RangeOrigin>), String> {
        if let Some(range) = self.options.depth_range {
            return Ok((range, None));
        }
        let (range, origin) = depth_range::for_view(self.scene, &self.seen, view, sources).ok_or(
            "no depth range: the scene gives none, has too few points, and the cameras do not determine one; give one with --depth-range",
        )?;
        if origin != RangeOrigin::Geometry {
            return Ok((range, Some(origin)));
        }
        let of_source = |&source: &usize| {
            let its: Vec<_> =
                view_selection::compared(&self.selected[source], self.options.views - 1).collect();
            depth_range::from_geometry(self.scene, source, &its)
        };
        Ok((depth_range::with_neighbours(range, sources.iter().filter_map(of_source)), Some(origin)))
    }

    /// The range and the part of the image that the region of interest leaves.
    fn limited(&self, view: usize, range: DepthRange) -> Result<(DepthRange, Option<PixelBox>), String> {
        let Some(roi) = &self.options.roi else { return Ok((range, None)) };
        let pose = &self.scene.views[view].cam_from_world;
        if self.options.fovea {
            return Ok((range, roi.pixel_box(&self.cameras[view], pose)));
        }
        let outside = || "the region of interest is not in its image".to_owned();
        let region = roi.pixel_box(&self.cameras[view], pose).ok_or_else(outside)?;
        let (near, far) = roi.depth_range(pose).ok_or_else(outside)?;
        let range = DepthRange::try_new(near.max(range.near), far.min(range.far)).map_err(|_| {
            format!("the region of interest (depth {near:.4} to {far:.4}) is outside of the depth range ({:.4} to {:.4})", range.near, range.far)
        })?;
        Ok((range, Some(region)))
    }
}
