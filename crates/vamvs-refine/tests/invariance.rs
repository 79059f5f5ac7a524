//! Properties of the scene and the machine on which the result must not depend.

mod common;

use common::{HERE, Placement, Set, disparity, median, render, seed, sources};
use nalgebra::Vector3;
use rayon::ThreadPoolBuilder;
use vamvs_core::{DepthMap, Grid, Rgb, Size};
use vamvs_refine::{RefineError, RefineOptions, Refined, refine, refine_geometric};

fn refined(set: &Set) -> Refined {
    refine(&set.photos[0], &sources(set), &seed(set), &[], &RefineOptions::default())
        .expect("the set fits together")
}

#[test]
fn scale_rotation_and_place_change_nothing_but_the_unit() {
    let here = refined(&render(common::sphere, HERE));
    for scale in [1e-3, 250.0] {
        let turn = Vector3::new(0.4, -1.1, 0.7);
        let there = Placement { scale, turn, place: scale * Vector3::new(400.0, -90.0, 20.0) };
        let there = refined(&render(common::sphere, there));
        let pairs =
            here.map.depth.data().iter().zip(there.map.depth.data()).filter(|(a, b)| **a > 0.0 && **b > 0.0);
        let differences: Vec<f64> = pairs.map(|(a, b)| disparity(*a, *b / scale as f32)).collect();
        assert!(differences.len() * 100 > here.map.depth.data().len() * 95);
        let same = differences.iter().filter(|difference| **difference < 0.05).count();
        assert!(same * 100 > differences.len() * 97, "{same} of {}", differences.len());
        assert!(median(differences) < 1e-3);
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let set = render(common::step, HERE);
    let with = |threads: usize| {
        ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(|| refined(&set))
    };
    let (one, five) = (with(1), with(5));
    assert_eq!(one.map, five.map);
    assert_eq!(one.normals, five.normals);
}

#[test]
fn tiles_give_what_one_piece_gives() {
    let set = common::enlarged(common::sphere, HERE, 3);
    let (sources, seed) = (sources(&set), seed(&set));
    let mut options = RefineOptions::default();
    options.halvings = 1;
    let half = Size::new(set.depth.width() / 2, set.depth.height() / 2);
    let maps: Vec<DepthMap> =
        set.photos[1..].iter().map(|photo| common::true_map(common::sphere, photo, half)).collect();
    // The first source view is thought not to see what is left of the middle.
    let seen = |source: usize| {
        Grid::from_fn(Size::new(57, 43), move |x, _| if source > 0 || x > 28 { 1.0 } else { 0.0 })
    };
    let visibility: Vec<Grid<f32>> = (0..4).map(seen).collect();
    let pass = |tile: usize| {
        let mut options = options;
        options.tile = tile;
        let first = refine(&set.photos[0], &sources, &seed, &visibility, &options).unwrap();
        let maps: Vec<Option<&DepthMap>> = maps.iter().map(Some).collect();
        refine_geometric(&set.photos[0], &sources, &first.surface(), &maps, &options).unwrap()
    };
    let (whole, tiled) = (pass(1024), pass(160));
    assert_eq!(tiled.map.camera, whole.map.camera);
    let pairs = || whole.map.depth.data().iter().zip(tiled.map.depth.data());
    let differences: Vec<f64> = pairs().map(|(a, b)| if a == b { 0.0 } else { disparity(*a, *b) }).collect();
    // Planar segments end at the border of a tile, so depths that they decide may differ a little.
    let apart = |least: f64| differences.iter().filter(|difference| **difference > least).count();
    println!(
        "{} and {} of {} pixels are 0.01 and 0.1 pixels apart",
        apart(1e-2),
        apart(0.1),
        differences.len()
    );
    assert!(apart(1e-2) * 50 < differences.len() && apart(0.1) * 500 < differences.len());
}

#[test]
fn without_texture_the_seed_stays() {
    let mut set = render(common::plane, HERE);
    for photo in &mut set.photos {
        photo.image = photo.image.map(|_| -> Rgb { [90; 3] });
    }
    let seed = seed(&set);
    let result = refined(&set);
    let errors = (0..seed.depth.size().area()).filter_map(|place| {
        let (x, y) = (place % seed.depth.width(), place / seed.depth.width());
        let (coarse, fine) = (seed.depth[(x, y)], result.map.depth[(8 * x + 4, 8 * y + 4)]);
        (coarse > 0.0 && fine > 0.0).then(|| disparity(coarse, fine))
    });
    assert!(median(errors.collect()) < 0.1);
    assert!(result.map.confidence.data().iter().all(|confidence| *confidence < 0.5));
}

#[test]
fn what_is_masked_gets_no_depth_and_does_not_disturb_its_surroundings() {
    let mut set = render(common::plane, HERE);
    let masked = |x: usize, y: usize| (80..110).contains(&x) && (50..90).contains(&y);
    set.photos[0].mask = Some(Grid::from_fn(common::SIZE, |x, y| !masked(x, y)));
    let image = &set.photos[0].image;
    set.photos[0].image =
        Grid::from_fn(common::SIZE, |x, y| if masked(x, y) { [255; 3] } else { image[(x, y)] });
    let result = refined(&set);
    let mut around = Vec::new();
    for y in 40..100 {
        for x in 70..120 {
            let depth = result.map.depth[(x, y)];
            if masked(x, y) {
                assert_eq!((depth, result.normals[(x, y)]), (0.0, [0.0; 3]));
            } else {
                around.push(disparity(depth, set.depth[(x, y)]));
            }
        }
    }
    assert!(median(around) < 0.05);
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let set = render(common::plane, HERE);
    let (seed, options) = (seed(&set), RefineOptions::default());
    let none = refine(&set.photos[0], &[], &seed, &[], &options);
    assert_eq!(none.unwrap_err(), RefineError::NoSource);
    let visibility = [Grid::filled(seed.depth.size(), 1.0)];
    let few = refine(&set.photos[0], &sources(&set), &seed, &visibility, &options);
    assert_eq!(few.unwrap_err(), RefineError::Count { what: "visibility", expected: 4, found: 1 });
    let mut bad = set.photos[0].clone();
    bad.mask = Some(Grid::filled(seed.depth.size(), true));
    assert!(matches!(refine(&bad, &sources(&set), &seed, &[], &options), Err(RefineError::Size { .. })));
}
