//! Captures as people have them: situations that were reported, made from one small scene, each with what comes of it.

use std::fs;

use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};
use vamvs::core::{Grid, Scene as Cameras, Size, SparsePoint, View};
use vamvs::io::colmap::Model;
use vamvs::io::{image, mvsnet, pfm};
use vamvs_tests::Rendered;

use crate::scene::{Scene, error_of, expect_success, right, stderr, vamvs, write};

const SIZE: Size = Size::new(160, 120);

const VIEWS: usize = 4;

/// Maps of half the size by the plane sweep.
const QUICK: [&str; 4] = ["--weights", "none", "--no-refine", "--quiet"];

/// A situation: how its files are written into the scene's folder; the flags that name them.
type Situation = fn(&Scene) -> Vec<String>;

/// Situations that give depth maps: how many, and what is said.
const GO_ON: [(&str, Situation, usize, &[&str]); 11] = [
    ("points without tracks", without_tracks, VIEWS, &["does not say which views see its points"]),
    ("images.txt without keypoint lines, names with spaces", without_keypoint_lines, VIEWS, &[]),
    ("cameras of photographs of half the size", cameras_of_half_the_size, VIEWS, &["80×60", "scaled"]),
    ("a thermal camera's 16 bits", sixteen_bits, VIEWS, &["16 bits, of which they use 73"]),
    (
        "a photograph that is missing",
        a_missing_photograph,
        VIEWS - 1,
        &["1 of the scene's 4 photographs are missing"],
    ),
    ("a camera that is broken", a_broken_camera, VIEWS - 1, &["1 of the scene's 4 cameras cannot be used"]),
    ("camera models of COLMAP 4", |scene| camera_models(scene, ["EUCM", "DIVISION"]), VIEWS, &[]),
    ("the older ones", |scene| camera_models(scene, ["OPENCV", "FULL_OPENCV"]), VIEWS, &[]),
    ("rotations with a scale", |scene| transforms(scene, 0.25, &[]), VIEWS, &["uniform scale (0.2500)"]),
    ("names in another case", names_in_another_case, VIEWS, &["under nearly the same name"]),
    ("no points and no ranges", |scene| transforms(scene, 1.0, &[]), VIEWS, &[]),
];

/// Situations that end with an error.
const END: [(&str, Situation, &[&str]); 4] = [
    (
        "mirrored poses",
        |scene| transforms(scene, -1.0, &[]),
        &["frame 0 (images/0000.png)", "a mirror image", "left-handed"],
    ),
    ("a mask folder that matches nothing", masks, &["--masks", "0000_mask.png", "other.png"]),
    ("half of the photographs missing", half_missing, &["0000.png", "missing"]),
    (
        "another camera model",
        |scene| camera_models(scene, ["FOV", "PINHOLE"]),
        &["cameras.txt line 1", "FOV", "undistort"],
    ),
];

#[test]
fn captures_with_oddities_give_the_depth_maps_of_those_without() {
    let (_, usual) = outcome(colmap, VIEWS);
    assert!(usual > 0.6, "{usual:.3} of the depths are right without oddities");
    for (name, situation, maps, says) in GO_ON {
        let (said, share) = outcome(situation, maps);
        assert!(says.iter().all(|part| said.contains(part)), "{name}: expected {says:?}: {said}");
        // With a photograph less there is less to compare.
        let least = usual * if maps == VIEWS { 0.95 } else { 0.9 };
        assert!(share >= least, "{name}: {share:.3} of the depths are right, usually {usual:.3}");
    }
}

#[test]
fn captures_that_cannot_be_used_are_told_what_is_wrong_and_leave_nothing() {
    for (name, situation, says) in END {
        let scene = fresh();
        let said = error_of(&run(&scene, &situation(&scene)));
        assert!(says.iter().all(|part| said.contains(part)), "{name}: expected {says:?}: {said}");
        assert!(!scene.out().exists(), "{name}: nothing may be written");
    }
}

fn fresh() -> Scene {
    Scene::new(SIZE.width, SIZE.height, VIEWS)
}

fn run(scene: &Scene, flags: &[String]) -> std::process::Output {
    vamvs().arg("depth").args(flags).arg("--out").arg(scene.out()).args(QUICK).output().unwrap()
}

/// What is said, and the share of the depths that are right to 3 %.
fn outcome(situation: Situation, maps: usize) -> (String, f64) {
    let scene = fresh();
    let output = run(&scene, &situation(&scene));
    expect_success(&output);
    (stderr(&output), mean_share(&scene, maps))
}

fn mean_share(scene: &Scene, expected: usize) -> f64 {
    let depths = fs::read_dir(scene.out().join("depths")).unwrap().map(|entry| entry.unwrap().path());
    let depths: Vec<_> = depths.filter(|path| path.extension().is_some_and(|e| e == "pfm")).collect();
    assert_eq!(depths.len(), expected, "{depths:?}");
    let share = |path: &std::path::PathBuf| {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let digits: String = name.chars().filter(char::is_ascii_digit).collect();
        let number: usize = digits.parse().unwrap();
        let depth = pfm::read_depth(path).unwrap();
        right(&depth, &scene.views[number].depth.resized_nearest(depth.size()), 0.03)
    };
    depths.iter().map(share).sum::<f64>() / expected as f64
}

fn flags(scene: &Scene, of: [(&str, &str); 2]) -> Vec<String> {
    let flag = |(flag, path): (&str, &str)| [flag.to_owned(), scene.path(path).display().to_string()];
    of.into_iter().flat_map(flag).collect()
}

/// The scene with points that its views see.
fn model(scene: &Scene) -> Model {
    let views: Vec<View> = (0..).zip(&scene.views).map(|(id, view)| as_view(id, view)).collect();
    let mut points = Vec::new();
    for view in &scene.views {
        for place in 0..100 {
            let (x, y) = (8 + 16 * (place % 10), 6 + 12 * (place / 10));
            let (ray, depth) = (view.photo.camera.intrinsics, f64::from(view.depth[(x, y)]));
            let pixel = nalgebra::Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
            let x_in_world = view.photo.cam_from_world.inverse().transform(&(ray.ray(&pixel) * depth));
            let sees = |index: &usize| is_seen(&scene.views[*index], &x_in_world);
            points.push(SparsePoint { x_in_world, views: (0..views.len()).filter(sees).collect() });
        }
    }
    Model::from_scene(&Cameras { views, points, pairs: None })
}

fn as_view(id: u32, view: &Rendered) -> View {
    let cam_from_world = view.photo.cam_from_world;
    View {
        id,
        name: format!("{id:04}.png"),
        camera: view.photo.camera.into(),
        cam_from_world,
        depth_range: None,
    }
}

fn is_seen(view: &Rendered, x_in_world: &Vector3<f64>) -> bool {
    let x_in_cam = view.photo.cam_from_world.transform(x_in_world);
    view.photo.camera.project_inside(&x_in_cam).is_some_and(|pixel| {
        let depth = f64::from(view.depth[(pixel.x as usize, pixel.y as usize)]);
        (x_in_cam.z / depth - 1.0).abs() < 0.02
    })
}

fn colmap(scene: &Scene) -> Vec<String> {
    write_model(scene, &model(scene));
    flags(scene, [("--colmap", "sparse"), ("--images", "images")])
}

fn write_model(scene: &Scene, model: &Model) {
    fs::create_dir_all(scene.path("sparse")).unwrap();
    model.write_text(&scene.path("sparse")).unwrap();
}

fn without_tracks(scene: &Scene) -> Vec<String> {
    let mut model = model(scene);
    model.points.iter_mut().for_each(|point| point.track.clear());
    write_model(scene, &model);
    flags(scene, [("--colmap", "sparse"), ("--images", "images")])
}

fn without_keypoint_lines(scene: &Scene) -> Vec<String> {
    let flags = colmap(scene);
    let path = scene.path("sparse/images.txt");
    let text = fs::read_to_string(&path).unwrap();
    let images: Vec<&str> = text.lines().filter(|line| line.ends_with(".png")).collect();
    assert_eq!(images.len(), VIEWS);
    let mut text = images.join("\n") + "\n";
    for view in 0..VIEWS {
        let (old, new) = (format!("{view:04}.png"), format!("WhatsApp Image {view}.png"));
        text = text.replace(&old, &new);
        fs::rename(scene.path(&format!("images/{old}")), scene.path(&format!("images/{new}"))).unwrap();
    }
    write(&path, text);
    flags
}

fn cameras_of_half_the_size(scene: &Scene) -> Vec<String> {
    for (number, view) in scene.views.iter().enumerate() {
        let half = view.photo.camera.resized(Size::new(SIZE.width / 2, SIZE.height / 2));
        let path = scene.path(&format!("cams/{number:04}_cam.txt"));
        let range = vamvs_tests::folder::depth_range(view, 1.05);
        mvsnet::write_cam(&path, &half, &view.photo.cam_from_world, range).unwrap();
    }
    flags(scene, [("--cams", "cams"), ("--images", "images")])
}

fn sixteen_bits(scene: &Scene) -> Vec<String> {
    for (number, view) in scene.views.iter().enumerate() {
        let counts =
            view.photo.image.map(|[r, g, b]| 7300 + (u16::from(*r) + u16::from(*g) + u16::from(*b)) / 3);
        image::save_png_gray16(&scene.path(&format!("images/{number:04}.png")), &counts).unwrap();
    }
    colmap(scene)
}

fn a_missing_photograph(scene: &Scene) -> Vec<String> {
    fs::remove_file(scene.path("images/0000.png")).unwrap();
    colmap(scene)
}

fn a_broken_camera(scene: &Scene) -> Vec<String> {
    transforms(scene, 1.0, &[0])
}

/// Cameras whose further parameters make them pinhole cameras.
fn camera_models(scene: &Scene, models: [&str; 2]) -> Vec<String> {
    let flags = colmap(scene);
    let camera = |number: usize| {
        let model = models[number % 2];
        let (size, i) = (scene.views[number].photo.camera.size, scene.views[number].photo.camera.intrinsics);
        let more = match model {
            "EUCM" => " 0 1",
            "DIVISION" => " 0",
            "OPENCV" => " 0 0 0 0",
            "FULL_OPENCV" => " 0 0 0 0 0 0 0 0",
            "FOV" => " 0.5",
            _ => "",
        };
        format!("{number} {model} {} {} {} {} {} {}{more}\n", size.width, size.height, i.fx, i.fy, i.cx, i.cy)
    };
    write(&scene.path("sparse/cameras.txt"), (0..VIEWS).map(camera).collect::<String>());
    flags
}

/// nerfstudio's file without points; rotations are multiplied by `scale`, and these frames have no position.
fn transforms(scene: &Scene, scale: f64, broken: &[usize]) -> Vec<String> {
    let frame = |(number, view): (usize, &Rendered)| {
        let (world_from_cam, i) = (view.photo.cam_from_world.inverse(), view.photo.camera.intrinsics);
        let r = scale * world_from_cam.rotation * Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let row = |row: usize| {
            let position = world_from_cam.translation[row];
            let position = if broken.contains(&number) { Value::Null } else { json!(position) };
            json!([r[(row, 0)], r[(row, 1)], r[(row, 2)], position])
        };
        json!({
            "file_path": format!("images/{number:04}.png"),
            "transform_matrix": [row(0), row(1), row(2), [0, 0, 0, 1]],
            "fl_x": i.fx, "fl_y": i.fy, "cx": i.cx, "cy": i.cy,
        })
    };
    let frames: Vec<Value> = scene.views.iter().enumerate().map(frame).collect();
    // As Python writes what is not a number.
    let text = json!({ "frames": frames }).to_string().replace("null", "NaN");
    write(&scene.path("transforms.json"), text);
    vec!["--nerfstudio".to_owned(), scene.root.display().to_string()]
}

fn names_in_another_case(scene: &Scene) -> Vec<String> {
    fs::rename(scene.path("images/0001.png"), scene.path("images/0001.PNG")).unwrap();
    colmap(scene)
}

fn masks(scene: &Scene) -> Vec<String> {
    fs::create_dir(scene.path("masks")).unwrap();
    image::save_png_rgb(&scene.path("masks/other.png"), &Grid::filled(SIZE, [255; 3])).unwrap();
    [colmap(scene), vec!["--masks".to_owned(), scene.path("masks").display().to_string()]].concat()
}

fn half_missing(scene: &Scene) -> Vec<String> {
    (0..2).for_each(|view| fs::remove_file(scene.path(&format!("images/{view:04}.png"))).unwrap());
    colmap(scene)
}
