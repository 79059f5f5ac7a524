//! Fusion of exact depth maps of analytic surfaces.
#![allow(missing_docs, reason = "nobody calls a test")]

mod synthetic;

use nalgebra::Vector3;
use synthetic::{Surface, all_others, views};
use vamvs_core::{Cloud, Grid, Roi, Size, lift::lift_map};
use vamvs_fusion::{FuseJob, FuseOptions, FuseReport, FusedPoints, FusionView, fuse_to_cloud};

const SIZE: Size = Size::new(96, 72);
/// For curved surfaces: the error of interpolation falls with the square of the pixel.
const FINE: Size = Size::new(192, 144);
const DISTANCE: f64 = 4.0;

#[allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
fn fuse(views: &[FusionView], options: &FuseOptions, roi: Option<Roi>) -> (Cloud, FuseReport) {
    let neighbours = all_others(views.len());
    fuse_to_cloud(&FuseJob { source: views, neighbours: &neighbours, options, roi, memory: 1 << 30 }).unwrap()
}

fn tilted() -> Surface {
    Surface::Plane(Vector3::new(0.3, -0.2, 0.9).normalize())
}

fn footprint(views: &[FusionView]) -> f64 {
    DISTANCE / views[0].map.camera.intrinsics.fx
}

/// Distance of each point of `from` to the nearest of `to` that is not at the same place in memory.
fn nearest(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Vec<f64> {
    let squared = |a: &Vector3<f64>| {
        let others = to.iter().filter(|b| !std::ptr::eq(a, *b));
        others.map(|b| (a - b).norm_squared()).fold(f64::INFINITY, f64::min)
    };
    from.iter().map(|a| squared(a).sqrt()).collect()
}

fn positions(cloud: &Cloud) -> Vec<Vector3<f64>> {
    cloud.iter().map(|point| Vector3::from(point.x_in_world)).collect()
}

#[test]
fn points_and_normals_are_those_of_the_surface() {
    for (surface, degrees) in [(tilted(), 0.02), (Surface::Sphere, 2.0), (Surface::SphereOnPlane, 2.0)] {
        let views = views(surface, 5, FINE, DISTANCE);
        let (cloud, _) = fuse(&views, &FuseOptions::default(), None);
        assert!(cloud.len() > 6000, "{surface:?}: {} points", cloud.len());
        let is_plane = matches!(surface, Surface::Plane(_));
        let (mut off, mut bent) = (0, 0);
        for point in &cloud {
            let x = Vector3::from(point.x_in_world);
            let error = surface.distance(&x).abs() / DISTANCE;
            // Fusion keeps 19 bits of an inverse depth.
            assert!(error < if is_plane { 2e-6 } else { 1e-3 }, "{surface:?}: {error} at {x}");
            off += usize::from(error > 1e-4);
            let normal = Vector3::from(point.normal).cast::<f64>();
            assert!((normal.norm() - 1.0).abs() < 1e-6);
            bent += usize::from(normal.dot(&surface.normal(&x)) < f64::to_radians(degrees).cos());
            assert!((2..=5).contains(&point.views) && point.confidence == 1.0);
        }
        // At the sphere's outline surfaces end or curve strongly within a pixel.
        let [off, bent] = [off, bent].map(|count| count as f64 / cloud.len() as f64);
        assert!(
            if is_plane { off == 0.0 && bent == 0.0 } else { off < 0.01 && bent < 0.035 },
            "{off}, {bent}"
        );
    }
}

#[test]
fn each_place_comes_out_once_and_none_is_lost() {
    for surface in [tilted(), Surface::SphereOnPlane] {
        let views = views(surface, 5, SIZE, DISTANCE);
        let (cloud, report) = fuse(&views, &FuseOptions::default(), None);
        let cloud = positions(&cloud);
        let footprint = footprint(&views);
        let crowded = nearest(&cloud, &cloud).iter().filter(|&&d| d < 0.5 * footprint).count();
        assert!((crowded as f64) < 0.03 * cloud.len() as f64, "{crowded} of {}", cloud.len());
        let total = report.total();
        assert!(total.merged > 2 * total.points, "five views, most places seen by four or five");
        // A view that keeps all pixels finds a point within a pixel or so of each of them.
        let mut all = FuseOptions::classic();
        all.min_views = 1;
        let (cloud, _) = fuse(&views, &all, None);
        let lifted: Vec<Vector3<f64>> = lift_map(&views[3].map).flatten().collect();
        let farthest = nearest(&lifted, &positions(&cloud)).into_iter().fold(0.0, f64::max);
        assert!(farthest < 3.0 * footprint, "{farthest} against {footprint}");
    }
}

#[test]
fn the_view_in_most_detail_makes_the_points() {
    let mut all = views(tilted(), 3, SIZE, DISTANCE);
    all.extend(views(tilted(), 1, SIZE, 0.4 * DISTANCE));
    let (_, report) = fuse(&all, &FuseOptions::default(), None);
    assert_eq!(report.views[3].merged, 0);
    assert_eq!(report.views[3].points, SIZE.area() as u64);
    assert!(report.views[0].merged > 500);
}

#[test]
fn outliers_of_one_map_vanish() {
    let surface = Surface::SphereOnPlane;
    let mut views = views(surface, 5, FINE, DISTANCE);
    let clean = fuse(&views, &FuseOptions::default(), None).0.len();
    for (i, depth) in views[1].map.depth.data_mut().iter_mut().enumerate() {
        *depth *= [1.0, 1.0, 1.1, 0.7, 1.03][i * i % 5];
    }
    let (cloud, report) = fuse(&views, &FuseOptions::default(), None);
    let errors = positions(&cloud).into_iter().map(|x| surface.distance(&x).abs() / DISTANCE);
    let (off, worst) = errors.fold((0, 0.0), |(off, worst), e| (off + usize::from(e > 1e-4), e.max(worst)));
    // A wrong depth may come within 1 % of another place of the surface and count there, among two.
    assert!(worst < 0.01 / 2.0, "{worst}");
    assert!((off as f64) < 0.01 * cloud.len() as f64, "{off} of {}", cloud.len());
    assert!(cloud.len() as f64 > 0.9 * clean as f64, "the other views still make {} of {clean}", cloud.len());
    assert!(report.views[1].inconsistent > FINE.area() as u64 / 4);
}

#[test]
fn masked_and_unconfident_pixels_take_no_part() {
    let mut views = views(tilted(), 3, SIZE, DISTANCE);
    let left = |x: usize| x < SIZE.width / 2;
    views[0].mask = Some(Grid::from_fn(SIZE, |x, _| !left(x)));
    for (i, confidence) in views[1].map.confidence.data_mut().iter_mut().enumerate() {
        *confidence = if left(i % SIZE.width) { 0.05 } else { 0.7 };
    }
    let (cloud, report) = fuse(&views, &FuseOptions::classic(), None);
    assert_eq!(report.views[0].masked, SIZE.area() as u64 / 2);
    assert_eq!(report.views[1].unconfident, SIZE.area() as u64 / 2);
    let map = &views[0].map;
    for point in &cloud {
        assert_eq!(point.views, 3);
        assert!(
            (point.confidence - 0.9).abs() < 0.004,
            "(1 + 0.7 + 1) / 3, with six bits of the root of each"
        );
        assert!(point.colour[0] <= 20 && point.colour[1..] == [100, 200], "between 0, 10 and 20 in red");
        let x_in_cam = map.cam_from_world.transform(&Vector3::from(point.x_in_world));
        assert!(map.camera.intrinsics.project(&x_in_cam).x > SIZE.width as f64 / 2.0 - 1e-3);
    }
    assert!(cloud.len() > 1000);
}

#[test]
fn the_coarse_confidence_counts_where_there_is_one() {
    let mut views = views(tilted(), 3, SIZE, DISTANCE);
    views[2].map.coarse_confidence = Some(Grid::filled(SIZE, 0.15));
    let (cloud, report) = fuse(&views, &FuseOptions::classic(), None);
    assert!(cloud.is_empty());
    assert_eq!(report.views[2].unconfident, SIZE.area() as u64);
}

#[test]
fn only_the_region_of_interest_makes_points() {
    let views = views(tilted(), 4, SIZE, DISTANCE);
    let roi = Roi { min: Vector3::new(-0.5, -0.25, -9.0), max: Vector3::new(0.25, 0.5, 9.0) };
    let (cloud, report) = fuse(&views, &FuseOptions::default(), Some(roi));
    assert!(cloud.len() > 200);
    assert!(report.total().outside_roi > 0);
    assert!(positions(&cloud).iter().all(|x| roi.contains(x)));
}

#[test]
fn each_pixel_is_reported_once() {
    let mut views = views(Surface::Sphere, 4, SIZE, DISTANCE);
    views[0].mask = Some(Grid::from_fn(SIZE, |x, y| (x + y) % 7 != 0));
    views[1].map.confidence.data_mut().iter_mut().step_by(5).for_each(|c| *c = 0.0);
    let roi = Roi { min: Vector3::repeat(-0.8), max: Vector3::repeat(1.1) };
    let (cloud, report) = fuse(&views, &FuseOptions::default(), Some(roi));
    for view in &report.views {
        assert_eq!(view.pixels, SIZE.area() as u64);
        let removed = view.without_depth + view.masked + view.unconfident + view.outside_roi;
        assert_eq!(view.pixels, removed + view.inconsistent + view.merged + view.points);
    }
    assert_eq!(report.total().points, cloud.len() as u64);
}

#[test]
fn views_that_see_nothing_in_common_give_no_points() {
    let views = views(tilted(), 3, SIZE, DISTANCE);
    let neighbours = vec![vec![1], vec![0], vec![]];
    let options = FuseOptions::classic();
    let job =
        FuseJob { source: &views[..], neighbours: &neighbours, options: &options, roi: None, memory: 0 };
    let (cloud, report) = fuse_to_cloud(&job).unwrap();
    assert!(cloud.is_empty());
    assert_eq!(report.total().inconsistent, 3 * SIZE.area() as u64, "one neighbour cannot make three views");
}

#[test]
fn pixels_that_are_not_kept_swallow_no_points() {
    let views = views(tilted(), 4, SIZE, DISTANCE);
    let neighbours = vec![vec![1], vec![0, 2, 3], vec![0, 1, 3], vec![0, 1, 2]];
    let options = FuseOptions::classic();
    let job =
        FuseJob { source: &views[..], neighbours: &neighbours, options: &options, roi: None, memory: 0 };
    let (_, report) = fuse_to_cloud(&job).unwrap();
    assert_eq!(report.views[0].inconsistent, SIZE.area() as u64, "one neighbour cannot make three views");
    assert!(report.views[1].merged < SIZE.area() as u64 / 20, "although view 0 would come first");
    assert!(report.views[1].points > SIZE.area() as u64 / 2);
}

/// A slanted plane seen by two views from many distances: the order of the views changes along
/// lines across it, where a place must not be left by each view to the other.
#[test]
fn no_hairline_gap_opens_where_the_order_of_the_views_changes() {
    let surface = Surface::Plane(Vector3::new(0.75, 0.1, 0.65).normalize());
    let mut crossings = 0;
    for step in 0..40 {
        let (near, far) =
            (views(surface, 3, SIZE, DISTANCE), views(surface, 3, SIZE, DISTANCE * 1.02_f64.powi(step)));
        for pair in [[&near[0], &far[2]], [&far[2], &near[0]], [&near[2], &far[0]], [&far[0], &near[2]]] {
            let pair = pair.map(Clone::clone);
            let made = pixels_that_make_points(&pair);
            crossings += usize::from(made.iter().all(|made| made.data().contains(&true)));
            for view in 0..2 {
                assert_eq!(left_to_nobody(&pair, &made, view), 0, "distance step {step}, view {view}");
            }
        }
    }
    assert!(crossings > 40, "views share the work in {crossings} pairs");
}

/// For each of two views of a plane, which pixels make a point.
fn pixels_that_make_points(pair: &[FusionView; 2]) -> [Grid<bool>; 2] {
    let mut made = [(); 2].map(|()| Grid::filled(SIZE, false));
    let neighbours = all_others(2);
    let mut options = FuseOptions::classic();
    (options.min_views, options.max_relative_depth) = (1, 0.03);
    let job =
        FuseJob { source: &pair[..], neighbours: &neighbours, options: &options, roi: None, memory: 1 << 30 };
    let mut sink = |fused: &FusedPoints| {
        for (point, views) in fused.iter() {
            let maker = views[0] as usize;
            let at = pixels_of(&pair[maker], &Vector3::from(point.x_in_world), 0.0);
            at.into_iter().for_each(|pixel| made[maker][pixel] = true);
        }
        Ok(())
    };
    vamvs_fusion::fuse(&job, &mut sink, &mut |_| std::ops::ControlFlow::Continue(()))
        .expect("the views can be fused");
    made
}

/// The pixels of a view that show a point of the world, or are within `tolerance` pixels of where it is.
fn pixels_of(view: &FusionView, x_in_world: &Vector3<f64>, tolerance: f64) -> Vec<(usize, usize)> {
    let map = &view.map;
    let Some(at) = map.camera.project_inside(&map.cam_from_world.transform(x_in_world)) else {
        return vec![];
    };
    let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
    let pixels = corners.map(|(x, y)| ((at.x + x * tolerance) as usize, (at.y + y * tolerance) as usize));
    pixels.into_iter().filter(|&(x, y)| x < SIZE.width && y < SIZE.height).collect()
}

/// Longest chain followed from a pixel to the pixel that takes its place, and so on; the order of
/// the views changes less often within some pixels.
const LONGEST_CHAIN: usize = 4;

/// The number of pixels of a view that are left to pixels of the other view, which are left to
/// pixels of this view, and so on, without any that makes a point.
fn left_to_nobody(pair: &[FusionView; 2], made: &[Grid<bool>; 2], view: usize) -> usize {
    let places = [0, 1].map(|view| lift_map(&pair[view].map).collect::<Vec<_>>());
    // The pixels of the other view that show the same places as these pixels, apart from rounding.
    let across = |view: usize, pixels: &[(usize, usize)]| -> Vec<(usize, usize)> {
        let places = pixels.iter().filter_map(|&(x, y)| places[view][y * SIZE.width + x]);
        places.flat_map(|place| pixels_of(&pair[1 - view], &place, 1e-3)).collect()
    };
    let is_lost = |&pixel: &(usize, usize)| {
        let (mut at, mut pixels) = (view, vec![pixel]);
        for _ in 0..LONGEST_CHAIN {
            if pixels.is_empty() || pixels.iter().any(|&pixel| made[at][pixel]) {
                return false;
            }
            pixels = across(at, &pixels);
            at = 1 - at;
        }
        true
    };
    let all = (0..SIZE.area()).map(|i| (i % SIZE.width, i / SIZE.width));
    all.filter(|&(x, y)| places[view][y * SIZE.width + x].is_some()).filter(is_lost).count()
}
