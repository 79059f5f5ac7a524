//! `vamvs info` on files and folders.

use std::path::Path;

use serde_json::Value;
use vamvs::core::{CloudPoint, Grid, Size};
use vamvs::io::{pfm, ply};

use crate::fuse::true_maps;
use crate::scene::{Scene, error_of, expect_success, vamvs};

fn info(what: &Path) -> Value {
    let output = vamvs().args(["info", "--json"]).arg(what).output().unwrap();
    expect_success(&output);
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn folders_are_told_apart() {
    let scene = Scene::new(64, 48, 3);
    let facts = info(&scene.root);
    assert!(facts["kind"].as_str().unwrap().contains("MVSNet"), "{facts}");
    assert_eq!((facts["views"].as_u64(), facts["size"].as_str()), (Some(3), Some("64×48")));
    let [images, model] = ["images", "model/sparse/0"].map(|folder| scene.path(folder));
    scene.write_colmap("model/sparse/0");
    for folder in [&model, &scene.path("model")] {
        let facts = info(folder);
        assert_eq!((facts["kind"].as_str(), facts["images"].as_u64()), (Some("COLMAP model"), Some(3)));
        assert!(facts["folder"].as_str().unwrap().ends_with("model/sparse/0"), "{facts}");
    }
    let maps = true_maps(&scene);
    let facts = info(maps.root());
    assert_eq!((facts["kind"].as_str(), facts["views"].as_u64()), (Some("depth maps"), Some(3)));
    assert_eq!((facts["refined"].as_u64(), facts.get("cloud")), (Some(3), None));
    let nothing = vamvs().arg("info").arg(&images).output().unwrap();
    assert!(error_of(&nothing).contains("images"));
}

#[test]
fn a_capture_tells_what_would_be_done_with_it() {
    let scene = Scene::new(96, 64, 4);
    let facts = info(&scene.root);
    assert_eq!((facts["points"].as_u64(), facts["compared with"].as_str()), (Some(0), Some("3")), "{facts}");
    assert_eq!(facts["depth range from"]["the scene's files"], 4);
    let command = facts["command"].as_str().unwrap();
    assert!(command.starts_with("vamvs reconstruct --cams ") && command.contains(" --images "), "{command}");
    // Without the photographs the model is told, and why there is no more.
    scene.write_colmap("model/sparse/0");
    let facts = info(&scene.path("model"));
    assert_eq!(facts["images"], 4);
    assert!(facts["warnings"][0].as_str().unwrap().contains("images"), "{facts}");
    std::fs::rename(scene.path("images"), scene.path("model/images")).unwrap();
    std::fs::remove_file(scene.path("model/images/0003.png")).unwrap();
    let facts = info(&scene.path("model"));
    assert_eq!((facts["views"].as_u64(), facts["depth range from"].as_object().unwrap().len()), (Some(4), 1));
    assert!(facts["warnings"][0].as_str().unwrap().contains("0003.png"), "{facts}");
    assert!(facts["command"].as_str().unwrap().contains("model/images"), "{facts}");
}

#[test]
fn files_tell_their_sizes() {
    let scene = Scene::new(64, 48, 2);
    let normals = scene.path("normals.pfm");
    pfm::write_rgb(&normals, &Grid::filled(Size::new(5, 4), [0.0, 0.0, -1.0])).unwrap();
    let facts = info(&normals);
    assert!(facts["kind"].as_str().unwrap().contains("normals") && facts["size"] == "5×4", "{facts}");
    let depth = scene.path("depth.pfm");
    pfm::write(&depth, &Grid::from_vec(Size::new(2, 2), vec![0.0, 1.0, 2.0, 4.0])).unwrap();
    let facts = info(&depth);
    assert_eq!((facts["valid"].as_f64(), facts["max"].as_f64()), (Some(0.75), Some(4.0)));
    let cloud = scene.path("cloud.ply");
    let point = |normal| CloudPoint {
        x_in_world: [1.0, 2.0, 3.0],
        normal,
        colour: [9; 3],
        confidence: 1.0,
        sigma: 0.0,
        views: 2,
    };
    for (normal, expected) in [([0.0; 3], false), ([0.0, 0.0, 1.0], true)] {
        ply::write(&cloud, &[point(normal)]).unwrap();
        assert_eq!(
            (info(&cloud)["points"].as_u64(), info(&cloud)["normals"].as_bool()),
            (Some(1), Some(expected))
        );
    }
}
