//! Scenes of nerfstudio, Bundler, VisualSFM and OpenMVS.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};
use serde_json::{Value, json};
use tempfile::{TempDir, tempdir};
use vamvs_core::{Camera, CloudPoint, Grid, Intrinsics, Lens, Pinhole, Pose, Size, SparsePoint, View};
use vamvs_io::masks::Masks;
use vamvs_io::{IoError, Loaded, atomic, bundler, image, nerfstudio, nvm, openmvs, ply};

const SIZE: Size = Size::new(8, 6);

/// A point that all cameras see, not on any axis.
const POINT: [f64; 3] = [0.21, -0.13, 0.34];

/// Poses, camera from world, that look at the origin and are rotated about all axes.
fn pose(view: usize) -> Pose {
    let eye = Vector3::new(1.5 + 0.1 * view as f64, -2.0 + 0.3 * view as f64, 3.0);
    Pose::look_at(&eye, &Vector3::zeros(), &Vector3::new(0.3, 0.9, 0.1))
}

struct Files {
    folder: TempDir,
}

impl Files {
    fn new(photographs: &[&str]) -> Self {
        let files = Self { folder: tempdir().unwrap() };
        for name in photographs {
            fs::create_dir_all(files.path(name).parent().unwrap()).unwrap();
            image::save_png_rgb(&files.path(name), &Grid::filled(SIZE, [9; 3])).unwrap();
        }
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn save(&self, name: &str, text: &str) -> PathBuf {
        atomic::write(&self.path(name), |out| out.write_all(text.as_bytes())).unwrap();
        self.path(name)
    }
}

fn error(loaded: Result<Loaded, IoError>) -> String {
    loaded.unwrap_err().to_string()
}

fn expect_pose(view: &View, expected: &Pose) {
    let turned = (view.cam_from_world.rotation - expected.rotation).amax();
    let moved = (view.cam_from_world.translation - expected.translation).amax();
    assert!(turned < 1e-9 && moved < 1e-9, "{}: {turned}, {moved}", view.name);
}

/// The pixel at which a view shows [`POINT`].
fn pixel(view: &View) -> Vector2<f64> {
    view.camera.project(&view.cam_from_world.transform(&POINT.into())).unwrap()
}

fn expect_pixel(view: &View, expected: [f64; 2]) {
    let found = pixel(view);
    assert!((found - Vector2::from(expected)).norm() < 1e-9, "{}: {found} or {expected:?}", view.name);
}

/// nerfstudio's matrix of a pose: world from camera, with the camera's y up and z backwards.
fn transform_matrix(pose: &Pose) -> Value {
    let world_from_cam = pose.inverse();
    let column = |i: usize, sign: f64| sign * world_from_cam.rotation.column(i).into_owned();
    let [right, up, back] = [column(0, 1.0), column(1, -1.0), column(2, -1.0)];
    let row = |i: usize| json!([right[i], up[i], back[i], world_from_cam.translation[i]]);
    json!([row(0), row(1), row(2), [0, 0, 0, 1]])
}

fn frame(path: &str, view: usize) -> Value {
    json!({"file_path": path, "transform_matrix": transform_matrix(&pose(view))})
}

fn read_transforms(files: &Files, transforms: &Value) -> Result<Loaded, IoError> {
    let path = files.save("transforms.json", &transforms.to_string());
    nerfstudio::read_scene(&path, None)
}

#[test]
fn a_perspective_nerfstudio_scene_is_read_with_its_axes_lens_and_masks() {
    let files = Files::new(&["images/b.png", "images/a.png", "masks/b.png"]);
    let mut with_mask = frame("./images/b.png", 0);
    with_mask["mask_path"] = json!("masks/b.png");
    let transforms = json!({
        "camera_model": "OPENCV", "fl_x": 10.0, "fl_y": 11.0, "cx": 4.2, "cy": 2.9, "w": 8, "h": 6,
        "k1": 0.1, "k2": -0.02, "k3": 0.003, "p1": 0.001, "p2": -0.002,
        "frames": [with_mask, frame("images/a", 1)],
    });
    let loaded = read_transforms(&files, &transforms).unwrap();
    assert_eq!(loaded.images, files.path("images"));
    let [a, b] = &loaded.scene.views[..] else { panic!("two views") };
    assert_eq!((a.name.as_str(), b.name.as_str(), a.id, b.id), ("a.png", "b.png", 0, 1));
    expect_pose(a, &pose(1));
    expect_pose(b, &pose(0));
    let lens = Lens::Rational { k: [0.1, -0.02, 0.003, 0.0, 0.0, 0.0], p: [0.001, -0.002] };
    let intrinsics = Intrinsics { fx: 10.0, fy: 11.0, cx: 4.2, cy: 2.9 };
    assert_eq!(a.camera, Camera { size: SIZE, intrinsics, lens });
    assert_eq!(loaded.masks, Masks::Files([("b.png".to_owned(), files.path("masks/b.png"))].into()));
    let by_folder = nerfstudio::read_scene(files.folder.path(), Some(&files.path("images"))).unwrap();
    assert_eq!(by_folder.scene, loaded.scene);
}

#[test]
fn a_frame_has_the_last_word_and_what_is_missing_comes_from_the_image() {
    let files = Files::new(&["a.png", "b.png", "c.png"]);
    let mut own = frame("a.png", 0);
    own["fl_x"] = json!(20.0);
    own["camera_model"] = json!("OPENCV_FISHEYE");
    own["k4"] = json!(0.25);
    let mut rows = frame("b.png", 1);
    rows["transform_matrix"].as_array_mut().unwrap().pop();
    let angle = 2.0 * (0.5_f64 * 8.0 / 9.0).atan();
    let mut turned = frame("b.png", 1);
    turned["camera_angle_x"] = json!(angle);
    let shared = json!({"fl_x": 30.0, "frames": [turned, frame("c.png", 2)]});
    let views = read_transforms(&files, &shared).unwrap().scene.views;
    assert!((views[0].camera.intrinsics.fx - 9.0).abs() < 1e-12, "its own angle, not the length of all");
    assert!((views[1].camera.intrinsics.fx - 30.0).abs() < 1e-12);
    let transforms = json!({"camera_angle_x": angle, "frames": [own, rows, frame("c.png", 2)]});
    let views = read_transforms(&files, &transforms).unwrap().scene.views;
    assert_eq!(views[0].camera.lens, Lens::Fisheye { k: [0.0, 0.0, 0.0, 0.25] });
    let centred = |f: f64| Intrinsics { fx: f, fy: f, cx: 4.0, cy: 3.0 };
    assert_eq!(views[0].camera.intrinsics, centred(20.0));
    assert!((views[1].camera.intrinsics.fx - 9.0).abs() < 1e-12);
    assert_eq!((views[1].camera.size, views[1].camera.lens), (SIZE, Lens::None));
    expect_pose(&views[1], &pose(1));
}

#[test]
fn sparse_points_are_seen_wherever_they_lie_in_the_image() {
    let files = Files::new(&["a.png", "b.png"]);
    let cloud = [[0.0; 3], [900.0, 0.0, 0.0]].map(|x_in_world| CloudPoint {
        x_in_world,
        normal: [0.0; 3],
        colour: [0; 3],
        confidence: 1.0,
        sigma: 0.0,
        views: 0,
    });
    ply::write(&files.path("sparse.ply"), &cloud).unwrap();
    let frames = [frame("a.png", 0), frame("b.png", 1)];
    let transforms = json!({"fl_x": 10.0, "ply_file_path": "sparse.ply", "frames": frames});
    let loaded = read_transforms(&files, &transforms).unwrap();
    assert_eq!(loaded.scene.points, [SparsePoint { x_in_world: Vector3::zeros(), views: vec![0, 1] }]);
    assert!(loaded.warnings[0].contains("sparse.ply"));
    std::fs::remove_file(files.path("sparse.ply")).unwrap();
    let loaded = read_transforms(&files, &transforms).unwrap();
    assert!(loaded.scene.points.is_empty() && loaded.warnings[0].contains("sparse.ply is not a file"));
}

#[test]
fn a_scaled_rotation_is_normalised_with_a_warning_and_a_mirror_is_named() {
    let files = Files::new(&["a.png", "b.png", "c.png"]);
    let names = ["a.png", "b.png", "c.png"];
    let scaled = |factors: [f64; 3]| {
        let mut frames: Vec<Value> = names.iter().zip(0..).map(|(name, index)| frame(name, index)).collect();
        for frame in &mut frames {
            for (row, factor) in
                frame["transform_matrix"].as_array_mut().unwrap()[..3].iter_mut().zip(factors)
            {
                for value in &mut row.as_array_mut().unwrap()[..3] {
                    *value = json!(value.as_f64().unwrap() * factor);
                }
            }
        }
        json!({"fl_x": 10.0, "frames": frames})
    };
    let plain = read_transforms(&files, &scaled([1.0; 3])).unwrap();
    let found = read_transforms(&files, &scaled([0.25; 3])).unwrap();
    assert!(plain.warnings.is_empty() && found.warnings[0].contains("3 frames has a uniform scale (0.2500)"));
    for (view, expected) in found.scene.views.iter().zip(&plain.scene.views) {
        expect_pose(view, &expected.cam_from_world);
    }
    let mirrored = error(read_transforms(&files, &scaled([1.0, -1.0, 1.0])));
    assert!(mirrored.contains("a mirror image") && mirrored.contains("left-handed"), "{mirrored}");
    let sheared = error(read_transforms(&files, &scaled([1.0, 2.0, 1.0])));
    assert!(sheared.contains("the 3×3 part"), "{sheared}");
}

#[test]
fn what_is_wrong_in_transforms_is_named_with_its_frame() {
    let files = Files::new(&["a.png", "b.png"]);
    let good = json!({"fl_x": 10.0, "frames": [frame("a.png", 0), frame("b.png", 1)]});
    read_transforms(&files, &good).unwrap();
    let changes: [(&str, Value, &str); 11] = [
        ("/frames", json!([]), "expected a list of frames"),
        ("/frames/1", json!(3), "frame 1: expected an object"),
        ("/frames/1/file_path", json!(""), "frame 1 (): expected a file_path"),
        ("/frames/1/file_path", json!("c.png"), "c.png"),
        ("/frames/1/transform_matrix", json!([[1, 2], [3, 4]]), "transform_matrix: expected 3 or 4 rows"),
        ("/frames/1/transform_matrix/0/0", json!(7), "frame 1 (b.png): transform_matrix: the 3×3 part"),
        ("/fl_x", json!("ten"), "fl_x: expected a number, found \"ten\""),
        ("/fl_x", json!(-1), "focal lengths"),
        ("/fl_x", Value::Null, "expected fl_x or camera_angle_x"),
        ("/ftheta_p0", json!(0.0), "found an f-theta lens; undistort the images"),
        ("/k4", json!(0.1), "undistort the images"),
    ];
    for (place, value, expected) in changes {
        let mut transforms = good.clone();
        match transforms.pointer_mut(place) {
            Some(old) => *old = value,
            None => transforms[&place[1..]] = value,
        }
        let said = error(read_transforms(&files, &transforms));
        assert!(said.contains(expected), "{place}: {said}");
    }
    let poses = json!([{"file_path": "a.png", "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]);
    assert!(error(read_transforms(&files, &poses)).contains("`ns-export cameras`"));
    assert!(error(read_transforms(&files, &json!([1]))).contains("expected an object with frames"));
    let mut degrees = good.clone();
    (degrees["fl_x"], degrees["camera_angle_x"]) = (Value::Null, json!(45));
    assert!(
        error(read_transforms(&files, &degrees))
            .contains("camera_angle_x: expected an angle between 0 and π")
    );
    let marked = files.save("marked.json", &format!("\u{feff}{good}"));
    assert_eq!(nerfstudio::read_scene(&marked, None).unwrap().scene.views.len(), 2);
    let mut sized = good;
    (sized["w"], sized["h"]) = (json!(8.5), json!(6));
    assert!(error(read_transforms(&files, &sized)).contains("w and h"));
    let broken = files.save("transforms.json", "{\n\"frames\": [,]}");
    assert!(error(nerfstudio::read_scene(&broken, None)).contains("transforms.json line 2"));
}

#[test]
fn one_frame_of_three_without_a_pose_is_left_out_with_a_warning() {
    let files = Files::new(&["a.png", "b.png", "c.png"]);
    let mut broken = frame("b.png", 1);
    broken["transform_matrix"][0][3] = json!("HERE");
    let frames = json!([frame("a.png", 0), broken, frame("c.png", 2)]);
    // As Python writes it, beside a string that only looks like it.
    let transforms = json!({"fl_x": 10.0, "frames": frames, "note": "\\\" NaN"}).to_string();
    let path = files.save("transforms.json", &transforms.replace("\"HERE\"", "-Infinity"));
    let loaded = nerfstudio::read_scene(&path, None).unwrap();
    let path = files
        .save("transforms.json", &transforms.replace("\"HERE\"", "0.0").replace("10.0", "10.0,\"cx\":NaN"));
    assert!(error(nerfstudio::read_scene(&path, None)).contains("cx: expected a number, found \"NaN\""));
    let names: Vec<&str> = loaded.scene.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["a.png", "c.png"]);
    let said = loaded.warnings.join("; ");
    assert!(
        said.contains("1 of the scene's 3 cameras cannot be used") && said.contains("frame 1 (b.png)"),
        "{said}"
    );
}

/// Photographs of all directions, which have no focal length, become faces with one centre; so does a fisheye of 200°.
#[test]
fn photographs_of_more_than_a_hemisphere_become_several_views() {
    let files = Files::new(&["a.png", "b.png"]);
    let frames = json!([frame("a.png", 0), frame("b.png", 1)]);
    let focal = 4.0 / 100.0_f64.to_radians();
    let wide = json!({"camera_model": "OPENCV_FISHEYE", "fl_x": focal, "w": 8, "h": 8, "frames": frames});
    let cases = [
        (json!({"camera_model": "EQUIRECTANGULAR", "frames": frames}), 12),
        (json!({"latlong": true, "frames": frames}), 12),
        (json!({"equirectangular": true, "frames": frames}), 12),
        (wide, 10),
    ];
    let whole = json!({"fl_x": 10.0, "frames": frames});
    let whole = read_transforms(&files, &whole).unwrap().scene;
    for (transforms, expected) in cases {
        let scene = read_transforms(&files, &transforms).unwrap().scene;
        assert_eq!(scene.views.len(), expected, "{transforms}");
        for (number, view) in scene.views.iter().enumerate() {
            let photograph = &whole.views[number / (expected / 2)];
            assert_eq!((view.id as usize, view.file()), (number, photograph.name.clone()));
            let moved = view.cam_from_world.centre() - photograph.cam_from_world.centre();
            assert!(moved.norm() < 1e-12, "{}", view.name);
        }
        let [front, right] = [0, 1].map(|face| &scene.views[face]);
        assert_eq!((front.name.as_str(), right.name.as_str()), ("a@front.png", "a@right.png"));
        assert_eq!(front.cam_from_world, whole.views[0].cam_from_world);
    }
}

/// A bundle of three cameras, of which the second was not registered.
fn bundle(files: &Files, list: &str) -> PathBuf {
    let mut text = "# Bundle file v0.3\n3 1\n".to_owned();
    for view in 0..3 {
        // Bundler's frame has y up and looks along −z.
        let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let (rotation, translation) = (flip * pose(view).rotation, flip * pose(view).translation);
        let focal = if view == 1 { 0.0 } else { 12.0 };
        text += &format!("{focal} 0.03 -0.01\n");
        for i in 0..3 {
            text += &format!("{} {} {}\n", rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)]);
        }
        text += &format!("{} {} {}\n", translation.x, translation.y, translation.z);
    }
    text += &format!("{} {} {}\n255 0 0\n3 2 17 0.5 0.5 1 3 0 0 0 4 -1 2\n", POINT[0], POINT[1], POINT[2]);
    files.save("list.txt", list);
    files.save("bundle.out", &text)
}

/// The pixel of [`POINT`] by the equations of Bundler's manual, which counts from the image's centre with y up.
fn bundler_pixel(view: usize) -> [f64; 2] {
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let x = flip * pose(view).transform(&POINT.into());
    let p = Vector2::new(-x.x / x.z, -x.y / x.z);
    let (f, k1, k2, s) = (12.0, 0.03, -0.01, p.norm_squared());
    let seen = f * (1.0 + k1 * s + k2 * s * s) * p;
    [4.0 + seen.x, 3.0 - seen.y]
}

#[test]
fn a_bundle_is_read_with_its_axes_its_lens_and_its_tracks() {
    let files = Files::new(&["images/c c.png", "images/x.png", "images/a.png"]);
    let path = bundle(&files, "images/c c.png 0 540.5\nimages/x.png\n./images/a.png 0 540\n");
    let loaded = bundler::read_scene(&path, None).unwrap();
    let [a, c] = &loaded.scene.views[..] else { panic!("two views") };
    assert_eq!((a.name.as_str(), c.name.as_str()), ("a.png", "c c.png"));
    expect_pose(a, &pose(2));
    expect_pixel(a, bundler_pixel(2));
    expect_pixel(c, bundler_pixel(0));
    assert_eq!(loaded.scene.points, [SparsePoint { x_in_world: POINT.into(), views: vec![0, 1] }]);
    assert!(loaded.warnings[0].starts_with("1 of 3 cameras"), "{:?}", loaded.warnings);
}

#[test]
fn wrong_bundles_are_refused_with_their_line() {
    let files = Files::new(&["1.png", "2.png", "3.png"]);
    let path = bundle(&files, "1.png\n2.png\n3.png\n");
    let good = fs::read_to_string(&path).unwrap();
    let changes = [
        ("v0.3", "v0.4", "line 1: expected \"# Bundle file v0.3\""),
        ("3 1\n", "4 1\n", "4 cameras, but the list of images has 3"),
        ("3 1\n", "3 2\n", "position: missing, the file ends here"),
        ("12 0.03", "-12 0.03", "line 7: expected a focal length"),
        ("12 0.03", "inf 0.03", "line 7: expected a focal length"),
        ("3 2 17", "3 7 17", "view list: expected a camera below 3, found 7"),
        ("255 0 0", "255 0", "line "),
    ];
    for (from, to, expected) in changes {
        let said = error(bundler::read_scene(&files.save("bundle.out", &good.replacen(from, to, 1)), None));
        assert!(said.contains("bundle.out") && said.contains(expected), "{from} → {to}: {said}");
    }
    fs::remove_file(files.path("list.txt")).unwrap();
    assert!(error(bundler::read_scene(&path, None)).contains("list.txt"));
}

fn nvm_text(header: &str) -> String {
    let mut text = format!("{header}\n\n2\n");
    for (view, name) in ["b\"b.png", "a.png"].into_iter().enumerate() {
        let q = UnitQuaternion::from_matrix(&pose(view).rotation);
        let c = pose(view).centre();
        text += &format!("{name}\t12 {} {} {} {} {} {} {} 0.04 0\n", q.w, q.i, q.j, q.k, c.x, c.y, c.z);
    }
    let [x, y, z] = POINT;
    text + &format!("\n1\n{x} {y} {z} 1 2 3 2 0 5 0.1 0.2 1 6 0 0\n")
}

#[test]
fn an_nvm_file_is_read_with_its_lens_and_its_tracks() {
    let files = Files::new(&["b b.png", "a.png"]);
    let loaded = nvm::read_scene(&files.save("scene.nvm", &nvm_text("NVM_V3 ")), None).unwrap();
    let [a, b] = &loaded.scene.views[..] else { panic!("two views") };
    assert_eq!((a.name.as_str(), b.name.as_str()), ("a.png", "b b.png"));
    expect_pose(a, &pose(1));
    // With the distortion removed as VisualSFM does it, the pixel is that of a pinhole camera.
    let bent = (pixel(b) - Vector2::new(4.0, 3.0)) / 12.0;
    let straight = bent * (1.0 + 0.04 * bent.norm_squared());
    let x = pose(0).transform(&POINT.into());
    assert!((straight - Vector2::new(x.x, x.y) / x.z).norm() < 1e-9);
    assert_eq!(loaded.scene.points, [SparsePoint { x_in_world: POINT.into(), views: vec![0, 1] }]);
    assert!(loaded.warnings.is_empty());
    let text = nvm_text("NVM_V3 FixedK 20 4.5 21 2.5") + "\n3\n";
    let fixed = nvm::read_scene(&files.save("fixed.nvm", &text), None).unwrap();
    let expected = Intrinsics { fx: 20.0, fy: 21.0, cx: 4.5, cy: 2.5 };
    assert_eq!(fixed.scene.views[0].camera.intrinsics, expected);
    assert!(fixed.warnings[0].contains("several models"));
}

#[test]
fn wrong_nvm_files_are_refused_with_their_line() {
    let files = Files::new(&["b b.png", "a.png"]);
    let changes = [
        ("NVM_V3", "NVM_V3_R9T", "line 1: expected \"NVM_V3\""),
        ("\n\n2\n", "\n\n3\n", "number of points: expected a whole number"),
        ("12", "0", "line 4: camera \"b b.png\": expected a focal length"),
        ("0.04 0", "0.04", "camera: expected a number"),
        ("2 0 5", "2 9 5", "list of measurements: expected a camera below 2, found 9"),
        ("\n1\n", "\n2\n", "position: missing"),
    ];
    for (from, to, expected) in changes {
        let text = nvm_text("NVM_V3").replacen(from, to, 1);
        let said = error(nvm::read_scene(&files.save("scene.nvm", &text), None));
        assert!(said.contains("scene.nvm") && said.contains(expected), "{from} → {to}: {said}");
    }
}

fn write_mvs(path: &Path) {
    let pinhole =
        |f: f64| Pinhole { size: SIZE, intrinsics: Intrinsics { fx: f, fy: f + 1.0, cx: 4.2, cy: 2.9 } };
    let views = [("b.png".to_owned(), pinhole(9.0), pose(0)), ("a.png".to_owned(), pinhole(10.0), pose(1))];
    let point = CloudPoint {
        x_in_world: [0.5, -0.25, 2.0],
        normal: [0.0, 0.0, 1.0],
        colour: [10, 20, 30],
        confidence: 0.5,
        sigma: 0.0,
        views: 2,
    };
    openmvs::write_scene(path, &views, &[(point, vec![0, 1]), (point, vec![1])]).unwrap();
}

#[test]
fn an_openmvs_scene_is_read_as_written() {
    let files = Files::new(&["a.png", "b.png"]);
    write_mvs(&files.path("scene.mvs"));
    let loaded = openmvs::read_scene(&files.path("scene.mvs"), None).unwrap();
    let [a, b] = &loaded.scene.views[..] else { panic!("two views") };
    expect_pose(a, &pose(1));
    expect_pose(b, &pose(0));
    let Camera { size, intrinsics: k, lens } = a.camera;
    assert_eq!((size, lens), (SIZE, Lens::None));
    let differences = [k.fx - 10.0, k.fy - 11.0, k.cx - 4.2, k.cy - 2.9];
    assert!(differences.iter().all(|difference| difference.abs() < 1e-12), "{k:?}");
    let point = |views: &[usize]| SparsePoint { x_in_world: [0.5, -0.25, 2.0].into(), views: views.to_vec() };
    assert_eq!(loaded.scene.points, [point(&[0, 1]), point(&[0])]);
}

#[test]
fn wrong_openmvs_scenes_are_refused() {
    let files = Files::new(&["a.png", "b.png"]);
    let path = files.path("scene.mvs");
    write_mvs(&path);
    let good = fs::read(&path).unwrap();
    let read_changed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.clone();
        change(&mut bytes);
        atomic::write(&path, |out| out.write_all(&bytes)).unwrap();
        error(openmvs::read_scene(&path, None))
    };
    assert!(read_changed(&|bytes| bytes[0] = b'X').contains("--archive-type"));
    assert!(read_changed(&|bytes| bytes[4] = 99).contains("version 7 or less, found 99"));
    assert!(read_changed(&|bytes| bytes[12..20].fill(0xff)).contains("platforms"));
    assert!(read_changed(&|bytes| bytes.truncate(400)).contains("byte"));
    fs::remove_file(files.path("b.png")).unwrap();
    assert!(read_changed(&|_| ()).contains("b.png"));
}
