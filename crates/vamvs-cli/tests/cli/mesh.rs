//! `vamvs mesh`, of exact depth maps, so no network is needed.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::scene::{Scene, error_of, expect_success, vamvs, write};
use vamvs::io::{depth, ply};

/// The scene's true depth maps in a folder of their own.
fn maps(scene: &Scene) -> PathBuf {
    let folder = scene.path("maps/depth");
    std::fs::create_dir_all(&folder).unwrap();
    for (number, view) in scene.views.iter().enumerate() {
        depth::write(&folder.join(format!("{number:04}.npy")), &view.depth, 1.0).unwrap();
    }
    scene.path("maps")
}

fn mesh(scene: &Scene, depths: &Path, arguments: &[&str]) -> Output {
    let mut run = vamvs();
    run.arg("mesh").arg(depths).arg("--cams").arg(scene.path("cams"));
    run.arg("--images").arg(scene.path("images")).args(arguments).output().unwrap()
}

#[test]
fn depth_maps_become_a_mesh_in_each_format() {
    let scene = Scene::new(96, 64, 4);
    let folder = maps(&scene);
    let output = mesh(&scene, &folder, &["--json"]);
    expect_success(&output);
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let (vertices, triangles) = ply::read_mesh(&folder.join("mesh.ply")).unwrap();
    assert!(triangles.len() > 1000, "{}", triangles.len());
    assert_eq!(summary["triangles"], triangles.len());
    assert_eq!(summary["vertices"], vertices.len());
    let far = |x: &[f64; 3]| {
        scene.views.iter().all(|view| {
            let x_in_cam = view.photo.cam_from_world.transform(&(*x).into());
            let pixel = view.photo.camera.project_inside(&x_in_cam);
            pixel.is_none_or(|pixel| {
                let depth = f64::from(view.depth[(pixel.x as usize, pixel.y as usize)]);
                depth <= 0.0 || (x_in_cam.z - depth).abs() > 0.02 * depth
            })
        })
    };
    let wrong = vertices.iter().filter(|vertex| far(&vertex.x_in_world)).count();
    assert!(wrong * 100 < vertices.len(), "{wrong} of {}", vertices.len());

    let (glb, obj) = (scene.path("a.glb"), scene.path("a.obj"));
    for file in [&glb, &obj] {
        expect_success(&mesh(&scene, &folder, &["--out", file.to_str().unwrap()]));
    }
    let bytes = std::fs::read(&glb).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let described: serde_json::Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    assert_eq!(described["accessors"][0]["count"], vertices.len());
    assert_eq!(described["accessors"][3]["count"], 3 * triangles.len());
    let text = std::fs::read_to_string(&obj).unwrap();
    let lines = |begin: &str| text.lines().filter(|line| line.starts_with(begin)).count();
    assert_eq!((lines("v "), lines("vn "), lines("f ")), (vertices.len(), vertices.len(), triangles.len()));

    let coarse = scene.path("coarse.ply");
    expect_success(&mesh(
        &scene,
        &folder,
        &["--cell", "3", "--min-triangles", "10", "--out", coarse.to_str().unwrap()],
    ));
    assert!(3 * ply::read_mesh(&coarse).unwrap().1.len() < triangles.len());
    let output = vamvs()
        .args(["eval", "cloud"])
        .arg(&coarse)
        .arg(folder.join("mesh.ply"))
        .args(["--thresholds", "0.05", "--json"])
        .output();
    let scores: serde_json::Value = serde_json::from_slice(&output.unwrap().stdout).unwrap();
    let of = |measure: &str| scores["agreement"][0][measure].as_f64().unwrap();
    assert!(of("precision") > 0.9 && of("recall") > 0.75, "{scores}");
}

#[test]
fn what_is_no_mesh_is_not_written_and_nothing_else_is_lost() {
    let scene = Scene::new(96, 64, 4);
    let folder = maps(&scene);
    let error = error_of(&mesh(&scene, &folder, &["--out", scene.path("mesh.stl").to_str().unwrap()]));
    assert!(error.contains("mesh.stl") && error.contains(".ply, .obj or .glb"), "{error}");
    let other = scene.path("thesis.glb");
    write(&other, "not a mesh");
    let error = error_of(&mesh(&scene, &folder, &["--out", other.to_str().unwrap()]));
    assert!(error.contains("thesis.glb"), "{error}");
    assert_eq!(std::fs::read(&other).unwrap(), b"not a mesh");
    let error = error_of(&mesh(&scene, &folder, &["--cell", "0.01"]));
    assert!(error.contains("cell: expected 0.25 to 64 sizes of a pixel, found 0.01"), "{error}");
    let error = error_of(&mesh(&scene, &folder, &["--close-holes", "1000000"]));
    assert!(error.contains("close-holes: expected at most 1000 edges, found 1000000"), "{error}");
    let error = error_of(&mesh(&scene, &folder, &["--min-triangles", "1000000000"]));
    assert!(error.contains("no triangle is left") && error.contains("--min-triangles"), "{error}");
    let error = error_of(&vamvs().arg("mesh").arg(scene.path("images")).output().unwrap());
    assert!(error.contains("depth"), "{error}");
    assert!(!folder.join("mesh.ply").exists());
}
