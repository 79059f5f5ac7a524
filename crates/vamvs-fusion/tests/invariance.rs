//! What fusion must not depend on.
#![allow(missing_docs, reason = "nobody calls a test")]

mod synthetic;

use nalgebra::Vector3;
use std::ops::ControlFlow;
use synthetic::{Surface, all_others, views};
use vamvs_core::{Cloud, Part, Pose, Size};

use vamvs_fusion::{
    Collector, ConsistentViews, Counts, FuseEvent, FuseJob, FuseOptions, FuseReport, FusedPoints, FusionView,
    PointSpacing, Schedule, confirm, fuse, fuse_to_cloud, merge,
};

const SIZE: Size = Size::new(80, 60);

/// Noisy maps, so that the filters have something to decide.
fn noisy_views() -> Vec<FusionView> {
    let mut views = views(Surface::SphereOnPlane, 6, SIZE, 4.0);
    for (v, view) in views.iter_mut().enumerate() {
        for (i, depth) in view.map.depth.data_mut().iter_mut().enumerate() {
            let random = ((i * 7919 + v * 104_729) % 1009) as f32 / 1009.0 - 0.5;
            *depth *= 1.0 + 0.01 * random;
        }
    }
    views
}

#[allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
fn fused(views: &[FusionView], memory: usize) -> (Cloud, FuseReport) {
    fused_with(views, &all_others(views.len()), memory)
}

#[allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
fn fused_with(views: &[FusionView], neighbours: &[Vec<usize>], memory: usize) -> (Cloud, FuseReport) {
    let options = FuseOptions::default();
    fuse_to_cloud(&FuseJob { source: views, neighbours, options: &options, roi: None, memory }).unwrap()
}

#[test]
fn threads_and_memory_do_not_change_a_bit() {
    let views = noisy_views();
    // One view has all others as neighbours, the others have two each.
    let neighbours = [vec![3, 5], vec![4, 2], vec![1, 5], vec![0, 1, 2, 4, 5], vec![1, 3], vec![0, 2]];
    let unlimited = fused_with(&views, &neighbours, usize::MAX / 2);
    assert!(unlimited.0.len() > 1000);
    for threads in [1, 2, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        for views_in_memory in [0, 1, 4, 12, 30, 1000] {
            let memory = views_in_memory * 15 * SIZE.area();
            let (cloud, report) = pool.install(|| fused_with(&views, &neighbours, memory));
            assert!(cloud == unlimited.0 && report.views == unlimited.1.views);
        }
    }
}

/// The cloud of parts that share nothing but their results.
#[allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
fn fused_in_parts(
    views: &[FusionView],
    neighbours: &[Vec<usize>],
    options: &FuseOptions,
    parts: usize,
) -> Cloud {
    let job = FuseJob { source: views, neighbours, options, roi: None, memory: 0 };
    let schedule = Schedule::new(neighbours, views.len()).unwrap();
    let confirmed = |part| confirm(&job, &schedule, part, &mut |_| ControlFlow::Continue(())).unwrap().0;
    let pixels: Vec<ConsistentViews> = Part::all(parts).map(confirmed).collect();
    let all: ConsistentViews = pixels.into_iter().flatten().collect();
    let counts: Vec<Counts> = all.values().map(|pixels| pixels.counts).collect();
    let mut batches = Vec::new();
    for part in Part::all(parts) {
        let needed = schedule.needed_to_merge(&schedule.merged_in(part));
        let few = all.iter().filter(|(view, _)| needed.contains(view));
        let few: ConsistentViews = few.map(|(view, pixels)| (*view, pixels.clone())).collect();
        let mut take = |batch| {
            batches.push(batch);
            Ok(())
        };
        merge(&job, &schedule, part, (&few, &counts), &mut take).unwrap();
    }
    let mut cloud = Cloud::new();
    let mut sink = |points: &FusedPoints| {
        cloud.extend_from_slice(points.points());
        Ok(())
    };
    let mut ignore = |_| ControlFlow::Continue(());
    let mut collector = Collector::new(&counts, options, &mut sink, &mut ignore);
    batches.into_iter().for_each(|batch| collector.take(batch).unwrap());
    drop(collector.finish());
    cloud
}

#[test]
fn parts_make_the_cloud_of_the_whole() {
    let views = noisy_views();
    let neighbours = [vec![3, 5], vec![4, 2], vec![1, 5], vec![0, 1, 2, 4, 5], vec![1, 3], vec![0, 2]];
    let mut thinned = FuseOptions::default();
    thinned.point_spacing = Some(PointSpacing::Pixels(3.0));
    for options in [FuseOptions::default(), thinned] {
        let job =
            FuseJob { source: &views[..], neighbours: &neighbours, options: &options, roi: None, memory: 0 };
        let (whole, _) = fuse_to_cloud(&job).unwrap();
        assert!(whole.len() > 200);
        for parts in [1, 2, 3, 6, 8] {
            assert!(fused_in_parts(&views, &neighbours, &options, parts) == whole, "{parts} parts");
        }
    }
}

/// A view, its neighbours, the memory to load them, and the bits must fit; the limit is not
/// exceeded.
#[test]
fn memory_that_suffices_is_not_exceeded() {
    let views: Vec<_> = std::iter::repeat_n(noisy_views(), 5).flatten().collect();
    let beside = |view: usize| [view.wrapping_sub(1), view + 1].into_iter().filter(|&v| v < 30).collect();
    let neighbours: Vec<Vec<usize>> = (0..30).map(beside).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for views_in_memory in [12, 20, 28] {
        let memory = views_in_memory * 15 * SIZE.area();
        let (_, report) = pool.install(|| fused_with(&views, &neighbours, memory));
        assert!(report.memory <= memory as u64, "{} of {memory}", report.memory);
    }
}

#[test]
fn scale_and_place_of_the_scene_do_not_matter() {
    let views = noisy_views();
    let (expected, _) = fused(&views, usize::MAX / 2);
    for (scale, offset) in [
        (0.001, Vector3::new(5.0, -3.0, 1.0)),
        (1000.0, Vector3::new(0.0, 1e5, 0.0)),
        (1.0, Vector3::new(4.5e5, 5.4e6, 300.0)),
        (30.0, Vector3::new(4.5e5, 5.4e6, 300.0)),
    ] {
        let moved: Vec<FusionView> = views.iter().map(|view| transformed(view, scale, &offset)).collect();
        let (cloud, _) = fused(&moved, usize::MAX / 2);
        assert_same_points(&expected, &cloud, scale, &offset);
    }
}

/// The view in a world whose points are `scale · x + offset`.
fn transformed(view: &FusionView, scale: f64, offset: &Vector3<f64>) -> FusionView {
    let mut moved = view.clone();
    let Pose { rotation, translation } = view.map.cam_from_world;
    moved.map.cam_from_world = Pose { rotation, translation: scale * translation - rotation * offset };
    moved.map.depth = view.map.depth.map(|&depth| (scale * f64::from(depth)) as f32);
    moved
}

/// Inverse depths are rounded to 19 bits, elsewhere at each scale. That may tip a pixel that is just at a threshold, but
/// few of them.
fn assert_same_points(expected: &Cloud, cloud: &Cloud, scale: f64, offset: &Vector3<f64>) {
    let (mut same, mut candidates) = (0, cloud.iter().peekable());
    for point in expected {
        let x = Vector3::from(point.x_in_world);
        let is_same = |other: &&vamvs_core::CloudPoint| {
            ((Vector3::from(other.x_in_world) - offset) / scale - x).norm() < 2e-5
                && other.colour == point.colour
                && other.views == point.views
        };
        // Points come in the order of their pixels, so that a match is among the next few.
        if let Some(ahead) = candidates.clone().take(20).position(|other| is_same(&other)) {
            candidates.nth(ahead);
            same += 1;
        }
    }
    let (least, most) = (expected.len().min(cloud.len()), expected.len().max(cloud.len()));
    assert!(same as f64 > 0.995 * most as f64, "{same} of {least}/{most} points at scale {scale}");
}

#[test]
fn points_come_view_by_view_and_events_tell_of_each() {
    let views = noisy_views();
    let neighbours = all_others(views.len());
    let options = FuseOptions::default();
    let job =
        FuseJob { source: &views[..], neighbours: &neighbours, options: &options, roi: None, memory: 0 };
    let (mut makers, mut events) = (Vec::new(), Vec::new());
    let mut sink = |fused: &FusedPoints| {
        makers.extend(fused.iter().map(|(_, views)| views[0] as usize));
        Ok(())
    };
    let report = fuse(&job, &mut sink, &mut |event| {
        events.push(event);
        ControlFlow::Continue(())
    })
    .unwrap();
    let points = |view: usize| report.views[view].points;
    let view_of = |event: &FuseEvent| match *event {
        FuseEvent::Filtered { view, .. } | FuseEvent::Merged { view, .. } => view,
    };
    let order: Vec<usize> = events[..6].iter().map(view_of).collect();
    let filtered = order.iter().map(|&view| {
        let report = report.views[view];
        FuseEvent::Filtered { view, kept: report.merged + report.points }
    });
    let backwards = || order.iter().rev().copied();
    let merged = backwards().map(|view| FuseEvent::Merged { view, points: points(view) });
    assert_eq!(events, filtered.chain(merged).collect::<Vec<_>>());
    let expected = backwards().flat_map(|view| std::iter::repeat_n(view, points(view) as usize));
    assert_eq!(makers, expected.collect::<Vec<_>>());
}

#[test]
fn a_sink_that_fails_stops_the_fusion() {
    let views = noisy_views();
    let neighbours = all_others(views.len());
    let options = FuseOptions::default();
    let job =
        FuseJob { source: &views[..], neighbours: &neighbours, options: &options, roi: None, memory: 0 };
    let mut calls = 0;
    let mut sink = |_: &FusedPoints| {
        calls += 1;
        Err("disk full".into())
    };
    let error = fuse(&job, &mut sink, &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert_eq!(std::error::Error::source(&error).unwrap().to_string(), "disk full");
    assert_eq!(calls, 1);
}
