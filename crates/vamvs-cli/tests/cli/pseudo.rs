//! `vamvs pseudo` on depth maps with exact ground truth; needs no network.

use vamvs::core::Grid;
use vamvs::io::pfm;

use crate::fuse::true_maps;
use crate::scene::{Scene, error_of, expect_success, stderr, vamvs};

/// Multiplies the depths of a view of an output folder.
fn falsify(folder: &vamvs::OutputFolder, view: usize, factor: f32) {
    let file = folder.root().join(format!("depths/{view:04}.pfm"));
    let depth = pfm::read_depth(&file).unwrap().map(|depth| depth * factor);
    pfm::write(&file, &depth).unwrap();
}

/// The share of a view's pixels that have a depth in the set, and whether all of these are the true ones.
fn verified(scene: &Scene, set: &std::path::Path, view: usize) -> (f64, bool) {
    let depth: Grid<f32> = pfm::read_depth(&set.join(format!("depths/{view:08}.pfm"))).unwrap();
    let pairs = depth.data().iter().zip(scene.views[view].depth.data()).filter(|(depth, _)| **depth > 0.0);
    let (count, wrong) = pairs
        .fold((0, 0), |(count, wrong), (a, b)| (count + 1, wrong + usize::from((a - b).abs() > 1e-4 * b)));
    (count as f64 / depth.data().len() as f64, wrong == 0)
}

#[test]
fn what_several_views_agree_on_is_pseudo_ground_truth_and_a_view_that_disagrees_has_none() {
    let scene = Scene::new(160, 120, 6);
    let folder = true_maps(&scene);
    falsify(&folder, 2, 1.05);
    let set = scene.path("set");
    let output = vamvs().arg("pseudo").arg(folder.root()).arg("--out").arg(&set).output().unwrap();
    expect_success(&output);
    let made = set.join(folder.root().file_name().unwrap());
    for view in [0, 1, 3, 4, 5] {
        let (share, all_true) = verified(&scene, &made, view);
        assert!(share > 0.2 && all_true, "view {view}: {share}");
    }
    let (share, _) = verified(&scene, &made, 2);
    assert!(share < 0.02, "{share} of the false depths are verified");
    for file in ["images/00000003.png", "cams/00000003_cam.txt", "pair.txt"] {
        assert!(made.join(file).is_file(), "{file}");
    }
}

#[test]
fn a_reconstruction_with_too_few_verified_pixels_is_left_out_by_name_and_count() {
    let scene = Scene::new(96, 64, 4);
    let folder = true_maps(&scene);
    (0..4).for_each(|view| falsify(&folder, view, 1.0 + 0.05 * view as f32));
    let set = scene.path("set");
    let output = vamvs().arg("pseudo").arg(folder.root()).arg("--out").arg(&set).output().unwrap();
    let said = error_of(&output);
    assert!(said.contains("none of the reconstructions has enough verified pixels"), "{said}");
    let name = folder.root().file_name().unwrap().to_string_lossy().into_owned();
    let warned = stderr(&output);
    assert!(
        warned.contains(&format!("{name} is left out")) && warned.contains("of 24576 pixels"),
        "{warned}"
    );
    assert!(!set.join(name).exists());
    let missing = vamvs().args(["pseudo", "nowhere", "--out"]).arg(&set).output().unwrap();
    assert!(error_of(&missing).contains("nowhere"));
}
