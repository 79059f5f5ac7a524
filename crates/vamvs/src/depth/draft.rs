//! Depth ranges of captures without sparse points: a draft of the depth maps, of small photographs and over wide ranges, finds points,
//! which tell whether the ranges that the cameras suggest are right.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

use nalgebra::Vector3;
use vamvs_core::depth_range::{self, RangeOrigin};
use vamvs_core::lift::lift_map;
use vamvs_core::{DepthMap, DepthRange, Planes, Scene, SeenPoints, occlusion};

use super::maker::Maker;
use crate::event::{OnEvent, tell};
use crate::order::by_photographs;
use crate::{DepthOptions, Event, Method, Photographs, Plan, Prepared, VamvsError, ViewPlan};

/// Longer side of the photographs, pixels.
const SIZE: usize = 448;

/// How many times as near and as far the range reaches as that from the cameras alone.
const WIDER: f64 = 4.0;

/// Most views of which a draft is made, evenly spread over the scene, each with its best source view.
const MOST_VIEWS: usize = 64;

/// Most points that are kept.
const MOST_POINTS: usize = 20_000;

/// The least confidence of a point.
const LEAST_CONFIDENCE: f32 = 0.3;

/// Depths of two drafts agree if they differ by less than this share.
const AGREEMENT: f64 = 0.03;

/// A guess of which at least this share of the draft's points lie inside is right.
const HELD: f64 = 0.99;

/// What a draft gave.
pub(crate) struct Drafted {
    /// The scene, with depth ranges of the views of which none was known.
    pub scene: Scene,
    /// The method, which made the draft.
    pub method: Method,
    /// The views that have their depth ranges from the draft.
    pub views: Vec<usize>,
}

/// Finds the depth ranges of views of which they are known from the cameras alone; without such views the scene stays as it is.
///
/// # Errors
/// If memory runs out, or `on_event` breaks. A view whose photograph cannot be read is left out here, and told later.
pub(crate) fn draft(
    scene: Scene,
    photographs: &Photographs,
    method: Method,
    options: &DepthOptions,
    on_event: &mut OnEvent<'_>,
) -> Result<Drafted, VamvsError> {
    let options = DepthOptions {
        network_size: SIZE,
        refine: false,
        geometric: false,
        enlarge: 1.0,
        planes: None,
        spacing: None,
        iterations: None,
        coarse_stride: None,
        roi: None,
        fovea: false,
        visibility: false,
        ..options.clone()
    };
    let photographs = photographs.as_they_are().reduced_to(SIZE);
    let plan = match crate::plan(&scene, &photographs, &options, method.plane_step()) {
        Ok(plan) => plan,
        // What is wrong is told when the depth maps themselves are planned.
        Err(_) => return Ok(Drafted { scene, method, views: Vec::new() }),
    };
    let is_guess = |plan: &&ViewPlan| plan.origin == Some(RangeOrigin::Geometry);
    let guess =
        |view: &Result<ViewPlan, String>| view.as_ref().ok().filter(is_guess).map(|plan| plan.planes.range);
    let guesses: Vec<Option<DepthRange>> = plan.views.iter().map(guess).collect();
    let views: Vec<usize> = (0..guesses.len()).filter(|&view| guesses[view].is_some()).collect();
    if views.is_empty() {
        return Ok(Drafted { scene, method, views });
    }
    let plan = widened(plan, &views, &scene, (method.plane_step(), options.max_planes));
    let work = Prepared { scene, photographs, plan, method, options };
    let maps = maps(&work, &by_photographs(&work.plan, &chosen(&work.plan, &views)), on_event)?;
    let points = points(&maps, &work.plan);
    let Prepared { mut scene, method, .. } = work;
    let ranges = ranges(&scene, points, &guesses);
    ranges.iter().for_each(|&(view, range)| scene.views[view].depth_range = Some(range));
    Ok(Drafted { scene, method, views: ranges.into_iter().map(|(view, _)| view).collect() })
}

/// The depth ranges of the views with a guess that see enough of the points: the guess, if it holds them, else that of the points.
fn ranges(
    scene: &Scene,
    points: Vec<Vector3<f64>>,
    guesses: &[Option<DepthRange>],
) -> Vec<(usize, DepthRange)> {
    let points = occlusion::points_with_views(points, &scene.views);
    let scene = Scene { views: scene.views.clone(), points, pairs: None };
    let seen = SeenPoints::of(&scene);
    let range = |view: usize| {
        let (guess, found) = (guesses[view]?, depth_range::from_points(&scene, &seen, view)?);
        let depth =
            |&point: &usize| scene.views[view].cam_from_world.transform(&scene.points[point].x_in_world).z;
        let points = seen.by(view);
        let held = points.iter().map(depth).filter(|depth| (guess.near..=guess.far).contains(depth)).count();
        Some((view, if held as f64 >= HELD * points.len() as f64 { guess } else { found }))
    };
    (0..guesses.len()).filter_map(range).collect()
}

/// The plan, with wider ranges for these views.
fn widened(mut plan: Plan, views: &[usize], scene: &Scene, steps: (f64, usize)) -> Plan {
    let pose = |view: usize| &scene.views[view].cam_from_world;
    for &view in views {
        let Ok(planned) = &mut plan.views[view] else { continue };
        let DepthRange { near, far } = planned.planes.range;
        let range = DepthRange { near: near / WIDER, far: far * WIDER };
        let others: Vec<_> =
            planned.sources.iter().map(|&source| (&plan.cameras[source], pose(source))).collect();
        planned.planes = Planes::for_views(range, (&plan.cameras[view], pose(view)), &others, &[], steps);
    }
    plan
}

/// At most [`MOST_VIEWS`] of these views: all, or some that are evenly spread, with the best source of each.
fn chosen(plan: &Plan, views: &[usize]) -> BTreeSet<usize> {
    if views.len() <= MOST_VIEWS {
        return views.iter().copied().collect();
    }
    let half = MOST_VIEWS / 2;
    let spread = (0..half).map(|number| views[number * views.len() / half]);
    let best = |view: usize| plan.views[view].as_ref().ok().and_then(|plan| plan.sources.first().copied());
    let chosen = spread.flat_map(|view| [Some(view), best(view)]).flatten();
    chosen.filter(|&view| plan.views[view].is_ok()).collect()
}

/// The drafts of these views, as far as their photographs can be read.
fn maps(
    work: &Prepared,
    views: &[usize],
    on_event: &mut OnEvent<'_>,
) -> Result<BTreeMap<usize, DepthMap>, VamvsError> {
    let mut maker = Maker::new(work);
    let mut maps = BTreeMap::new();
    for (number, &view) in views.iter().enumerate() {
        // Warnings come again with the depth maps themselves.
        let mut quiet = |event: Event| match event {
            Event::Warning(_) => ControlFlow::Continue(()),
            event => on_event(event),
        };
        let plan = work.plan.views[view].as_ref().expect("only planned views are chosen");
        match maker.draft(view, plan, &mut quiet) {
            Ok(map) => drop(maps.insert(view, map)),
            Err(error) if error.ends_run() => return Err(error),
            Err(_) => {}
        }
        tell(on_event, Event::Draft { done: number + 1, total: views.len() })?;
    }
    Ok(maps)
}

/// The points, in the world, that the draft of a view and that of one of its source views agree on; at most [`MOST_POINTS`], evenly
/// spread.
fn points(maps: &BTreeMap<usize, DepthMap>, plan: &Plan) -> Vec<Vector3<f64>> {
    let mut points = Vec::new();
    for (view, map) in maps {
        let sources = plan.views[*view].iter().flat_map(|plan| &plan.sources);
        let others: Vec<&DepthMap> = sources.filter_map(|source| maps.get(source)).collect();
        let sure = lift_map(map).zip(map.confidence.data());
        let sure = sure.filter_map(|(point, confidence)| point.filter(|_| *confidence >= LEAST_CONFIDENCE));
        points.extend(sure.filter(|point| others.iter().any(|other| agrees(other, point))));
    }
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    points.into_iter().step_by(step).collect()
}

/// Whether a depth map has a point on its surface.
fn agrees(map: &DepthMap, point: &Vector3<f64>) -> bool {
    let x_in_cam = map.cam_from_world.transform(point);
    let pixel = map.camera.project_inside(&x_in_cam);
    let depth = pixel.map(|pixel| f64::from(map.depth[(pixel.x as usize, pixel.y as usize)]));
    depth.is_some_and(|depth| (depth - x_in_cam.z).abs() < AGREEMENT * x_in_cam.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Size, Spacing};

    /// Two cameras side by side before a wall at a depth of 2.
    fn wall(x: f64, depth: f32) -> DepthMap {
        let size = Size::new(32, 24);
        let intrinsics = Intrinsics { fx: 30.0, fy: 30.0, cx: 16.0, cy: 12.0 };
        let cam_from_world = Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() };
        DepthMap {
            camera: Pinhole { size, intrinsics },
            cam_from_world,
            depth: Grid::filled(size, depth),
            confidence: Grid::from_fn(size, |_, y| if y < 12 { 0.9 } else { 0.1 }),
            coarse_confidence: None,
        }
    }

    #[test]
    fn points_are_those_that_two_drafts_agree_on() {
        let planned = |source: usize| {
            let range = DepthRange { near: 1.0, far: 4.0 };
            let planes = Planes { range, count: 8, spacing: Spacing::InverseDepth };
            Ok(ViewPlan { sources: vec![source], planes, origin: None, region: None, foveated: false })
        };
        let plan = Plan { cameras: Vec::new(), views: vec![planned(1), planned(0)], neighbours: Vec::new() };
        let found = |depths: [f32; 2]| {
            let maps = [(0, wall(0.0, depths[0])), (1, wall(0.5, depths[1]))];
            points(&maps.into(), &plan)
        };
        let wall = found([2.0, 2.03]);
        assert!(wall.iter().all(|point| (point.z - 2.0).abs() < 0.05 && point.y < 0.0));
        // A camera's width is 2.13 there, of which both see 1.63.
        assert!((560..650).contains(&wall.len()), "{}", wall.len());
        assert!(found([2.0, 2.2]).is_empty());
    }
}
