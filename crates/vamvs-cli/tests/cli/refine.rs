//! `vamvs refine` on true depth maps of an eighth of the size; needs no network.

use std::process::Output;

use crate::scene::{Scene, content, error_of, expect_success, right, vamvs, write};
use vamvs::core::{DepthMap, DepthRange, Grid, Rgb, Size};
use vamvs::io::pfm;
use vamvs::output::{OutputFolder, Record, SavedMap};

const SIZE: Size = Size::new(160, 120);

/// The scene's depth maps, reduced and three quarters of a per cent wrong.
fn coarse_maps(scene: &Scene) -> OutputFolder {
    let folder = OutputFolder::new(&scene.out());
    let names: Vec<String> = (0..scene.views.len()).map(|view| format!("{view:04}")).collect();
    folder.prepare(&names.iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
    let size = Size::new(SIZE.width / 8, SIZE.height / 8);
    for (name, view) in names.iter().zip(&scene.views) {
        let sign = |x: usize, y: usize| if (x + y).is_multiple_of(2) { 1.0 } else { -1.0 };
        let depth =
            Grid::from_fn(size, |x, y| view.depth[(8 * x + 4, 8 * y + 4)] * (1.0 + 0.0075 * sign(x, y)));
        let map = DepthMap {
            camera: view.photo.camera.resized(size),
            cam_from_world: view.photo.cam_from_world,
            depth,
            confidence: Grid::filled(size, 0.9),
            coarse_confidence: None,
        };
        let colour = Grid::filled(size, Rgb::default());
        let range = DepthRange::try_new(0.1, 100.0).unwrap();
        let record = Record { made_of: "ground_truth".into(), ..Record::default() };
        folder
            .save(name, &SavedMap { map: &map, range, colour: &colour, normals: None, sigma: None }, &record)
            .unwrap();
    }
    folder
}

fn refine(scene: &Scene, arguments: &[&str]) -> Output {
    let mut run = vamvs();
    run.arg("refine").arg(scene.out()).arg("--cams").arg(scene.path("cams"));
    run.arg("--images").arg(scene.path("images")).args(arguments).output().unwrap()
}

#[test]
fn depth_maps_get_the_size_of_their_photographs_and_come_nearer_to_the_truth() {
    let scene = Scene::new(SIZE.width, SIZE.height, 5);
    coarse_maps(&scene);
    let output = refine(&scene, &[]);
    expect_success(&output);
    let refined = OutputFolder::new(&scene.out().join("refined"));
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), refined.root().display().to_string());
    let depth = pfm::read_depth(&refined.depth("0002")).unwrap();
    assert_eq!(depth.size(), SIZE);
    let ground_truth = &scene.views[2].depth;
    let before =
        pfm::read_depth(&OutputFolder::new(&scene.out()).depth("0002")).unwrap().resized_nearest(SIZE);
    let (before, after) = (right(&before, ground_truth, 0.004), right(&depth, ground_truth, 0.004));
    assert!(after > 0.5 && after > 1.5 * before, "{before} → {after}");
    let normals = pfm::read_rgb(&refined.normals("0002")).unwrap();
    for (normal, depth) in normals.data().iter().zip(depth.data()) {
        let length = normal.iter().map(|c| c * c).sum::<f32>().sqrt();
        assert!((length - f32::from(u8::from(*depth > 0.0))).abs() < 1e-3);
    }
    expect_success(&vamvs().arg("fuse").arg(refined.root()).arg("--no-report").output().unwrap());
}

#[test]
fn what_is_done_is_kept_and_what_is_damaged_is_made_again_with_the_same_bytes() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    coarse_maps(&scene);
    expect_success(&refine(&scene, &["--threads", "1"]));
    let refined = scene.out().join("refined");
    let all = content(&refined);
    std::fs::remove_file(refined.join("normals/0001.pfm")).unwrap();
    write(&refined.join("depths/0002.pfm"), "damaged");
    let again = refine(&scene, &["--threads", "2", "--json"]);
    expect_success(&again);
    let said = String::from_utf8_lossy(&again.stdout).into_owned();
    assert!(said.contains("\"made\":2") && said.contains("\"resumed\":1"), "{said}");
    assert_eq!(content(&refined), all);
    // Other options make other depth maps.
    let photometric = refine(&scene, &["--no-geometric", "--json"]);
    assert!(String::from_utf8_lossy(&photometric.stdout).contains("\"made\":3"));
}

#[test]
fn depth_maps_are_not_refined_over_themselves() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    let folder = coarse_maps(&scene);
    let said = error_of(&refine(&scene, &["--out", &folder.root().display().to_string()]));
    assert!(said.contains("choose another folder"), "{said}");
}

#[test]
fn maps_of_another_scene_leave_no_folder() {
    let (scene, other) = (Scene::new(SIZE.width, SIZE.height, 3), Scene::new(SIZE.width, SIZE.height, 2));
    coarse_maps(&scene);
    for view in 0..2 {
        for (folder, end) in [("cams", "_cam.txt"), ("images", ".png")] {
            let name = |view: usize| other.path(&format!("{folder}/{view:04}{end}"));
            std::fs::rename(name(view), name(view + 7)).unwrap();
        }
    }
    std::fs::remove_file(other.path("pair.txt")).ok();
    let mut run = vamvs();
    run.arg("refine").arg(scene.out()).arg("--cams").arg(other.path("cams"));
    run.arg("--images").arg(other.path("images")).arg("--out").arg(other.path("new"));
    let said = error_of(&run.output().unwrap());
    assert!(said.contains("no depth map could be refined") && !other.path("new").exists(), "{said}");
}

#[test]
fn cameras_that_vamvs_has_not_written_stay() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    coarse_maps(&scene);
    let photographs = scene.path("photographs");
    std::fs::rename(scene.path("images"), &photographs).unwrap();
    let before = content(&scene.path("cams"));
    let mut run = vamvs();
    run.arg("refine").arg(scene.out()).arg("--cams").arg(scene.path("cams"));
    run.arg("--images").arg(&photographs).arg("--out").arg(&scene.root);
    let said = error_of(&run.output().unwrap());
    assert!(said.contains("_cam.txt") && said.contains("was not written by vamvs"), "{said}");
    assert!(content(&scene.path("cams")) == before && !scene.path("depths").exists());
}

#[test]
fn another_confidence_or_camera_of_a_depth_map_makes_it_anew() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    let folder = coarse_maps(&scene);
    let made = || {
        let output = refine(&scene, &["--json"]);
        expect_success(&output);
        let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        said["made"].as_u64().unwrap()
    };
    assert_eq!((made(), made()), (3, 0));
    let size = Size::new(SIZE.width / 8, SIZE.height / 8);
    pfm::write(&folder.confidence("0001"), &Grid::filled(size, 0.3)).unwrap();
    assert_eq!((made(), made()), (3, 0), "it is a source of all others");
    let camera = folder.cams().join("0002_cam.txt");
    let text = std::fs::read_to_string(&camera).unwrap();
    let moved = text.replacen("0.1 ", "0.2 ", 1);
    let moved = if moved == text { text.replacen("1.0", "0.99", 1) } else { moved };
    write(&camera, moved);
    assert!(made() > 0);
}

#[test]
fn a_folder_of_first_passes_that_vamvs_has_not_made_stays() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    coarse_maps(&scene);
    let own = scene.out().join("refined/photometric/images");
    std::fs::create_dir_all(&own).unwrap();
    write(&own.join("0001.png"), "mine");
    expect_success(&refine(&scene, &["--no-geometric"]));
    assert_eq!(std::fs::read(own.join("0001.png")).unwrap(), b"mine");
}

#[test]
fn flags_of_the_input_hold_beside_the_settings_of_the_run() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    expect_success(&scene.run("depth", &["--weights", "none", "--planes", "16", "--no-refine"]));
    let refine = |flags: &[&str]| {
        let mut run = vamvs();
        run.arg("refine").arg(scene.out()).arg("--no-geometric").args(flags).output().unwrap()
    };
    assert!(error_of(&refine(&["--masks", "nowhere"])).contains("expected a folder of masks"));
    assert!(error_of(&refine(&["--images", "nowhere"])).contains("nowhere"));
    std::fs::remove_file(scene.out().join("run.toml")).unwrap();
    let images = scene.path("images").display().to_string();
    expect_success(&refine(&["--images", &images]));
    let refined = OutputFolder::new(&scene.out().join("refined"));
    assert_eq!(pfm::read_depth(&refined.depth("0001")).unwrap().size(), SIZE);
}

#[test]
fn the_photographs_are_those_of_the_run_that_made_the_depth_maps() {
    let scene = Scene::new(SIZE.width, SIZE.height, 3);
    let run = ["--weights", "none", "--planes", "16", "--no-refine"];
    expect_success(&scene.run("depth", &run));
    let refine = || vamvs().arg("refine").arg(scene.out()).arg("--no-geometric").output().unwrap();
    expect_success(&refine());
    let refined = OutputFolder::new(&scene.out().join("refined"));
    assert_eq!(pfm::read_depth(&refined.depth("0001")).unwrap().size(), SIZE);
    // Without its settings there are only the photographs beside the depth maps, which are small.
    std::fs::remove_file(scene.out().join("run.toml")).unwrap();
    expect_success(&refine());
    assert!(pfm::read_depth(&refined.depth("0001")).unwrap().width() < SIZE.width);
}
