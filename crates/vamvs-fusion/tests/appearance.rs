//! Normals and colours of points, and how far apart points are.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![allow(missing_docs, reason = "nobody calls a test")]

mod synthetic;

use nalgebra::Vector3;
use synthetic::{Surface, all_others, views};
use vamvs_core::{Cloud, Grid, Size, lift::lift_map};
use vamvs_fusion::{FuseJob, FuseOptions, FuseReport, FusionView, PointSpacing, fuse_to_cloud};

const SIZE: Size = Size::new(96, 72);
const DISTANCE: f64 = 4.0;

fn fuse(views: &[FusionView], options: &FuseOptions) -> (Cloud, FuseReport) {
    let neighbours = all_others(views.len());
    let job = FuseJob { source: views, neighbours: &neighbours, options, roi: None, memory: 1 << 30 };
    fuse_to_cloud(&job).unwrap()
}

fn tilted() -> (Surface, Vector3<f64>) {
    let normal = Vector3::new(0.3, -0.2, 0.9).normalize();
    (Surface::Plane(normal), normal)
}

#[test]
fn normals_of_the_maps_are_taken_and_where_they_have_none_the_depths_tell() {
    let (plane, fitted) = tilted();
    let given = Vector3::new(0.1_f32, 0.2, 0.9).normalize();
    let mut view = views(plane, 1, SIZE, DISTANCE);
    let tells = |x| x >= SIZE.width / 2;
    view[0].normals = Some(Grid::from_fn(SIZE, |x, _| if tells(x) { given.into() } else { [0.0; 3] }));
    let near =
        |normal: [f32; 3], other: &Vector3<f64>| (Vector3::from(normal).cast::<f64>() - other).norm() < 1e-3;
    let mut options = FuseOptions::classic();
    options.min_views = 1;
    let (cloud, _) = fuse(&view, &options);
    assert_eq!(cloud.len(), SIZE.area());
    let [of_map, of_depth] =
        [given.cast(), fitted].map(|n| cloud.iter().filter(|p| near(p.normal, &n)).count());
    assert_eq!([of_map, of_depth], [SIZE.area() / 2; 2]);
}

#[test]
fn normals_of_another_size_are_refused() {
    let mut views = views(tilted().0, 2, SIZE, DISTANCE);
    views[1].normals = Some(Grid::filled(Size::new(3, 3), [0.0, 0.0, 1.0]));
    let error = views[1].check(1).unwrap_err();
    assert_eq!(
        error.to_string(),
        "view 1: expected a map of normals of 96×72 pixels like the depth map, got 3×3"
    );
}

#[test]
fn the_view_that_sees_a_point_best_gives_most_of_its_colour() {
    let mut all = views(tilted().0, 3, SIZE, DISTANCE);
    all.extend(views(tilted().0, 1, SIZE, 0.4 * DISTANCE));
    all[3].colour = Grid::filled(SIZE, [220, 100, 200]);
    let (cloud, _) = fuse(&all, &FuseOptions::default());
    // At the border of the near view the windows are incomplete, so it counts little there.
    let red = |least: u8| cloud.iter().filter(|point| point.colour[0] >= least).count();
    assert!(red(190) as f64 > 0.8 * SIZE.area() as f64, "{} of {}", red(190), SIZE.area());
    assert!(red(220) < red(190) / 2, "blended, but little: {} of {}", red(220), red(190));
}

/// Photographs smear the colours of a surface over its outline, onto what is behind it.
#[test]
fn colours_do_not_bleed_over_edges() {
    let surface = Surface::SphereOnPlane;
    let mut views = views(surface, 5, SIZE, DISTANCE);
    let is_plane = |x: &Vector3<f64>| (x.z + 0.5).abs() < 0.05;
    let (mut smeared, mut on_plane) = (0, 0);
    for view in &mut views {
        let plane: Vec<bool> = lift_map(&view.map).map(|x| x.is_some_and(|x| is_plane(&x))).collect();
        let around = |i: usize| [i.wrapping_sub(1), i + 1, i.wrapping_sub(SIZE.width), i + SIZE.width];
        let shows_sphere = |i: usize| !plane.get(i).copied().unwrap_or(true);
        for (i, colour) in view.colour.data_mut().iter_mut().enumerate() {
            let white = shows_sphere(i) || around(i).into_iter().any(shows_sphere);
            *colour = if white { [255; 3] } else { [0; 3] };
            smeared += usize::from(white && plane[i]);
            on_plane += usize::from(plane[i]);
        }
    }
    let (cloud, _) = fuse(&views, &FuseOptions::default());
    let plane: Vec<_> = cloud.iter().filter(|point| is_plane(&Vector3::from(point.x_in_world))).collect();
    let white = plane.iter().filter(|point| point.colour[0] > 64).count();
    let (before, after) = (smeared as f64 / on_plane as f64, white as f64 / plane.len() as f64);
    assert!(before > 0.01 && after < 0.65 * before, "{before} of the pixels, {after} of the points");
}

#[test]
fn points_are_as_far_apart_as_asked_and_cover_the_surface_evenly() {
    let views = views(tilted().0, 4, SIZE, DISTANCE);
    let (dense, _) = fuse(&views, &FuseOptions::default());
    let footprint = DISTANCE / views[0].map.camera.intrinsics.fx;
    for (spacing, units) in [(PointSpacing::Pixels(3.0), 3.0 * footprint), (PointSpacing::Units(0.1), 0.1)] {
        let mut options = FuseOptions::default();
        options.point_spacing = Some(spacing);
        let (cloud, report) = fuse(&views, &options);
        let distance = |a: &vamvs_core::CloudPoint, b: &vamvs_core::CloudPoint| {
            (Vector3::from(a.x_in_world) - Vector3::from(b.x_in_world)).norm()
        };
        for (i, point) in cloud.iter().enumerate() {
            assert!(cloud[..i].iter().all(|other| distance(point, other) > 0.9 * units));
        }
        let covered =
            |point: &&vamvs_core::CloudPoint| cloud.iter().any(|other| distance(point, other) < 1.1 * units);
        assert!(dense.iter().step_by(7).all(|point| covered(&point)));
        let total = report.total();
        assert_eq!(total.points, cloud.len() as u64);
        assert_eq!(
            total.pixels,
            total.inconsistent + total.merged + total.points,
            "thinned points are merged"
        );
    }
}
