//! Refinement against surfaces whose depth is known exactly.

mod common;

use common::{HERE, Set, disparity, enlarged, median, render, seed, sources};
use nalgebra::Vector3;
use vamvs_core::{DepthMap, DepthRange, Grid, Planes, Size};
use vamvs_refine::{RefineOptions, Refined, plane_sweep, refine, refine_geometric};

fn refined(set: &Set) -> Refined {
    refine(&set.photos[0], &sources(set), &seed(set), &[], &RefineOptions::default())
        .expect("the set fits together")
}

/// Errors of disparity, pixels, of all pixels at least `border` from the image's border; 9 where
/// there is no depth.
fn errors(set: &Set, depth: &Grid<f32>, border: usize) -> Vec<f64> {
    let (width, height) = (depth.width(), depth.height());
    let places = (border..height - border).flat_map(|y| (border..width - border).map(move |x| (x, y)));
    places
        .map(|place| if depth[place] > 0.0 { disparity(depth[place], set.depth[place]) } else { 9.0 })
        .collect()
}

fn share_above(errors: &[f64], threshold: f64) -> f64 {
    errors.iter().filter(|error| **error > threshold).count() as f64 / errors.len() as f64
}

#[test]
fn a_tilted_plane_is_met_to_a_twentieth_of_a_pixel_and_two_degrees() {
    let set = render(common::plane, HERE);
    let result = refined(&set);
    let errors = errors(&set, &result.map.depth, 8);
    let angles = result.normals.data().iter().zip(set.normals.data());
    let angles = angles
        .map(|(found, ground_truth)| Vector3::from(*found).cast::<f64>().angle(ground_truth).to_degrees())
        .collect();
    let (error, angle) = (median(errors.clone()), median(angles));
    println!("median {error:.4} px, {angle:.2}°, above a pixel {:.4}", share_above(&errors, 1.0));
    assert!(error < 0.05 && angle < 2.0);
    assert!(share_above(&errors, 1.0) < 0.002);
}

#[test]
fn a_sphere_before_a_wall_is_met_to_a_twentieth_of_a_pixel() {
    let set = render(common::sphere, HERE);
    let errors = errors(&set, &refined(&set).map.depth, 8);
    println!("median {:.4} px, above a pixel {:.4}", median(errors.clone()), share_above(&errors, 1.0));
    assert!(median(errors.clone()) < 0.05);
    // The silhouette passes through about 1.7 % of these pixels: errors reach three to four pixels
    // from it.
    assert!(share_above(&errors, 1.0) < 0.06);
}

#[test]
fn a_step_stays_a_step() {
    let set = render(common::step, HERE);
    let errors = errors(&set, &refined(&set).map.depth, 8);
    println!("median {:.4} px, above a pixel {:.4}", median(errors.clone()), share_above(&errors, 1.0));
    assert!(median(errors.clone()) < 0.05);
    // A column is about 0.6 % of these pixels: errors reach about two columns from the edge.
    assert!(share_above(&errors, 1.0) < 0.012);
}

#[test]
fn the_neighbours_depth_maps_bring_outliers_back() {
    let set = render(common::plane, HERE);
    let mut first = refined(&set);
    for (place, depth) in first.map.depth.data_mut().iter_mut().enumerate() {
        *depth *= if place % 17 == 0 { 1.04 } else { 1.0 };
    }
    let maps: Vec<DepthMap> = set.photos[1..]
        .iter()
        .map(|photo| common::true_map(common::plane, photo, photo.camera.size))
        .collect();
    let maps: Vec<Option<&DepthMap>> = maps.iter().map(Some).collect();
    let options = RefineOptions::default();
    let second = refine_geometric(&set.photos[0], &sources(&set), &first.surface(), &maps, &options).unwrap();
    let [before, after] = [&first, &second].map(|result| errors(&set, &result.map.depth, 8));
    println!("median {:.4} → {:.4} px", median(before.clone()), median(after.clone()));
    assert!(share_above(&before, 0.5) > 0.05 && share_above(&after, 0.5) < 0.005);
    assert!(median(after) < 0.05);
    let confident = second.map.confidence.data().iter().filter(|confidence| **confidence > 0.9).count();
    assert!(confident * 10 > second.map.confidence.data().len() * 8);
}

#[test]
fn a_first_pass_at_half_the_size_leads_to_the_same_plane() {
    let set = enlarged(common::plane, HERE, 2);
    let mut options = RefineOptions::default();
    options.halvings = 1;
    let first = refine(&set.photos[0], &sources(&set), &seed(&set), &[], &options).unwrap();
    let half = set.photos[0].camera.resized(common::SIZE);
    assert_eq!((first.map.camera, first.map.depth.size()), (half, common::SIZE));
    let maps: Vec<DepthMap> = set.photos[1..]
        .iter()
        .map(|photo| common::true_map(common::plane, photo, photo.camera.size))
        .collect();
    let maps: Vec<Option<&DepthMap>> = maps.iter().map(Some).collect();
    let second = refine_geometric(&set.photos[0], &sources(&set), &first.surface(), &maps, &options).unwrap();
    // Twice the pixels make twice the disparity.
    let errors: Vec<f64> = errors(&set, &second.map.depth, 16).iter().map(|error| 2.0 * error).collect();
    println!("median {:.4} px, above a pixel {:.4}", median(errors.clone()), share_above(&errors, 1.0));
    assert!(median(errors.clone()) < 0.05 && share_above(&errors, 1.0) < 0.005);
}

/// A plane whose photographs show nothing but noise.
fn noise() -> common::Set {
    let mut set = render(common::plane, HERE);
    let mut state = 1_u32;
    for photo in &mut set.photos {
        for pixel in photo.image.data_mut() {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *pixel = [(state >> 24) as u8; 3];
        }
    }
    set
}

#[test]
fn where_nothing_matches_the_seed_stays() {
    let set = noise();
    let mut seed = common::true_map(common::plane, &set.photos[0], Size::new(24, 18));
    seed.depth.row_mut(9).fill(0.0);
    let options = RefineOptions::default();
    let result = refine(&set.photos[0], &sources(&set), &seed, &[], &options).unwrap();
    // The seed's confidence is 1.
    let kept = |place: (usize, usize)| {
        disparity(result.map.depth[place], set.depth[place]) < 0.05 && result.map.confidence[place] <= 0.5
    };
    let of_rows = |rows: std::ops::Range<usize>| rows.flat_map(|y| (0..192).map(move |x| (x, y)));
    let count = of_rows(0..72).filter(|&place| kept(place)).count();
    println!("the seed's plane at {:.3} of the pixels", count as f64 / (72.0 * 192.0));
    assert!(of_rows(0..72).all(|place| result.map.depth[place] > 0.0) && count * 10 > 72 * 192 * 6);
    // Where the seed has no depth either, there is none to give back.
    assert!(of_rows(72..80).any(|place| result.map.depth[place] == 0.0));
}

#[test]
fn noise_leads_no_farther_from_the_seed_than_it_may() {
    let set = noise();
    let seed = common::true_map(common::plane, &set.photos[0], Size::new(24, 18));
    let mut options = RefineOptions::default();
    options.beyond = 1.0;
    let result = refine(&set.photos[0], &sources(&set), &seed, &[], &options).unwrap();
    let depths = result.map.depth.data().iter().zip(set.depth.data());
    let moved: Vec<f64> = depths.map(|(found, expected)| disparity(*found, *expected)).collect();
    let near = moved.iter().filter(|moved| **moved < 0.5).count() as f64 / moved.len() as f64;
    println!("at most {:.3} px, below half a pixel {near:.3}", moved.iter().copied().fold(0.0, f64::max));
    assert!(moved.iter().all(|moved| *moved < 2.5) && near > 0.7);
}

#[test]
fn a_plane_sweep_finds_surfaces_without_a_seed_and_refinement_goes_on_from_it() {
    for (surface, outliers) in
        [(common::plane as common::Surface, 0.002), (common::sphere, 0.07), (common::step, 0.02)]
    {
        let set = enlarged(surface, HERE, 2);
        let (photos, options) = (sources(&set), RefineOptions::default());
        let eyes: Vec<_> = photos.iter().map(|photo| (&photo.camera, &photo.cam_from_world)).collect();
        let range = DepthRange::try_new(2.0, 8.0).unwrap();
        let reference = (&set.photos[0].camera, &set.photos[0].cam_from_world);
        let planes = Planes::for_views(range, reference, &eyes, &[], (2.0, 192));
        let swept = plane_sweep(&set.photos[0], &photos, &planes, &options).unwrap();
        assert_eq!(swept.depth.size(), common::SIZE);
        let near = |x: usize, y: usize| disparity(swept.depth[(x, y)], set.depth[(2 * x + 1, 2 * y + 1)]);
        let errors: Vec<f64> = (8..136).flat_map(|y| (8..184).map(move |x| near(x, y))).collect();
        let (error, far) = (median(errors.clone()), share_above(&errors, 1.0));
        println!("swept: median {error:.4} px, above a pixel {far:.4}");
        assert!(error < 0.2 && far < outliers + 0.03);
        let refined = refine(&set.photos[0], &photos, &swept, &[], &options).unwrap();
        let errors: Vec<f64> =
            self::errors(&set, &refined.map.depth, 16).iter().map(|error| 2.0 * error).collect();
        println!(
            "refined: median {:.4} px, above a pixel {:.4}",
            median(errors.clone()),
            share_above(&errors, 1.0)
        );
        assert!(median(errors.clone()) < 0.05 && share_above(&errors, 1.0) < outliers);
    }
}
