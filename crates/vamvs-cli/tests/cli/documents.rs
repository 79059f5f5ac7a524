//! Runs the commands in the documents below `<!-- runs -->`, unchanged, in one folder and in the
//! order of the documents.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use serde_json::json;
use vamvs::core::{Camera, Lens, SparsePoint, View};
use vamvs::io::colmap::Model;
use vamvs::nalgebra::{Matrix4, Vector3, Vector4};

use crate::fuse::true_maps;
use crate::scene::{Scene, expect_success, write};

/// The documents with commands that are run.
const DOCUMENTS: [&str; 4] = ["README.md", "docs/guide.md", "docs/formats.md", "docs/evaluation.md"];

/// What stands above a block of commands that are run.
const MARK: &str = "<!-- runs -->";

#[test]
fn commands_in_the_documents_run() {
    let scene = Scene::new(160, 120, 5);
    lay_out(&scene);
    let binaries = Path::new(env!("CARGO_BIN_EXE_vamvs")).parent().unwrap();
    let path = format!("{}:{}", binaries.display(), std::env::var("PATH").unwrap());
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    for document in DOCUMENTS {
        let blocks = blocks(&std::fs::read_to_string(root.join(document)).unwrap());
        assert!(!blocks.is_empty(), "{document} has no commands that are run");
        for block in blocks {
            println!("{document}:\n{block}");
            let mut shell = Command::new("bash");
            shell.args(["-euxc", &block]).current_dir(&scene.root).env("PATH", &path);
            expect_success(&shell.output().unwrap());
        }
    }
    for made in
        ["out/fused.ply", "out/report.html", "out/eval.html", "fine/depths/0000.pfm", "out/openmvs/scene.mvs"]
    {
        assert!(scene.path(made).is_file(), "{made}");
    }
}

/// The blocks of commands below marks.
fn blocks(text: &str) -> Vec<String> {
    text.split(MARK)
        .skip(1)
        .map(|after| {
            let block =
                after.trim_start().strip_prefix("```sh\n").expect("a block of commands follows the mark");
            block.split_once("```").expect("the block ends").0.to_owned()
        })
        .collect()
}

/// The folders that the documents use, apart from `cams` and `images`.
fn lay_out(scene: &Scene) {
    std::fs::rename(true_maps(scene).root(), scene.path("ground-truth")).unwrap();
    let model = Model::from_scene(&sparse(scene));
    for folder in ["sparse/0", "capture", "depth-maps"] {
        std::fs::create_dir_all(scene.path(folder)).unwrap();
    }
    for view in 0..scene.views.len() {
        let from = scene.path(&format!("ground-truth/depths/{view:04}.pfm"));
        std::fs::copy(from, scene.path(&format!("depth-maps/{view:04}.pfm"))).unwrap();
    }
    model.write_text(&scene.path("sparse/0")).unwrap();
    write(&scene.path("capture/transforms.json"), transforms(scene));
    symlink("../images", scene.path("capture/images")).unwrap();
    symlink("out/colmap", scene.path("dense")).unwrap();
    symlink("out", scene.path("network-output")).unwrap();
}

/// The scene as structure from motion finds it: cameras, and points of the surfaces.
fn sparse(scene: &Scene) -> vamvs::core::Scene {
    let views = scene.views.iter().enumerate().map(|(number, view)| View {
        id: number as u32 + 1,
        name: format!("{number:04}.png"),
        camera: Camera {
            size: view.photo.camera.size,
            intrinsics: view.photo.camera.intrinsics,
            lens: Lens::None,
        },
        cam_from_world: view.photo.cam_from_world,
        depth_range: None,
    });
    let (camera, pose) = (&scene.views[0].photo.camera, &scene.views[0].photo.cam_from_world);
    let world_from_cam = pose.inverse();
    let size = scene.views[0].depth.size();
    let places = (0..size.height).step_by(8).flat_map(|y| (0..size.width).step_by(8).map(move |x| (x, y)));
    let points = places.filter(|&at| scene.views[0].depth[at] > 0.0).map(|(x, y)| {
        let k = &camera.intrinsics;
        let ray = Vector3::new((x as f64 + 0.5 - k.cx) / k.fx, (y as f64 + 0.5 - k.cy) / k.fy, 1.0);
        let x_in_world = world_from_cam.transform(&(ray * f64::from(scene.views[0].depth[(x, y)])));
        SparsePoint { x_in_world, views: (0..scene.views.len()).collect() }
    });
    vamvs::core::Scene { views: views.collect(), points: points.collect(), pairs: None }
}

/// The scene as nerfstudio writes it: cameras that look along −z, with y up.
fn transforms(scene: &Scene) -> String {
    let frames = scene.views.iter().enumerate().map(|(number, view)| {
        let (camera, pose) = (&view.photo.camera, view.photo.cam_from_world.inverse());
        let turned = Matrix4::from_diagonal(&Vector4::new(1.0, -1.0, -1.0, 1.0));
        let mut world_from_cam = pose.rotation.to_homogeneous();
        world_from_cam.fixed_view_mut::<3, 1>(0, 3).copy_from(&pose.translation);
        let columns = (world_from_cam * turned).transpose();
        let rows: Vec<&[f64]> = columns.as_slice().chunks(4).collect();
        let k = &camera.intrinsics;
        json!({
            "file_path": format!("images/{number:04}.png"), "transform_matrix": rows,
            "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy, "w": camera.size.width, "h": camera.size.height,
        })
    });
    json!({"camera_model": "OPENCV", "frames": frames.collect::<Vec<_>>()}).to_string()
}
