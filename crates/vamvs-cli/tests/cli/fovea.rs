//! `--fovea`: all iterations in a region of interest, fewer around it.

use vamvs::core::CloudPoint;

use crate::scene::{Scene, expect_success, stderr};

#[test]
fn a_fovea_is_dense_and_its_surroundings_are_there_thinner() {
    let scene = Scene::new(320, 240, 4);
    let reconstruct = |more: &[&str]| {
        let arguments =
            [&["--weights", "photometric", "--min-views", "2", "--quiet", "--force"], more].concat();
        expect_success(&scene.run("reconstruct", &arguments));
        let cloud = vamvs::io::ply::read(&scene.out().join("fused.ply")).unwrap();
        let names = std::fs::read_dir(scene.out().join("depths")).unwrap().flatten();
        let maps = names.filter(|entry| entry.path().extension().is_some_and(|end| end == "pfm")).count();
        std::fs::remove_dir_all(scene.out()).unwrap();
        (cloud, maps)
    };
    let roi = ["-0.15", "-0.15", "-5", "0.15", "0.15", "5"];
    let inside = |point: &CloudPoint| point.x_in_world[..2].iter().all(|along| along.abs() < 0.1);
    let count = |cloud: &[CloudPoint], wanted: bool| {
        cloud.iter().filter(|point| inside(point) == wanted).count() as f64
    };
    let (whole, maps) = reconstruct(&[]);
    assert_eq!(maps, 4);
    let (foveated, maps) = reconstruct(&[&["--fovea", "--roi"], &roi[..]].concat());
    assert_eq!(maps, 12, "a map at 1/8, 1/4 and 1/2 of each view");
    let shares = [true, false].map(|wanted| count(&foveated, wanted) / count(&whole, wanted));
    assert!(shares[0] > 0.8, "the region is as dense: {shares:?}");
    assert!((0.02..0.4).contains(&shares[1]), "its surroundings are there, thinner: {shares:?}");
    // Settings that say so already, and the region from the command line.
    let settings = scene.path("fovea.toml");
    crate::scene::write(&settings, "[depth]\nfovea = true\n");
    let (again, _) = reconstruct(&[&["--config", settings.to_str().unwrap(), "--roi"], &roi[..]].concat());
    assert_eq!(again.len(), foveated.len());
    let without_roi = scene.run("depth", &["--fovea", "--weights", "photometric"]);
    assert_eq!(without_roi.status.code(), Some(1));
    assert!(stderr(&without_roi).contains("--roi"));
}

#[test]
fn the_maps_of_one_photograph_do_not_confirm_each_other() {
    let scene = Scene::new(160, 120, 2);
    let roi = ["--roi", "-0.15", "-0.15", "-5", "0.15", "0.15", "5"];
    let arguments = [&["--weights", "photometric", "--min-views", "3", "--fovea"], &roi[..]].concat();
    let message = stderr(&scene.run("reconstruct", &arguments));
    assert!(message.contains("1 other view(s) see the same surfaces, and 3 must agree"), "{message}");
}
