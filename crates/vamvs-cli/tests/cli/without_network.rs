//! `--weights none`: depth maps by a plane sweep, in the build without libtorch too.

use crate::scene::{Scene, content, expect_success, right, stderr};
#[cfg(not(feature = "torch"))]
use crate::scene::{error_of, vamvs};
use vamvs::core::Size;
use vamvs::io::pfm;
use vamvs::output::OutputFolder;

const SIZE: Size = Size::new(240, 180);

const NONE: [&str; 3] = ["--weights", "none", "--no-report"];

#[test]
fn a_scene_is_reconstructed_and_the_bytes_do_not_depend_on_the_number_of_threads() {
    let scene = Scene::new(SIZE.width, SIZE.height, 5);
    let output = scene.run("reconstruct", &[&NONE[..], &["--threads", "2"]].concat());
    expect_success(&output);
    assert!(stderr(&output).contains("plane sweep, without a network"), "{}", stderr(&output));
    let maps = OutputFolder::new(&scene.out());
    for (index, view) in scene.views.iter().enumerate() {
        let depth = pfm::read_depth(&maps.depth(&format!("{index:04}"))).unwrap();
        assert_eq!(depth.size(), SIZE);
        let (close, near) = (right(&depth, &view.depth, 0.002), right(&depth, &view.depth, 0.01));
        println!("view {index}: {close:.3} within 0.2 %, {near:.3} within 1 %");
        assert!(close > 0.5 && near > 0.7, "view {index}: {close} within 0.2 %, {near} within 1 %");
    }
    let [two, one] = [scene.out(), scene.path("one")];
    let again = scene.command_to(&one, "reconstruct", &[&NONE[..], &["--threads", "1"]].concat()).output();
    expect_success(&again.unwrap());
    for folder in ["depths", "confidence", "normals"] {
        let bytes = |root: &std::path::Path| content(&root.join(folder)).into_values().collect::<Vec<_>>();
        assert!(bytes(&two) == bytes(&one), "{folder} differ");
    }
    let resumed = scene.run("depth", &["--weights", "none", "--threads", "2"]);
    assert!(stderr(&resumed).contains("0 depth maps made, 5 were there"), "{}", stderr(&resumed));
}

#[test]
fn a_region_of_interest_leaves_nothing_outside() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    let roi = ["--roi", "-0.6", "-0.6", "-0.6", "0.6", "0.6", "0.6", "--no-refine"];
    expect_success(&scene.run("depth", &[&NONE[..2], &roi].concat()));
    let depth = pfm::read_depth(&OutputFolder::new(&scene.out()).depth("0001")).unwrap();
    assert_eq!(depth.size(), Size::new(SIZE.width / 2, SIZE.height / 2));
    let with_depth = depth.data().iter().filter(|depth| **depth > 0.0).count();
    assert!((1..depth.data().len()).contains(&with_depth), "{with_depth} pixels have depth");
    assert_eq!(depth[(0, 0)], 0.0);
}

#[test]
#[cfg(feature = "torch")]
fn what_needs_a_network_is_refused() {
    let scene = Scene::new(160, 120, 3);
    for flags in [&["--iterations", "1"][..], &["--coarse-stride", "4"]] {
        let said = scene.error("depth", &[&NONE[..2], flags].concat());
        assert!(said.contains("--weights none has no network") && said.contains(flags[0]), "{said}");
    }
}

#[test]
#[cfg(not(feature = "torch"))]
fn a_network_is_refused_where_there_is_no_libtorch() {
    let scene = Scene::new(160, 120, 3);
    let said = scene.error("depth", &["--weights", "vis-max"]);
    assert!(said.contains("built without libtorch") && said.contains("vis-corr"), "{said}");
}

/// They exist in other builds: whoever follows a guide is not told that there is no such command.
#[test]
#[cfg(not(feature = "torch"))]
fn commands_of_other_builds_say_how_to_get_these() {
    for command in
        [&["train", "--data", "set"][..], &["calibrate", "--help"], &["eval", "network", "--views", "5"]]
    {
        let said = error_of(&vamvs().args(command).output().unwrap());
        assert!(said.contains("built without libtorch") && said.contains("--features torch"), "{said}");
    }
    #[cfg(not(feature = "synth"))]
    {
        let said = error_of(&vamvs().args(["synth", "--out", "set"]).output().unwrap());
        assert!(said.contains("--features synth"), "{said}");
    }
    let help = vamvs().arg("--help").output().unwrap().stdout;
    assert!(!String::from_utf8_lossy(&help).contains("  train "));
}
