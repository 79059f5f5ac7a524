//! One scene, written in each of the six formats that are read, is the same scene.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use serde_json::json;
use tempfile::tempdir;
use vamvs_core::{
    Camera, CloudPoint, Grid, Intrinsics, Lens, Pinhole, Pose, Scene, SeenPoints, Size, SparsePoint, View,
    depth_range, view_selection,
};
use vamvs_io::colmap::Model;
use vamvs_io::{Loaded, atomic, bundler, colmap, image, mvsnet, nerfstudio, nvm, openmvs};

const SIZE: Size = Size::new(64, 48);

/// Source views that are compared.
const SOURCES: usize = 3;

/// Cameras around the origin that look at it, with one focal length each, and points around it.
fn scene() -> impl Strategy<Value = Scene> {
    let eye = (0.0..1.2f64, -0.4..0.4f64, 3.0..5.0f64, 60.0..110.0f64);
    let points = prop::collection::vec(prop::array::uniform3(-0.6..0.6f64), 40);
    (prop::collection::vec(eye, 5), points).prop_map(|(eyes, points)| {
        let view = |(number, (angle, up, distance, focal)): (usize, (f64, f64, f64, f64))| {
            let direction = Vector3::new(angle.sin() * up.cos(), up.sin(), -angle.cos() * up.cos());
            let cam_from_world = Pose::look_at(&(direction * distance), &Vector3::zeros(), &Vector3::y());
            let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 32.0, cy: 24.0 };
            let camera = Camera { size: SIZE, intrinsics, lens: Lens::None };
            View {
                id: number as u32,
                name: format!("{number}.png"),
                camera,
                cam_from_world,
                depth_range: None,
            }
        };
        let views: Vec<View> = eyes.into_iter().enumerate().map(view).collect();
        let seen = |x_in_world: Vector3<f64>| {
            let is_seen = |view: &View| {
                pinhole(view).project_inside(&view.cam_from_world.transform(&x_in_world)).is_some()
            };
            (0..views.len()).filter(|&view| is_seen(&views[view])).collect::<Vec<usize>>()
        };
        let point = |x: [f64; 3]| SparsePoint { x_in_world: x.into(), views: seen(x.into()) };
        let points = points.into_iter().map(point).filter(|point| !point.views.is_empty()).collect();
        Scene { views, points, pairs: None }
    })
}

fn pinhole(view: &View) -> Pinhole {
    Pinhole { size: view.camera.size, intrinsics: view.camera.intrinsics }
}

fn save(path: &Path, text: &str) {
    atomic::write(path, |out| out.write_all(text.as_bytes())).unwrap();
}

/// The source views of each view, and the ends of its depth range.
fn planned(scene: &Scene) -> Vec<(Vec<usize>, [f64; 2])> {
    let pinholes: Vec<Pinhole> = scene.views.iter().map(pinhole).collect();
    let seen = SeenPoints::of(scene);
    let selected = view_selection::select(scene, &pinholes, SOURCES);
    let plan = |(view, sources): (usize, &Vec<vamvs_core::Source>)| {
        let sources: Vec<usize> = sources.iter().map(|source| source.view).collect();
        let (range, _) = depth_range::for_view(scene, &seen, view, &sources).unwrap();
        (sources, [range.near, range.far])
    };
    selected.iter().enumerate().map(plan).collect()
}

/// VisualSFM's and Bundler's list of points: position, colour, and who sees them where.
fn tracks(scene: &Scene, mut keypoint: impl FnMut(usize) -> String) -> String {
    let mut text = String::new();
    for SparsePoint { x_in_world: x, views } in &scene.points {
        let seen: Vec<String> = views.iter().map(|&view| keypoint(view)).collect();
        writeln!(text, "{} {} {} 1 2 3 {} {}", x.x, x.y, x.z, views.len(), seen.join(" ")).unwrap();
    }
    text
}

fn as_colmap(scene: &Scene, folder: &Path) -> Loaded {
    fs::create_dir(folder.join("sparse")).unwrap();
    Model::from_scene(scene).write_text(&folder.join("sparse")).unwrap();
    colmap::read_scene(&folder.join("sparse"), None).unwrap()
}

/// MVSNet's files have ranges and pairs instead of points.
fn as_mvsnet(scene: &Scene, folder: &Path) -> Loaded {
    fs::create_dir(folder.join("cams")).unwrap();
    let pinholes: Vec<Pinhole> = scene.views.iter().map(pinhole).collect();
    for (view, (_, [near, far])) in scene.views.iter().zip(planned(scene)) {
        let range = depth_range::DepthRange { near, far };
        let path = folder.join(format!("cams/{}_cam.txt", view.id));
        mvsnet::write_cam(&path, &pinhole(view), &view.cam_from_world, Some(range)).unwrap();
    }
    let ids: Vec<u32> = scene.views.iter().map(|view| view.id).collect();
    let selected = view_selection::select(scene, &pinholes, SOURCES);
    mvsnet::write_pairs(&folder.join("pair.txt"), &ids, &selected).unwrap();
    mvsnet::read_scene(&folder.join("cams"), &folder.join("images"), None, &mvsnet::Options::default())
        .unwrap()
}

fn as_transforms(scene: &Scene, folder: &Path) -> Loaded {
    let frame = |view: &View| {
        let world_from_cam = view.cam_from_world.inverse();
        let r = world_from_cam.rotation * Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let row = |i: usize| json!([r[(i, 0)], r[(i, 1)], r[(i, 2)], world_from_cam.translation[i]]);
        json!({
            "file_path": format!("images/{}", view.name),
            "transform_matrix": [row(0), row(1), row(2), [0, 0, 0, 1]],
            "fl_x": view.camera.intrinsics.fx,
        })
    };
    let frames: Vec<_> = scene.views.iter().map(frame).collect();
    save(&folder.join("transforms.json"), &json!({ "frames": frames }).to_string());
    nerfstudio::read_scene(folder, None).unwrap()
}

fn as_bundle(scene: &Scene, folder: &Path) -> Loaded {
    let mut text = format!("# Bundle file v0.3\n{} {}\n", scene.views.len(), scene.points.len());
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    for view in &scene.views {
        let (r, t) = (flip * view.cam_from_world.rotation, flip * view.cam_from_world.translation);
        writeln!(text, "{} 0 0", view.camera.intrinsics.fx).unwrap();
        (0..3).for_each(|i| writeln!(text, "{} {} {}", r[(i, 0)], r[(i, 1)], r[(i, 2)]).unwrap());
        writeln!(text, "{} {} {}", t.x, t.y, t.z).unwrap();
    }
    let names: Vec<String> = scene.views.iter().map(|view| format!("images/{}\n", view.name)).collect();
    save(&folder.join("list.txt"), &names.concat());
    save(&folder.join("bundle.out"), &(text + &tracks(scene, |view| format!("{view} 0 1.5 2.5"))));
    bundler::read_scene(&folder.join("bundle.out"), None).unwrap()
}

fn as_nvm(scene: &Scene, folder: &Path) -> Loaded {
    let mut text = format!("NVM_V3\n\n{}\n", scene.views.len());
    for view in &scene.views {
        let q = UnitQuaternion::from_matrix(&view.cam_from_world.rotation);
        let (c, focal) = (view.cam_from_world.centre(), view.camera.intrinsics.fx);
        let pose = format!("{} {} {} {} {} {} {}", q.w, q.i, q.j, q.k, c.x, c.y, c.z);
        writeln!(text, "images/{} {focal} {pose} 0 0", view.name).unwrap();
    }
    write!(text, "\n{}\n{}", scene.points.len(), tracks(scene, |view| format!("{view} 0 1.5 2.5"))).unwrap();
    save(&folder.join("scene.nvm"), &text);
    nvm::read_scene(&folder.join("scene.nvm"), None).unwrap()
}

fn as_openmvs(scene: &Scene, folder: &Path) -> Loaded {
    let view = |view: &View| (format!("images/{}", view.name), pinhole(view), view.cam_from_world);
    let views: Vec<_> = scene.views.iter().map(view).collect();
    let point = |point: &SparsePoint| {
        let (normal, colour, confidence, sigma) = ([0.0, 0.0, 1.0], [1, 2, 3], 0.5, 0.0);
        let (x_in_world, views) = (point.x_in_world.into(), point.views.len() as u8);
        let seen = point.views.iter().map(|&view| view as u32).collect();
        (CloudPoint { x_in_world, normal, colour, confidence, sigma, views }, seen)
    };
    let points: Vec<_> = scene.points.iter().map(point).collect();
    openmvs::write_scene(&folder.join("scene.mvs"), &views, &points).unwrap();
    openmvs::read_scene(&folder.join("scene.mvs"), None).unwrap()
}

/// Writes a scene into a folder and reads it.
type ReadBack = fn(&Scene, &Path) -> Loaded;

const FORMATS: [(&str, ReadBack); 6] = [
    ("COLMAP", as_colmap),
    ("MVSNet", as_mvsnet),
    ("transforms.json", as_transforms),
    ("Bundler", as_bundle),
    ("VisualSFM", as_nvm),
    ("OpenMVS", as_openmvs),
];

/// The scene, written with its photographs and read again.
fn written_and_read(scene: &Scene, read_back: ReadBack) -> Loaded {
    let folder = tempdir().unwrap();
    let images = folder.path().join("images");
    fs::create_dir(&images).unwrap();
    for view in &scene.views {
        image::save_png_rgb(&images.join(&view.name), &Grid::filled(SIZE, [9; 3])).unwrap();
    }
    read_back(scene, folder.path())
}

fn expect_same_views(format: &str, found: &Scene, expected: &Scene) {
    assert_eq!(found.views.len(), expected.views.len(), "{format}");
    for (found, expected) in found.views.iter().zip(&expected.views) {
        let turned = (found.cam_from_world.rotation - expected.cam_from_world.rotation).amax();
        let moved = (found.cam_from_world.translation - expected.cam_from_world.translation).amax();
        let (a, b) = (found.camera.intrinsics, expected.camera.intrinsics);
        let zoomed = [a.fx - b.fx, a.fy - b.fy, a.cx - b.cx, a.cy - b.cy].map(f64::abs);
        let worst = zoomed.into_iter().fold(turned.max(moved), f64::max);
        assert!(worst < 1e-9, "{format}: {} differs by {worst}", expected.name);
        assert_eq!(
            (&found.name, found.camera.size, found.camera.lens),
            (&expected.name, SIZE, Lens::None),
            "{format}"
        );
    }
}

/// The scene without one of its views.
fn without(scene: &Scene, left_out: usize) -> Scene {
    let mut views = scene.views.clone();
    views.remove(left_out);
    let renumbered = |view: &usize| if *view > left_out { view - 1 } else { *view };
    let seen_by = |views: &[usize]| views.iter().filter(|view| **view != left_out).map(renumbered).collect();
    let points =
        scene.points.iter().map(|point| SparsePoint { views: seen_by(&point.views), ..point.clone() });
    Scene { views, points: points.collect(), pairs: None }
}

/// The same source views and, to the precision of OpenMVS's points, depth ranges.
fn expect_same_plan(format: &str, found: &Scene, expected: &Scene) {
    for (view, (found, expected)) in planned(found).into_iter().zip(planned(expected)).enumerate() {
        assert_eq!(found.0, expected.0, "{format}: sources of view {view}");
        let off = found.1.iter().zip(expected.1).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        assert!(off < 1e-5, "{format}: range of view {view}: {:?}, expected {:?}", found.1, expected.1);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// A camera with a negative focal length among good ones.
    #[test]
    fn one_broken_camera_is_left_out_in_all_formats(scene in scene()) {
        let mut one_broken = scene.clone();
        one_broken.views[2].camera.intrinsics.fx *= -1.0;
        for (format, read_back) in FORMATS {
            let loaded = written_and_read(&one_broken, read_back);
            let said = loaded.warnings.join("; ");
            assert!(said.contains("1 of the scene's 5 cameras cannot be used"), "{format}: {said}");
            assert_eq!(loaded.broken.len(), 1, "{format}: {:?}", loaded.broken);
            expect_same_views(format, &loaded.scene, &without(&scene, 2));
            // The pairs of MVSNet's folder are those with the broken camera.
            if !["transforms.json", "MVSNet"].contains(&format) {
                expect_same_plan(format, &loaded.scene, &without(&scene, 2));
            }
        }
    }

    /// A point whose position is no number among good ones.
    #[test]
    fn a_point_that_is_nowhere_is_left_out_in_all_formats(scene in scene()) {
        let mut one_broken = scene.clone();
        let nowhere = SparsePoint { x_in_world: [1.0, f64::NAN, 1.0].into(), views: vec![0, 1] };
        one_broken.points.insert(1, nowhere);
        for (format, read_back) in FORMATS {
            // These have no points, or none that say who sees them.
            if ["transforms.json", "MVSNet"].contains(&format) {
                continue;
            }
            let loaded = written_and_read(&one_broken, read_back);
            let said = loaded.warnings.join("; ");
            let expected = format!("1 of {} points have a position that is not finite", one_broken.points.len());
            assert!(said.contains(&expected), "{format}: {said}");
            expect_same_views(format, &loaded.scene, &scene);
            expect_same_plan(format, &loaded.scene, &scene);
        }
    }

    #[test]
    fn a_scene_is_the_same_in_all_formats(scene in scene()) {
        for (format, read_back) in FORMATS {
            let loaded = written_and_read(&scene, read_back);
            assert!(loaded.warnings.is_empty(), "{format}: {:?}", loaded.warnings);
            expect_same_views(format, &loaded.scene, &scene);
            // transforms.json has no points that say who sees them.
            if format != "transforms.json" {
                expect_same_plan(format, &loaded.scene, &scene);
            }
        }
    }
}
