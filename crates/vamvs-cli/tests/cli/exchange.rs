//! Depth maps of other programs in, and for other programs out.

use std::path::{Path, PathBuf};

use crate::fuse::true_maps;
use crate::scene::{Scene, content, error_of, expect_success, stderr, vamvs, write};
use vamvs::core::{Cloud, Grid, Lens};
use vamvs::io::colmap::{Model, dense};
use vamvs::io::{image, pfm, ply};

fn fuse(folder: &Path, arguments: &[&str]) -> Cloud {
    let output = vamvs().arg("fuse").arg(folder).args(arguments).output().unwrap();
    expect_success(&output);
    ply::read(&PathBuf::from(String::from_utf8(output.stdout).unwrap().trim())).unwrap()
}

/// Whether two clouds are the same but for the last digits, which cameras lose on their way through files.
fn expect_same(a: &Cloud, b: &Cloud) {
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        let moved = (0..3).map(|i| (a.x_in_world[i] - b.x_in_world[i]).abs()).fold(0.0, f64::max);
        assert!(moved < 1e-5 && a.views == b.views && a.colour == b.colour, "{a:?} or {b:?}");
    }
}

/// The lists of a `.vis` file.
fn seen_by(path: &Path) -> Vec<Vec<u32>> {
    let bytes = std::fs::read(path).unwrap();
    let mut numbers = bytes[8..].as_chunks::<4>().0.iter().map(|&bytes| u32::from_le_bytes(bytes));
    let mut lists = Vec::new();
    while let Some(count) = numbers.next() {
        lists.push(numbers.by_ref().take(count as usize).collect());
    }
    assert_eq!(bytes[..8], (lists.len() as u64).to_le_bytes());
    lists
}

#[test]
fn a_workspace_for_colmap_holds_what_was_fused_and_fuses_to_the_same() {
    let scene = Scene::new(128, 96, 5);
    let folder = true_maps(&scene);
    let cloud = fuse(folder.root(), &["--export", "colmap"]);
    let workspace = folder.root().join("colmap");
    expect_same(&ply::read(&workspace.join("fused.ply")).unwrap(), &cloud);
    let lists = seen_by(&workspace.join("fused.ply.vis"));
    assert_eq!(lists.len(), cloud.len());
    assert!(lists.iter().zip(&cloud).all(|(views, point)| views.len() == usize::from(point.views)));
    let model = Model::read(&workspace.join("sparse")).unwrap();
    let names: Vec<_> = model.images.iter().map(|image| image.name.as_str()).collect();
    assert_eq!(names, ["0000.png", "0001.png", "0002.png", "0003.png", "0004.png"]);
    assert!(model.cameras.values().all(|camera| camera.lens == Lens::None && camera.size.width == 128));
    for point in model.points.iter().step_by(97) {
        for &(image, keypoint) in &point.track {
            let image = &model.images[image as usize - 1];
            let seen = image.observations[keypoint as usize];
            let pixel =
                model.cameras[&image.camera_id].project(&image.cam_from_world.transform(&point.x_in_world));
            assert!(seen.point_id == Some(point.id) && (pixel.unwrap() - seen.pixel).norm() < 1e-6);
        }
    }
    let map = |view: usize| dense::depth_map_path(&workspace, names[view], dense::MapKind::Geometric);
    assert!(dense::read_depth_map(&map(2)).unwrap() == scene.views[2].depth);
    // Fused again from there: neighbours come from the model's points now, all four others as before.
    expect_same(&fuse(&workspace, &[]), &cloud);
    assert!(workspace.join("vamvs.ply").is_file(), "COLMAP's fused.ply is left alone");
    expect_same(&fuse(&workspace.join("stereo"), &["--out", scene.path("b.ply").to_str().unwrap()]), &cloud);
}

#[test]
fn the_folder_of_a_network_is_fused_like_our_own() {
    let scene = Scene::new(128, 96, 4);
    let folder = true_maps(&scene);
    let cloud = fuse(folder.root(), &[]);
    let network = scene.path("network");
    std::fs::rename(folder.root(), &network).unwrap();
    std::fs::rename(network.join("depths"), network.join("depth_est")).unwrap();
    expect_same(&fuse(&network, &[]), &cloud);
    expect_same(&fuse(&network.join("depth_est"), &[]), &cloud);
    // Our export beside the network's maps does not take their place.
    expect_same(&fuse(&network, &["--depth-format", "exr"]), &cloud);
    expect_same(&fuse(&network, &[]), &cloud);
    // A network without confidence maps, and with one depth map missing.
    std::fs::remove_dir_all(network.join("confidence")).unwrap();
    std::fs::remove_file(network.join("depth_est/0003.pfm")).unwrap();
    let fewer = fuse(&network, &[]);
    assert!(!fewer.is_empty() && fewer.len() < cloud.len());
}

#[test]
fn parts_of_a_fusion_are_not_used_for_other_depth_maps() {
    let scene = Scene::new(128, 96, 4);
    let network = scene.path("network");
    std::fs::rename(true_maps(&scene).root(), &network).unwrap();
    std::fs::rename(network.join("depths"), network.join("depth_est")).unwrap();
    let step = |step: &str, part: [&str; 2]| {
        let output = vamvs().arg("fuse").arg(&network).args(["--step", step]).args(part).output().unwrap();
        expect_success(&output);
        stderr(&output)
    };
    let done = || ["confirm", "merge"].map(|pass| step(pass, ["--part", "1/1"]).contains("was done"));
    assert_eq!((done(), done()), ([false; 2], [true; 2]));
    // A file of the same size.
    let confidence = network.join("confidence/0002.pfm");
    pfm::write(&confidence, &Grid::filled(scene.views[2].depth.size(), 0.2)).unwrap();
    assert_eq!(done(), [false; 2]);
    step("concatenate", ["--parts", "1"]);
    let cloud = std::fs::read(network.join("vamvs.ply")).unwrap();
    fuse(&network, &[]);
    assert!(std::fs::read(network.join("vamvs.ply")).unwrap() == cloud);
}

/// In UTM coordinates the floats of OpenMVS are half a metre apart: the export is moved to an origin of its own, which a file tells.
#[test]
fn a_scene_far_from_the_origin_is_moved_for_openmvs() {
    let scene = Scene::new(128, 96, 4);
    let folder = true_maps(&scene);
    let far = nalgebra::Vector3::new(431_200.25, 5_412_300.5, 210.0);
    for (index, view) in scene.views.iter().enumerate() {
        let mut pose = view.photo.cam_from_world;
        pose.translation -= pose.rotation * far;
        let file = folder.root().join(format!("cams/{index:04}_cam.txt"));
        vamvs::io::mvsnet::write_cam(&file, &view.photo.camera, &pose, None).unwrap();
    }
    let cloud = folder.root().join("fused.ply");
    let output = vamvs().arg("fuse").arg(folder.root()).args(["--export", "openmvs"]).output().unwrap();
    expect_success(&output);
    assert!(stderr(&output).contains("the scene is moved by"), "{}", stderr(&output));
    let exported = folder.root().join("openmvs");
    let origin = std::fs::read_to_string(exported.join("origin.txt")).unwrap();
    let origin: Vec<f64> = origin.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let origin = nalgebra::Vector3::from_column_slice(&origin);
    assert!((origin - far).norm() < 20.0, "{origin}");
    let moved = vamvs::io::openmvs::read_scene(&exported.join("scene.mvs"), None).unwrap().scene;
    for (view, expected) in moved.views.iter().zip(&scene.views) {
        let centre = view.cam_from_world.centre() + origin - far;
        assert!((centre - expected.photo.cam_from_world.centre()).norm() < 1e-6);
    }
    let (whole, dense) = (
        vamvs::io::ply::read(&cloud).unwrap(),
        vamvs::io::ply::read(&exported.join("scene_dense.ply")).unwrap(),
    );
    assert!(whole.len() == dense.len() && !whole.is_empty());
    for (world, local) in whole.iter().zip(&dense) {
        let back = nalgebra::Vector3::from(local.x_in_world) + origin;
        assert!((back - nalgebra::Vector3::from(world.x_in_world)).norm() < 1e-5);
    }
    // Near the origin nothing is moved, and the file goes.
    for (index, view) in scene.views.iter().enumerate() {
        let file = folder.root().join(format!("cams/{index:04}_cam.txt"));
        vamvs::io::mvsnet::write_cam(&file, &view.photo.camera, &view.photo.cam_from_world, None).unwrap();
    }
    fuse(folder.root(), &["--export", "openmvs"]);
    assert!(!exported.join("origin.txt").exists());
}

#[test]
fn nothing_is_exported_over_what_is_read() {
    let scene = Scene::new(64, 48, 3);
    let folder = true_maps(&scene);
    fuse(folder.root(), &["--export", "colmap"]);
    let workspace = folder.root().join("colmap");
    let before = content(&workspace);
    let again = |arguments: &[&str]| {
        let cloud = folder.root().join("again.ply");
        let output = vamvs().arg("fuse").arg(&workspace).arg("--out").arg(&cloud).args(arguments).output();
        assert!(error_of(&output.unwrap()).contains("choose another --out"));
        assert!(!cloud.exists());
    };
    again(&["--export", "colmap"]);
    #[cfg(feature = "torch")]
    {
        let mut reconstruct = vamvs();
        reconstruct.args(["reconstruct", "--export", "colmap", "--weights", "photometric"]);
        reconstruct
            .arg("--colmap")
            .arg(workspace.join("sparse"))
            .arg("--images")
            .arg(workspace.join("images"));
        let output = reconstruct.arg("--out").arg(folder.root()).output().unwrap();
        assert!(error_of(&output).contains("choose another --out"));
    }
    assert!(content(&workspace) == before);
}

#[test]
fn an_export_may_be_asked_for_twice_and_a_folder_is_no_cloud() {
    let scene = Scene::new(64, 48, 3);
    let folder = true_maps(&scene);
    fuse(folder.root(), &["--export", "colmap,colmap"]);
    let output = vamvs().arg("fuse").arg(folder.root()).arg("--out").arg(&scene.root).output().unwrap();
    let said = error_of(&output);
    assert!(said.contains("directory") && !said.contains("points"), "{said}");
}

#[test]
fn nothing_is_exported_over_what_vamvs_has_not_written() {
    let scene = Scene::new(64, 48, 3);
    let folder = true_maps(&scene);
    let model = folder.root().join("colmap/sparse/points3D.bin");
    std::fs::create_dir_all(model.parent().unwrap()).unwrap();
    write(&model, "of somebody");
    let refused = |arguments: &[&str]| {
        let said = error_of(&vamvs().arg("fuse").arg(folder.root()).args(arguments).output().unwrap());
        assert!(said.contains("was not written by vamvs"), "{said}");
        assert!(!folder.cloud().exists());
    };
    refused(&["--export", "colmap"]);
    assert_eq!(std::fs::read(&model).unwrap(), b"of somebody");
    std::fs::remove_dir_all(folder.root().join("colmap")).unwrap();
    // The depth maps of another run.
    let other = Scene::new(64, 48, 3);
    let run = true_maps(&other);
    let before = content(run.root());
    refused(&["--out", run.root().join("else.ply").to_str().unwrap(), "--depth-format", "pfm"]);
    assert!(content(run.root()) == before);
    // Its own exports it replaces, and what a killed run has left it removes.
    std::fs::create_dir_all(folder.root().join("colmap/sparse")).unwrap();
    write(&folder.root().join("colmap/.vamvs"), "");
    let unfinished =
        ["", "colmap", "colmap/sparse"].map(|at| folder.root().join(at).join(".vamvs-unfinished"));
    unfinished.iter().for_each(|file| write(file, "half"));
    for _ in 0..2 {
        fuse(folder.root(), &["--export", "colmap,openmvs", "--depth-format", "exr"]);
        let elsewhere = scene.path("cloud.ply");
        fuse(folder.root(), &["--out", elsewhere.to_str().unwrap(), "--depth-format", "pfm,npy"]);
    }
    assert!(unfinished.iter().all(|file| !file.exists()));
    // In the folder itself, whose name is not told then, it knows them too.
    let mut bare = vamvs();
    bare.current_dir(folder.root()).args(["fuse", ".", "--out", "bare.ply", "--depth-format", "exr"]);
    expect_success(&bare.output().unwrap());
    assert!(!folder.root().join("depths/.vamvs").exists(), "the run's folder is marked as a whole");
    // Those that it does not replace are told, and do not outlive their depth map.
    let output = vamvs().arg("fuse").arg(folder.root()).args(["--export", "openmvs"]).output().unwrap();
    let said = stderr(&output);
    assert!(said.contains("colmap is of an earlier cloud") && !said.contains("openmvs is"), "{said}");
    let exported = folder.root().join("depths/0001.exr");
    assert!(exported.is_file());
    folder.discard("0001").unwrap();
    assert!(!exported.exists());
}

#[test]
fn one_wrong_depth_does_not_make_pngs_coarse() {
    let scene = Scene::new(64, 48, 3);
    let folder = true_maps(&scene);
    let mut depth = scene.views[1].depth.clone();
    depth[(7, 5)] = 1e7;
    pfm::write(&folder.depth("0001"), &depth).unwrap();
    let output = vamvs().arg("fuse").arg(folder.root()).args(["--depth-format", "png"]).output().unwrap();
    expect_success(&output);
    assert!(stderr(&output).contains("1 depths"), "{}", stderr(&output));
    let depths = folder.root().join("depths");
    let step: f64 = std::fs::read_to_string(depths.join("png-step.txt")).unwrap().trim().parse().unwrap();
    let read = vamvs::io::depth::read(&depths.join("0001.png"), step).unwrap();
    for (place, (read, ground_truth)) in read.data().iter().zip(scene.views[1].depth.data()).enumerate() {
        let expected = if place == 5 * 64 + 7 { 0.0 } else { *ground_truth };
        assert!((read - expected).abs() <= 2e-3 * expected, "{read} or {expected}");
    }
}

#[test]
fn all_pngs_of_a_folder_have_its_step() {
    let scene = Scene::new(64, 48, 3);
    let folder = true_maps(&scene);
    let png = |name: &str| folder.root().join(format!("depths/{name}.png"));
    let run = |arguments: &[&str]| {
        vamvs()
            .arg("fuse")
            .arg(folder.root())
            .args(["--depth-format", "png"])
            .args(arguments)
            .output()
            .unwrap()
    };
    expect_success(&run(&["--png-step", "0.001"]));
    let before = content(folder.root());
    let said = error_of(&run(&["--png-step", "1e-6"]));
    assert!(said.contains("0000.pfm") && said.contains("65534 steps"), "{said}");
    assert!(content(folder.root()) == before, "nothing has changed");
    // A view that cannot be read any more keeps its PNG only while that has the right step.
    write(&folder.depth("0001"), "");
    expect_success(&run(&["--png-step", "0.001"]));
    assert!(png("0001").is_file());
    expect_success(&run(&["--png-step", "0.002"]));
    assert!(png("0000").is_file() && png("0002").is_file() && !png("0001").exists());
}

#[test]
fn images_that_are_distorted_are_no_dense_workspace() {
    let scene = Scene::new(64, 48, 3);
    let folder = true_maps(&scene);
    fuse(folder.root(), &["--export", "colmap"]);
    let sparse = folder.root().join("colmap/sparse");
    let mut model = Model::read(&sparse).unwrap();
    let lens = Lens::Rational { k: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
    model.cameras.values_mut().for_each(|camera| camera.lens = lens);
    model.write_binary(&sparse).unwrap();
    let said = error_of(&vamvs().arg("fuse").arg(folder.root().join("colmap")).output().unwrap());
    assert!(said.contains("undistorted"), "{said}");
}

#[test]
fn depth_maps_come_in_other_formats_with_the_step_of_pngs() {
    let scene = Scene::new(64, 48, 3);
    let folder = true_maps(&scene);
    let own = std::fs::read(folder.depth("0000")).unwrap();
    let before = std::fs::metadata(folder.depth("0000")).unwrap().modified().unwrap();
    let cloud = scene.path("else/where.ply");
    std::fs::create_dir(cloud.parent().unwrap()).unwrap();
    let formats = ["--depth-format", "pfm,png,exr,npy"];
    fuse(folder.root(), &formats);
    assert_eq!(std::fs::metadata(folder.depth("0000")).unwrap().modified().unwrap(), before);
    fuse(folder.root(), &[&formats[..], &["--out", cloud.to_str().unwrap()]].concat());
    let depths = scene.path("else/depths");
    assert!(std::fs::read(depths.join("0000.pfm")).unwrap() == own);
    let step: f64 = std::fs::read_to_string(depths.join("png-step.txt")).unwrap().trim().parse().unwrap();
    let read = vamvs::io::depth::read(&depths.join("0002.png"), step).unwrap();
    let farthest = |grid: &Grid<f32>| grid.data().iter().copied().fold(0.0, f32::max);
    assert!(f64::from(farthest(&read)) < 65_535.0 * step && step < 1e-3);
    for (read, ground_truth) in read.data().iter().zip(scene.views[2].depth.data()) {
        assert!((read - ground_truth).abs() <= 0.51 * step as f32, "{read} or {ground_truth}");
    }
    assert!(depths.join("0001.exr").is_file() && depths.join("0001.npy").is_file());
    let wrong =
        vamvs().arg("fuse").arg(folder.root()).args(["--depth-format", "png", "--png-step", "0"]).output();
    assert!(error_of(&wrong.unwrap()).contains("png-step"));
}

#[test]
fn a_scene_for_openmvs_has_all_its_files() {
    let scene = Scene::new(64, 48, 4);
    let folder = true_maps(&scene);
    let cloud = fuse(folder.root(), &["--export", "openmvs"]);
    let root = folder.root().join("openmvs");
    expect_same(&ply::read(&root.join("scene_dense.ply")).unwrap(), &cloud);
    let loaded = vamvs::io::openmvs::read_scene(&root.join("scene.mvs"), None).unwrap();
    assert_eq!(loaded.images, root.join("images"));
    assert_eq!(loaded.scene.points.len(), cloud.len());
    for (view, ground_truth) in loaded.scene.views.iter().zip(&scene.views) {
        let camera = ground_truth.photo.camera;
        assert!((view.camera.intrinsics.cx - camera.intrinsics.cx).abs() < 1e-9);
        assert!((view.cam_from_world.rotation - ground_truth.photo.cam_from_world.rotation).amax() < 1e-9);
        assert_eq!(image::stored_size(&root.join("images").join(&view.name)).unwrap(), camera.size);
    }
    assert!((0..4).all(|view| root.join(format!("depth{view:04}.dmap")).is_file()));
}
