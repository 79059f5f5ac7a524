//! The views listed for a point, and the surface of a single view.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod synthetic;

use nalgebra::Vector3;
use synthetic::{Surface, all_others, views};
use vamvs_core::{Grid, Size};
use vamvs_fusion::{FuseJob, FuseOptions, FusedPoints, fuse};

const SIZE: Size = Size::new(96, 72);

#[test]
fn every_view_of_a_point_sees_it_and_that_which_made_it_comes_first() {
    let views = views(Surface::SphereOnPlane, 5, SIZE, 4.0);
    let (options, neighbours) = (FuseOptions::default(), all_others(5));
    let job =
        FuseJob { source: &views[..], neighbours: &neighbours, options: &options, roi: None, memory: 0 };
    let mut batches: Vec<FusedPoints> = Vec::new();
    let mut sink = |fused: &FusedPoints| {
        batches.push(fused.clone());
        Ok(())
    };
    fuse(&job, &mut sink, &mut |_| std::ops::ControlFlow::Continue(())).unwrap();
    let mut count = 0;
    for batch in &batches {
        let maker = batch.iter().next().map(|(_, seen_by)| seen_by[0]);
        for (point, seen_by) in batch.iter() {
            count += 1;
            assert_eq!((Some(seen_by[0]), seen_by.len()), (maker, usize::from(point.views)));
            for &view in seen_by {
                let map = &views[view as usize].map;
                let x_in_cam = map.cam_from_world.transform(&point.x_in_world.into());
                let pixel = map.camera.project_inside(&x_in_cam).unwrap();
                // Views may agree within a pixel: at an outline a neighbouring pixel shows the
                // point.
                let around = |i: usize| [pixel.x as usize + i % 3, pixel.y as usize + i / 3];
                let depths = (0..9)
                    .map(around)
                    .filter_map(|[x, y]| map.depth.get(x.checked_sub(1)?, y.checked_sub(1)?));
                let nearest =
                    depths.map(|&depth| (f64::from(depth) - x_in_cam.z).abs()).fold(f64::INFINITY, f64::min);
                assert!(nearest < 0.03 * x_in_cam.z, "view {view}: {nearest} off");
            }
        }
    }
    assert!(count > 3000, "{count}");
}

#[test]
fn the_surface_of_a_view_is_what_is_confident_with_normals_towards_the_camera() {
    let mut view = views(Surface::Plane(Vector3::new(0.3, -0.2, 0.9).normalize()), 3, SIZE, 4.0).remove(0);
    view.map.confidence = Grid::from_fn(SIZE, |x, _| if x < 40 { 0.05 } else { 0.9 });
    view.mask = Some(Grid::from_fn(SIZE, |_, y| y < 60));
    let surface = vamvs_fusion::Surface::of(&view, &FuseOptions::default()).unwrap();
    let expected = view.map.cam_from_world.rotation * Vector3::new(0.3, -0.2, 0.9).normalize();
    for y in 0..SIZE.height {
        for x in 0..SIZE.width {
            let (depth, normal) = (surface.depth[(x, y)], Vector3::from(surface.normal[(x, y)]));
            if x < 40 || y >= 60 {
                assert!(depth == 0.0 && normal == Vector3::zeros());
            } else {
                assert_eq!(depth, view.map.depth[(x, y)]);
                assert!(normal.z < 0.0 && (normal.cast::<f64>() - expected).norm() < 1e-3, "{normal}");
            }
        }
    }
}
