//! `vamvs fuse` on depth maps with exact ground truth; needs no network.

use crate::scene::{Scene, error_of, expect_success, stderr, truncate, vamvs, write};
use vamvs::core::{Camera, DepthMap, Grid, Lens, MonotoneMap, Source, View};
use vamvs::output::{ConfidenceKind, OutputFolder, Record, SavedMap};

/// The true depth maps of a scene as an output folder.
pub fn true_maps(scene: &Scene) -> OutputFolder {
    maps_of_confidence(scene, 1.0, &ConfidenceKind::Refined)
}

/// The true depth maps of a scene with this confidence as an output folder.
fn maps_of_confidence(scene: &Scene, confidence: f32, kind: &ConfidenceKind) -> OutputFolder {
    let folder = OutputFolder::new(&scene.out());
    let names: Vec<String> = (0..scene.views.len()).map(|i| format!("{i:04}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let all = (0..names.len()).map(|view| Source { view, score: 1.0 });
    let others = |view: usize| all.clone().filter(|other| other.view != view).collect();
    folder.prepare(&names).unwrap();
    for (name, view) in names.iter().zip(&scene.views) {
        let map = DepthMap {
            camera: view.photo.camera,
            cam_from_world: view.photo.cam_from_world,
            depth: view.depth.clone(),
            confidence: Grid::filled(view.depth.size(), confidence),
            coarse_confidence: None,
        };
        let range = vamvs_tests::folder::depth_range(view, 1.05).unwrap();
        let saved = SavedMap { map: &map, range, colour: &view.photo.image, normals: None, sigma: None };
        let record = Record { made_of: "ground_truth".into(), confidence: kind.clone(), ..Record::default() };
        folder.save(name, &saved, &record).unwrap();
    }
    folder.write_pairs(&names, &(0..names.len()).map(others).collect::<Vec<_>>()).unwrap();
    folder
}

#[test]
fn true_depth_maps_give_a_cloud_on_the_true_surface() {
    let scene = Scene::new(160, 120, 5);
    let folder = true_maps(&scene);
    let output = vamvs().arg("fuse").arg(folder.root().join("depths")).output().unwrap();
    expect_success(&output);
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), folder.cloud().display().to_string());
    let cloud = vamvs::io::ply::read(&folder.cloud()).unwrap();
    assert!(cloud.len() > 10_000, "{} points", cloud.len());
    // Each point is where the middle view sees its surface, unless something hides it there.
    let view = &scene.views[2];
    let (mut near, mut seen) = (0, 0);
    for point in &cloud {
        let x_in_cam = view.photo.cam_from_world.transform(&point.x_in_world.into());
        let Some(pixel) = view.photo.camera.project_inside(&x_in_cam) else { continue };
        let ground_truth = f64::from(view.depth[(pixel.x as usize, pixel.y as usize)]);
        if x_in_cam.z < ground_truth * 1.05 {
            seen += 1;
            near += usize::from((x_in_cam.z - ground_truth).abs() < 0.02 * ground_truth);
        }
    }
    assert!(near as f64 > 0.97 * f64::from(seen), "{near} of {seen}");
}

#[test]
fn masks_that_match_no_view_are_an_error_that_names_what_was_sought_and_found() {
    let scene = Scene::new(96, 64, 3);
    let folder = true_maps(&scene);
    let masks = scene.path("stencils");
    std::fs::create_dir(&masks).unwrap();
    let run = |command: &str| {
        let mut run = vamvs();
        match command {
            "fuse" => run.arg("fuse").arg(folder.root()),
            _ => run
                .args(["depth", "--weights", "none", "--cams"])
                .arg(scene.path("cams"))
                .arg("--images")
                .arg(scene.path("images"))
                .arg("--out")
                .arg(scene.path("other")),
        };
        run.arg("--masks").arg(&masks).output().unwrap()
    };
    for command in ["fuse", "depth"] {
        assert!(error_of(&run(command)).contains("found an empty folder"));
    }
    write(&masks.join("m0.png"), "a mask of nothing");
    for command in ["fuse", "depth"] {
        let said = error_of(&run(command));
        assert!(said.contains("none of the 3 views has a mask") && said.contains("0000_mask.png"), "{said}");
        assert!(said.contains("found m0.png"), "{said}");
    }
}

#[test]
fn nothing_survives_absurdly_strict_filters_and_that_is_an_error_with_the_reasons() {
    let scene = Scene::new(96, 64, 3);
    let folder = true_maps(&scene);
    write(&folder.cloud(), "ply, an older cloud");
    let output = vamvs().arg("fuse").arg(folder.root()).args(["--min-views", "9"]).output().unwrap();
    let said = error_of(&output);
    assert!(said.contains("no point survived") && said.contains("inconsistent with other views"), "{said}");
    assert_eq!(std::fs::read(folder.cloud()).unwrap(), b"ply, an older cloud");
}

#[test]
fn the_papers_preset_filters_by_the_networks_probability() {
    let scene = Scene::new(96, 64, 5);
    // The network's probability of 0.1 is a share of 0.6 here, and 0.05 one of 0.5.
    let map = MonotoneMap::try_new(vec![[0.0, 0.4], [0.1, 0.6], [1.0, 1.0]]).unwrap();
    let fuse = |confidence: f32, kind: &ConfidenceKind| {
        let folder = maps_of_confidence(&scene, confidence, kind);
        let output = vamvs().arg("fuse").arg(folder.root()).args(["--preset", "dtu"]).output().unwrap();
        std::fs::remove_dir_all(folder.root()).unwrap();
        output
    };
    let calibrated = ConfidenceKind::Calibrated(map);
    expect_success(&fuse(0.61, &calibrated));
    assert!(error_of(&fuse(0.59, &calibrated)).contains("no point survived"));
    expect_success(&fuse(0.11, &ConfidenceKind::Probability));
    assert!(error_of(&fuse(0.09, &ConfidenceKind::Probability)).contains("no point survived"));
    let said = error_of(&fuse(1.0, &ConfidenceKind::Refined));
    assert!(said.contains("0000 is refined") && said.contains("--no-refine"), "{said}");
}

#[test]
fn masks_and_regions_leave_no_point_outside() {
    let scene = Scene::new(128, 96, 4);
    let folder = true_maps(&scene);
    std::fs::create_dir_all(scene.path("masks")).unwrap();
    let size = scene.views[0].depth.size();
    let black_left = Grid::from_fn(size, |x, _| if x < size.width / 2 { 0_u16 } else { u16::MAX });
    for view in 0..4 {
        vamvs::io::image::save_png_gray16(&scene.path(&format!("masks/{view:04}.png")), &black_left).unwrap();
    }
    let out = scene.path("part.ply");
    let run = |arguments: &[&str]| {
        let output =
            vamvs().arg("fuse").arg(folder.root()).arg("--out").arg(&out).args(arguments).output().unwrap();
        expect_success(&output);
        vamvs::io::ply::read(&out).unwrap()
    };
    let all = run(&[]);
    let masks = scene.path("masks");
    let masked = run(&["--masks", masks.to_str().unwrap(), "--min-views", "2"]);
    assert!(!masked.is_empty() && masked.len() < all.len());
    let roi = run(&["--roi", "-0.5", "-0.5", "0.1", "0.5", "0.5", "1"]);
    assert!(!roi.is_empty() && roi.len() < all.len());
    for point in &roi {
        let [x, y, z] = point.x_in_world;
        // Up to the single precision of the file.
        assert!(x.abs() < 0.500_001 && y.abs() < 0.500_001 && (0.099_999..1.000_001).contains(&z));
    }
}

#[test]
fn folders_that_are_none_and_broken_maps_are_named() {
    let scene = Scene::new(96, 64, 3);
    let missing = error_of(&vamvs().arg("fuse").arg(scene.path("nothing")).output().unwrap());
    assert!(missing.contains("nothing") && missing.contains("depths/"), "{missing}");
    let folder = true_maps(&scene);
    ["0001", "0002"].iter().for_each(|name| truncate(&folder.depth(name)));
    let broken = error_of(&vamvs().arg("fuse").arg(folder.root()).output().unwrap());
    assert!(broken.contains("0001.pfm") && broken.contains("0002.pfm"), "{broken}");
    assert!(broken.contains("at least 2"), "{broken}");
    assert!(!folder.cloud().exists());
}

#[test]
fn damaged_maps_are_left_out_as_if_they_were_not_there_and_told() {
    let scene = Scene::new(96, 64, 6);
    let folder = true_maps(&scene);
    truncate(&folder.depth("0001"));
    let small = Grid::filled(vamvs::core::Size::new(9, 9), 1.0);
    vamvs::io::pfm::write(&folder.confidence("0003"), &small).unwrap();
    let fuse = |arguments: &[&str]| {
        vamvs().arg("fuse").arg(folder.root()).args(["--min-views", "2"]).args(arguments).output().unwrap()
    };
    let strict = error_of(&fuse(&["--strict"]));
    assert!(strict.contains("--strict") && strict.contains("0001.pfm"), "{strict}");
    assert!(!folder.cloud().exists());
    let output = fuse(&["--json"]);
    expect_success(&output);
    let said = stderr(&output);
    assert!(said.contains("warning: 0001 is left out") && said.contains("2 views left out"), "{said}");
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let reason = |view: usize| told["skipped"][view]["reason"].as_str().unwrap();
    assert!(reason(0).contains("0001.pfm") && reason(1).contains("9×9"), "{told}");
    let page = std::fs::read_to_string(folder.root().join("report.html")).unwrap();
    assert!(page.contains("Views left out") && page.matches("0001.pfm").count() == 1);
    let without = std::fs::read(folder.cloud()).unwrap();
    ["0001", "0003"].iter().for_each(|name| std::fs::remove_file(folder.depth(name)).unwrap());
    expect_success(&fuse(&[]));
    assert!(std::fs::read(folder.cloud()).unwrap() == without);
}

#[test]
fn names_differ_even_where_photographs_differ_only_in_folder_or_extension() {
    let view = |name: &str| View {
        id: 0,
        name: name.to_owned(),
        camera: Camera {
            size: vamvs::core::Size::new(8, 8),
            intrinsics: vamvs::core::Intrinsics { fx: 1.0, fy: 1.0, cx: 4.0, cy: 4.0 },
            lens: Lens::None,
        },
        cam_from_world: vamvs::core::Pose::identity(),
        depth_range: None,
    };
    let names = vamvs::output::names(&[view("a/x.jpg"), view("b/x.jpg"), view("y.jpg"), view("y.png")]);
    assert_eq!(names, ["a__x", "b__x", "y.jpg", "y.png"]);
    let names = vamvs::output::names(&[view("a/x.jpg"), view("a__x.jpg"), view("a__x.png")]);
    assert_eq!(names, ["a__x.jpg", "a__x.jpg_1", "a__x.png"]);
    let help = vamvs().args(["fuse", "--help"]).output().unwrap();
    assert!(help.status.success() && stderr(&help).is_empty());
}
