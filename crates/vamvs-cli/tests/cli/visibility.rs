//! `--visibility`: how likely source views see the pixels, as the network predicts it.

use vamvs::OutputFolder;
use vamvs::core::{Grid, Size};

use crate::scene::{Scene, expect_success};

/// The predicted visibility of a view in its source views, and their names.
fn predicted(folder: &OutputFolder, name: &str) -> (Vec<Grid<f32>>, Vec<String>) {
    let sources = folder.saved(name).unwrap().sources;
    let tiles = vamvs::io::visibility::read_predicted(&folder.visibility(name), sources.len()).unwrap();
    (tiles, sources)
}

#[test]
fn predicted_visibility_is_beside_the_depth_maps_and_on_the_page() {
    let scene = Scene::new(192, 144, 3);
    let folder = OutputFolder::new(&scene.out());
    expect_success(&scene.run("reconstruct", &["--quiet", "--min-views", "2"]));
    assert!(!folder.visibility("0000").exists(), "it is not asked for");
    let run = || expect_success(&scene.run("reconstruct", &["--quiet", "--min-views", "2", "--visibility"]));
    run();
    let (tiles, sources) = predicted(&folder, "0000");
    assert_eq!(sources.len(), 2);
    let size = Size::new(96, 72);
    assert!(tiles.iter().all(|tile| tile.size() == size), "a quarter of the photograph, enlarged twice");
    // What both photographs show is visible for the most part.
    let mean = |tile: &Grid<f32>| tile.data().iter().sum::<f32>() / tile.data().len() as f32;
    assert!(
        tiles.iter().all(|tile| (0.5..1.0).contains(&mean(tile))),
        "{:?}",
        tiles.iter().map(mean).collect::<Vec<_>>()
    );
    let page = std::fs::read_to_string(scene.out().join("report.html")).unwrap();
    assert!(sources.iter().all(|source| page.contains(&format!("visibility in {source}"))));
    let before = std::fs::read(folder.visibility("0001")).unwrap();
    let changed = std::fs::metadata(folder.visibility("0001")).unwrap().modified().unwrap();
    run();
    assert_eq!(std::fs::read(folder.visibility("0001")).unwrap(), before);
    assert_eq!(
        std::fs::metadata(folder.visibility("0001")).unwrap().modified().unwrap(),
        changed,
        "a complete run"
    );
    // A file that is missing is written again; without the flag what is there stays, as long as the depth map does.
    std::fs::remove_file(folder.visibility("0001")).unwrap();
    run();
    assert_eq!(std::fs::read(folder.visibility("0001")).unwrap(), before);
    let without = |more: &[&str]| {
        expect_success(&scene.run("reconstruct", &[&["--quiet", "--min-views", "2"], more].concat()));
    };
    without(&[]);
    assert_eq!(std::fs::read(folder.visibility("0001")).unwrap(), before);
    without(&["--views", "2"]);
    assert!(!folder.visibility("0001").exists(), "it was that of other source views");
}

#[test]
fn small_photographs_are_seen_enlarged() {
    let scene = Scene::new(192, 144, 3);
    let folder = OutputFolder::new(&scene.out());
    let seen = |more: &[&str]| {
        expect_success(&scene.run("depth", &[&["--quiet", "--visibility", "--planes", "32"], more].concat()));
        (0..3).map(|view| predicted(&folder, &format!("{view:04}")).0[0].size()).collect::<Vec<_>>()
    };
    assert_eq!(seen(&[]), [Size::new(96, 72); 3], "twice");
    assert_eq!(seen(&["--network-size", "192"]), [Size::new(48, 36); 3], "no larger than is wanted");
}

#[test]
fn in_a_region_of_interest_it_is_at_its_place_in_the_image() {
    let scene = Scene::new(320, 240, 3);
    let folder = OutputFolder::new(&scene.out());
    let run = |more: &[&str]| {
        expect_success(
            &scene.run("depth", &[&["--quiet", "--visibility", "--planes", "32", "--force"], more].concat()),
        );
        predicted(&folder, "0000").0
    };
    let whole = run(&[]);
    let part = run(&["--roi", "-0.15", "-0.15", "-5", "0.15", "0.15", "5"]);
    assert_eq!(whole[0].size(), part[0].size());
    let differences = part[0].data().iter().zip(whole[0].data()).filter(|(part, _)| **part > 0.0);
    let (close, count) = differences.fold((0, 0), |(close, count), (part, whole)| {
        (close + usize::from((part - whole).abs() < 0.2), count + 1)
    });
    assert!(count > 100 && count < whole[0].data().len() && close * 10 > count * 8, "{close} of {count}");
}
