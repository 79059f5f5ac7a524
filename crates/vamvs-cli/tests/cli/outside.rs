//! Depth maps of other programs, whose cameras and photographs are given; exact, so no network is needed.

use std::path::{Path, PathBuf};

use crate::scene::{Scene, error_of, expect_success, stderr, vamvs, write};
use vamvs::io::depth;

/// Writes the scene's true depth maps to a folder, named by `name`.
fn maps(scene: &Scene, folder: &str, name: impl Fn(usize) -> String, step: f64) -> PathBuf {
    let folder = scene.path(folder);
    std::fs::create_dir_all(&folder).unwrap();
    for (number, view) in scene.views.iter().enumerate() {
        depth::write(&folder.join(name(number)), &view.depth, step).unwrap();
    }
    folder
}

fn fuse(scene: &Scene, depths: &Path, arguments: &[&str]) -> std::process::Output {
    let mut run = vamvs();
    run.arg("fuse").arg(depths).arg("--cams").arg(scene.path("cams"));
    run.arg("--images").arg(scene.path("images")).args(arguments).output().unwrap()
}

#[test]
fn maps_in_any_format_and_folder_are_fused_with_the_cameras_that_are_given() {
    /// The folder that is written, the one that is given, and how files are named.
    type Layout = (&'static str, &'static str, fn(usize) -> String);
    let scene = Scene::new(96, 64, 4);
    let layouts: [Layout; 4] = [
        ("a/depth_est", "a", |view| format!("{view:04}.npy")),
        ("b/depth", "b/depth", |view| format!("{view:04}_depth.exr")),
        ("c", "c", |view| format!("depth_{view:04}.pfm")),
        ("d/depths", "d", |view| format!("{view:04}.png")),
    ];
    for (folder, given, name) in layouts {
        maps(&scene, folder, name, 0.0002);
        let cloud = scene.path(&format!("{}.ply", &folder[..1]));
        let step = if folder.starts_with('d') { &["--png-step", "0.0002"][..] } else { &[] };
        let out = ["--out", cloud.to_str().unwrap()];
        let output = fuse(&scene, &scene.path(given), &[&out[..], step].concat());
        expect_success(&output);
        let points = vamvs::io::ply::read(&cloud).unwrap().len();
        assert!(points > 4_000, "{folder}: {points} points");
    }
    let error = error_of(&fuse(&scene, &scene.path("d"), &[]));
    assert!(error.contains(".png") && error.contains("--png-step"), "{error}");
}

#[test]
fn refine_takes_flat_folders_too() {
    let scene = Scene::new(96, 64, 4);
    let folder = maps(&scene, "flat", |view| format!("{view:04}.npy"), 1.0);
    let mut run = vamvs();
    run.arg("refine").arg(&folder).arg("--cams").arg(scene.path("cams"));
    expect_success(&run.arg("--images").arg(scene.path("images")).output().unwrap());
    let refined = vamvs::output::OutputFolder::new(&folder.join("refined"));
    let sigma = vamvs::io::pfm::read(&refined.sigma("0001")).unwrap();
    let depth = vamvs::io::pfm::read_depth(&refined.depth("0001")).unwrap();
    let known = |(sigma, depth): (&f32, &f32)| (*sigma > 0.0) == (*depth > 0.0) && sigma <= depth;
    assert!(sigma.data().iter().zip(depth.data()).all(known));
    let cloud = scene.path("refined.ply");
    let fused = |arguments: &[&str]| {
        let mut run = vamvs();
        run.arg("fuse").arg(refined.root()).arg("--out").arg(&cloud).args(arguments);
        expect_success(&run.output().unwrap());
        vamvs::io::ply::read(&cloud).unwrap()
    };
    let all = fused(&[]);
    let mut sigmas: Vec<f32> = all.iter().map(|point| point.sigma).collect();
    sigmas.sort_unstable_by(f32::total_cmp);
    assert!(sigmas[0] > 0.0, "each point has a standard deviation");
    let middle = sigmas[sigmas.len() / 2];
    let some = fused(&["--max-sigma", &middle.to_string()]);
    assert!(some.iter().all(|point| point.sigma <= middle) && 2 * some.len() <= all.len() + 2);
}

#[test]
fn what_is_missing_is_told_with_what_was_sought() {
    let scene = Scene::new(96, 64, 4);
    let folder = maps(&scene, "maps/depth", |view| format!("{view:04}.npy"), 1.0);
    let run = |arguments: &[&str]| vamvs().arg("fuse").arg(&folder).args(arguments).output().unwrap();
    let error = error_of(&run(&[]));
    assert!(error.contains("cams/") && error.contains("--colmap"), "{error}");
    let error = error_of(&run(&["--images", scene.path("images").to_str().unwrap()]));
    assert!(error.contains("--images needs the scene"), "{error}");
    std::fs::remove_file(folder.join("0002.npy")).unwrap();
    let output = fuse(&scene, &folder, &[]);
    expect_success(&output);
    let warning = stderr(&output);
    assert!(warning.contains("1 view(s)") && warning.contains("0002, 0002_depth"), "{warning}");
    for name in ["0000.npy", "0001.npy", "0003.npy"] {
        std::fs::rename(folder.join(name), folder.join(format!("view{name}"))).unwrap();
    }
    let error = error_of(&fuse(&scene, &folder, &[]));
    assert!(error.contains("expected for 0000.png one of 0000") && error.contains("view0000.npy"), "{error}");
    for name in ["0000.npy", "0001.npy"] {
        write(&folder.join(name), b"\x93NUMPY");
    }
    let error = error_of(&fuse(&scene, &folder, &[]));
    assert!(error.contains("0000.npy") && error.contains("NumPy"), "{error}");
}
