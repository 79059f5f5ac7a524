//! `vamvs eval` on depth maps and clouds whose errors are known.

use std::path::Path;

use serde_json::Value;
use vamvs::core::{DepthMap, DepthRange, Grid, Planes, Size, Spacing, Visibility};
use vamvs::io::{image, ply, visibility};
use vamvs::output::{OutputFolder, Record, SavedMap};

use crate::fuse::true_maps;
use crate::scene::{Scene, error_of, expect_success, vamvs, write};

/// Planes that are 0.05 apart.
const PLANES: Planes =
    Planes { range: DepthRange { near: 1.0, far: 6.0 }, count: 101, spacing: Spacing::Depth };

/// Depth maps of half the ground truth's size, all depths a hundredth too large, the left half missing.
fn estimates(scene: &Scene, planes: Option<Planes>) -> OutputFolder {
    let folder = OutputFolder::new(&scene.path("estimates"));
    let names: Vec<String> = (0..scene.views.len()).map(|i| format!("{i:04}")).collect();
    folder.prepare(&names.iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
    for (name, view) in names.iter().zip(&scene.views) {
        let size = Size::new(view.depth.width() / 2, view.depth.height() / 2);
        let there = |x: usize| x >= size.width / 2;
        let map = DepthMap {
            camera: view.photo.camera.resized(size),
            cam_from_world: view.photo.cam_from_world,
            // The true pixel at the centre of 2×2 is the lower right one.
            depth: Grid::from_fn(size, |x, y| {
                if there(x) { 1.01 * view.depth[(2 * x + 1, 2 * y + 1)] } else { 0.0 }
            }),
            confidence: Grid::filled(size, 1.0),
            coarse_confidence: None,
        };
        let colour = image::resize(&view.photo.image, size);
        let saved = SavedMap { map: &map, range: PLANES.range, colour: &colour, normals: None, sigma: None };
        let sources = vec![names[if name == "0000" { 1 } else { 0 }].clone()];
        folder
            .save(name, &saved, &Record { made_of: "a test".into(), planes, sources, ..Record::default() })
            .unwrap();
    }
    folder
}

/// The first view's tiles: the second view does not see its upper half; all else sees everything.
fn write_visibility(scene: &Scene, ground_truth: &OutputFolder) {
    let size = scene.views[0].depth.size();
    let seen = Grid::filled(size, Visibility::Visible);
    let half =
        Grid::from_fn(
            size,
            |_, y| if y < size.height / 2 { Visibility::Occluded } else { Visibility::Visible },
        );
    std::fs::create_dir_all(ground_truth.root().join("visibility")).unwrap();
    for view in 0..scene.views.len() {
        let mut tiles = vec![seen.clone(); scene.views.len()];
        if view == 0 {
            (tiles[1], tiles[2]) = (half.clone(), half.map(|_| Visibility::OutOfView));
        }
        visibility::write(&ground_truth.root().join(format!("visibility/{view:04}.png")), &tiles).unwrap();
    }
}

fn eval(arguments: &[&str], paths: [&Path; 2]) -> std::process::Output {
    let mut run = vamvs();
    run.arg("eval").arg(arguments[0]).args(paths).args(&arguments[1..]).output().unwrap()
}

fn json(arguments: &[&str], paths: [&Path; 2]) -> Value {
    let output = eval(&[arguments, &["--json"]].concat(), paths);
    expect_success(&output);
    serde_json::from_slice(&output.stdout).unwrap()
}

fn near(value: &Value, expected: f64) -> bool {
    (value.as_f64().unwrap() - expected).abs() < 1e-5
}

#[test]
fn depth_errors_are_told_by_view_region_and_threshold() {
    let scene = Scene::new(64, 48, 4);
    let ground_truth = true_maps(&scene);
    write_visibility(&scene, &ground_truth);
    let estimates = estimates(&scene, Some(PLANES));
    let paths = [estimates.root(), ground_truth.root()];
    let result = json(&["depth"], paths);
    let errors = &result["scenes"][0]["errors"];
    let all = &errors["total"][0];
    assert_eq!((all["region"].as_str(), all["true_pixels"].as_u64()), (Some("all"), Some(4 * 32 * 24)));
    assert!(near(&all["coverage"], 0.5) && near(&all["relative"]["mean"], 0.01), "{all}");
    let shares: Vec<_> =
        all["within"].as_array().unwrap().iter().map(|within| within["share"].as_f64()).collect();
    assert_eq!(shares[..2], [Some(0.0), Some(0.0)]);
    assert_eq!((shares[3], shares.len()), (Some(1.0), 6), "four relative thresholds, then planes");
    // A hundredth of depths from 1 to 6 is at most 0.06: more than a plane for depths beyond 5, never three.
    assert_eq!(shares[5], Some(1.0));
    let first = errors["views"][0]["regions"].as_array().unwrap();
    let pixels: Vec<_> = first.iter().map(|region| region["true_pixels"].as_u64().unwrap()).collect();
    assert_eq!(pixels, [768, 384, 384], "its only source does not see the upper half");
    assert_eq!(errors["views"][1]["regions"][1]["true_pixels"], 0);
    let text = eval(&["depth", "--relative", "0.011"], paths);
    expect_success(&text);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    assert!(
        text.contains("≤ 1.1 %") && text.contains("invisible in some source") && text.contains("100.00 %"),
        "{text}"
    );
}

#[test]
fn folders_of_depth_map_files_are_compared_by_name() {
    let scene = Scene::new(64, 48, 3);
    let estimates = estimates(&scene, None);
    let ground_truth = scene.path("sensor");
    for view in 0..2 {
        let file = ground_truth.join(format!("{view:04}.png"));
        std::fs::create_dir_all(&ground_truth).unwrap();
        vamvs::io::depth::write(&file, &scene.views[view].depth, 0.0005).unwrap();
    }
    let depths = estimates.root().join("depths");
    for (prediction, step) in [(estimates.root(), &["--png-step", "0.0005"][..]), (&depths, &[])] {
        if step.is_empty() {
            write(&ground_truth.join("png-step.txt"), "0.0005\n");
        }
        let result = json(&[&["depth"], step].concat(), [prediction, &ground_truth]);
        let errors = &result["scenes"][0]["errors"];
        let all = &errors["total"][0];
        assert_eq!(
            (errors["views"].as_array().unwrap().len(), all["true_pixels"].as_u64()),
            (2, Some(2 * 768))
        );
        assert!((all["relative"]["mean"].as_f64().unwrap() - 0.01).abs() < 2e-4, "{all}");
    }
    let others = scene.path("others");
    std::fs::rename(ground_truth.join("0001.png"), ground_truth.join("no view.png")).unwrap();
    std::fs::remove_file(ground_truth.join("0000.png")).unwrap();
    std::fs::rename(&ground_truth, &others).unwrap();
    let error = error_of(&eval(&["depth"], [estimates.root(), &others]));
    assert!(error.contains("estimates") && error.contains("with the names of those in"), "{error}");
}

#[test]
fn plane_distances_must_be_known_and_can_be_given() {
    let scene = Scene::new(64, 48, 3);
    let (ground_truth, estimates) = (true_maps(&scene), estimates(&scene, None));
    let paths = [estimates.root(), ground_truth.root()];
    let error = error_of(&eval(&["depth", "--planes", "1"], paths));
    assert!(error.contains("0000") && error.contains("--plane-distance"), "{error}");
    let given = json(&["depth", "--planes", "1", "--plane-distance", "0.1"], paths);
    assert_eq!(given["scenes"][0]["errors"]["total"][0]["within"][0]["share"], 1.0);
}

#[test]
fn folders_of_scenes_have_a_mean_and_single_files_are_compared_by_size() {
    let scene = Scene::new(64, 48, 3);
    let (ground_truth, estimates) = (true_maps(&scene), estimates(&scene, None));
    let set = |name: &str, from: &OutputFolder| {
        for number in ["scene-0", "scene-1"] {
            let to = scene.path(name).join(number);
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            std::os::unix::fs::symlink(from.root(), to).unwrap();
        }
        scene.path(name)
    };
    let (estimated, true_set) = (set("estimated", &estimates), set("true", &ground_truth));
    let result = json(&["depth"], [&estimated, &true_set]);
    assert_eq!(result["scenes"].as_array().unwrap().len(), 2);
    assert_eq!(result["scenes"][1]["scene"], "scene-1");
    assert!(near(&result["mean"][0]["relative"]["mean"], 0.01));
    let single = json(&["depth", "--absolute", "1"], [&estimates.depth("0001"), &ground_truth.depth("0001")]);
    assert!(near(&single["scenes"][0]["errors"]["total"][0]["relative"]["mean"], 0.01));
    let error = error_of(&eval(&["depth"], [&scene.path("images"), ground_truth.root()]));
    assert!(error.contains("images") && error.contains("expected depth maps"), "{error}");
}

#[test]
fn clouds_are_measured_by_the_preset_that_is_asked_for() {
    let scene = Scene::new(64, 48, 3);
    let square = |z: f64, side: usize| -> Vec<vamvs::core::CloudPoint> {
        let point = |i: usize| vamvs::core::CloudPoint {
            x_in_world: [(i % side) as f64, (i / side) as f64, z],
            normal: [0.0, 0.0, 1.0],
            colour: [9; 3],
            confidence: 1.0,
            sigma: 0.0,
            views: 3,
        };
        (0..side * side).map(point).collect()
    };
    let (cloud, ground_truth) = (scene.path("cloud.ply"), scene.path("ground_truth.ply"));
    ply::write(&cloud, &square(0.25, 20)).unwrap();
    ply::write(&ground_truth, &square(0.0, 20)).unwrap();
    let generic = json(&["cloud", "--thresholds", "0.2,0.3"], [&cloud, &ground_truth]);
    assert_eq!((&generic["protocol"], &generic["accuracy"]["mean"]), (&"generic".into(), &0.25.into()));
    let scores: Vec<_> =
        generic["agreement"].as_array().unwrap().iter().map(|at| at["f_score"].as_f64()).collect();
    assert_eq!(scores, [Some(0.0), Some(1.0)]);
    write(&scene.path("align.txt"), "1 0 0 0  0 1 0 0  0 0 1 -0.25  0 0 0 1");
    let align = scene.path("align.txt");
    let tnt = ["cloud", "--preset", "tnt", "--tau", "0.1", "--align", align.to_str().unwrap()];
    assert_eq!(json(&tnt, [&cloud, &ground_truth])["f_score"], 1.0);
    for (flags, expected) in [
        (vec!["--preset", "dtu"], "--mask"),
        (vec!["--preset", "tnt"], "--tau"),
        (vec!["--tau", "1"], "--preset tnt"),
        (vec!["--preset", "tnt", "--thresholds", "1"], "--preset generic"),
    ] {
        let error = error_of(&eval(&[&["cloud"], &flags[..]].concat(), [&cloud, &ground_truth]));
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_scene_has_a_page_with_pictures() {
    let scene = Scene::new(96, 72, 4);
    let folder = true_maps(&scene);
    let classic = ["--consistency", "classic", "--min-views", "2"];
    expect_success(&vamvs().arg("fuse").arg(folder.root()).args(classic).output().unwrap());
    let result = json(&["scene"], [folder.root(), folder.root()]);
    assert_eq!(result["depth"]["total"][0]["relative"]["mean"], 0.0);
    let agreement = &result["cloud"]["agreement"][1];
    assert!(
        agreement["precision"].as_f64() > Some(0.99) && agreement["recall"].as_f64() > Some(0.95),
        "{agreement}"
    );
    // Pixels of the true surface are at most 0.1 apart. A wide threshold must not thin them for the narrow one.
    let both = json(&["scene", "--distances", "0.1,1"], [folder.root(), folder.root()]);
    let precisions = [0, 1].map(|at| both["cloud"]["agreement"][at]["precision"].as_f64());
    assert!(precisions.iter().all(|precision| *precision > Some(0.99)), "{precisions:?}");
    let distances = |cloud: &Value| [0, 1].map(|at| cloud["agreement"][at]["threshold"].as_f64().unwrap());
    let shares = json(&["scene", "--distances", "1%,0.5%"], [folder.root(), folder.root()]);
    assert_eq!(distances(&shares["cloud"]), distances(&result["cloud"]), "the defaults");
    let median = distances(&result["cloud"])[1] / 0.01;
    let mut medians = scene.views.iter().map(|view| {
        let mut depths: Vec<f32> = view.depth.data().iter().copied().filter(|depth| *depth > 0.0).collect();
        depths.sort_by(f32::total_cmp);
        f64::from(depths[depths.len() / 2])
    });
    assert!(medians.any(|of_view| (of_view - median).abs() < 1e-6 * median), "{median}");
    let page = std::fs::read_to_string(folder.root().join("eval.html")).unwrap();
    assert_eq!(result["page"].as_str(), folder.root().join("eval.html").to_str());
    assert_eq!(page.matches("data:image/png;base64,").count(), 4 + 4);
    assert!(page.contains("Completeness") && page.contains("F-score"));
    let cloud = std::fs::read(folder.cloud()).unwrap();
    let mut over = vamvs();
    over.args(["eval", "scene", "--html"]).args([&folder.cloud(), folder.root(), folder.root()]);
    assert!(error_of(&over.output().unwrap()).contains("was not written by vamvs"));
    assert!(std::fs::read(folder.cloud()).unwrap() == cloud);
}

#[cfg(feature = "torch")]
#[test]
fn networks_are_measured_stage_by_stage() {
    let scene = Scene::new(192, 144, 4);
    let ground_truth = true_maps(&scene);
    let run = |more: &[&str]| {
        let mut command = vamvs();
        command.args(["eval", "network", "photometric", "--data"]).arg(ground_truth.root());
        command.args(["--references", "2"]).args(more).output().unwrap()
    };
    let output = run(&["--views", "2", "4", "--json"]);
    expect_success(&output);
    let all: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let views: Vec<_> = all.as_array().unwrap().iter().map(|measured| measured["views"].as_u64()).collect();
    assert_eq!(views, [Some(2), Some(4)]);
    for measured in all.as_array().unwrap() {
        let stages = measured["scores"]["stages"].as_array().unwrap();
        assert_eq!(stages.len(), 4, "coarse and three iterations");
        let count = |stage: usize, what: &str| stages[stage]["overall"][what].as_f64().unwrap();
        assert_eq!([0, 3].map(|stage| count(stage, "pixels")), [2.0 * 24.0 * 18.0, 2.0 * 96.0 * 72.0]);
        let outliers = [0, 3].map(|stage| count(stage, "outliers") / count(stage, "pixels"));
        assert!(outliers[1] < 0.9 * outliers[0], "{outliers:?}");
        assert_eq!(stages[3]["invisible"]["pixels"], 0, "nobody told what source views see");
    }
    let one_view = run(&["--views", "1"]);
    assert_eq!(one_view.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&one_view.stderr).contains("--views must be 2 at least"));
}
