//! COLMAP models: round trips, scenes, and files that are damaged or wrong.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;
use tempfile::{TempDir, tempdir};
use vamvs_core::{Camera, Grid, Intrinsics, Lens, Pose, Size};
use vamvs_io::colmap::{self, Image, Model, Observation, Point};
use vamvs_io::{IoError, atomic, image};

const BINARY: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];
const TEXT: [&str; 3] = ["cameras.txt", "images.txt", "points3D.txt"];

fn camera() -> impl Strategy<Value = Camera> {
    let k = || -0.3..0.3;
    let lens = prop_oneof![
        Just(Lens::None),
        (k(), k(), k(), k())
            .prop_map(|(a, b, c, d)| Lens::Rational { k: [a, b, 0.0, 0.0, 0.0, 0.0], p: [c, d] }),
        (k(), k()).prop_map(|(a, b)| Lens::Rational { k: [a, 0.0, 0.1, 0.2, b, 0.3], p: [0.0, 0.1] }),
        (k(), k()).prop_map(|(a, b)| Lens::Fisheye { k: [a, b, 0.0, 0.5] }),
    ];
    (lens, 1.0..5000.0, 1usize..5000, 1usize..5000).prop_map(|(lens, f, width, height)| Camera {
        size: Size::new(width, height),
        intrinsics: Intrinsics { fx: f, fy: f * 1.1, cx: 0.1, cy: -7.5 },
        lens,
    })
}

fn pose() -> impl Strategy<Value = Pose> {
    (prop::array::uniform3(-3.0..3.0), prop::array::uniform3(-1e6..1e6)).prop_map(|(angles, t)| {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(angles)).to_rotation_matrix();
        Pose { rotation: rotation.into_inner(), translation: t.into() }
    })
}

fn keypoint() -> impl Strategy<Value = Observation> {
    (-10.0..5000.0, -10.0..5000.0, prop::option::of(0u64..9))
        .prop_map(|(x, y, point_id)| Observation { pixel: Vector2::new(x, y), point_id })
}

fn point() -> impl Strategy<Value = Point> {
    let track = prop::collection::vec((1u32..5, 0u32..9), 0..6);
    (1u64..1000, prop::array::uniform3(-1e9..1e9), any::<[u8; 3]>(), 0.0..9.0, track)
        .prop_map(|(id, x, rgb, error, track)| Point { id, x_in_world: x.into(), rgb, error, track })
}

fn model() -> impl Strategy<Value = Model> {
    let image = (pose(), "[a-zé漢][a-z é漢_-]{0,8}", prop::collection::vec(keypoint(), 0..4));
    let images = prop::collection::vec(image, 1..4);
    (camera(), camera(), images, prop::collection::vec(point(), 0..5)).prop_map(|(a, b, images, points)| {
        let image =
            |(i, (cam_from_world, name, observations)): (usize, (Pose, String, Vec<Observation>))| Image {
                id: 3 * i as u32 + 1,
                name: format!("sub folder/{name} {i}.jpg"),
                camera_id: if i == 0 { 7 } else { 4_000_000_000 },
                cam_from_world,
                observations,
            };
        Model {
            cameras: BTreeMap::from([(7, a), (4_000_000_000, b)]),
            images: images.into_iter().enumerate().map(image).collect(),
            points,
            broken: Vec::new(),
        }
    })
}

/// A model of two images and three points, one of them seen twice by an image.
fn small_model() -> Model {
    let camera = Camera {
        size: Size::new(8, 6),
        intrinsics: Intrinsics { fx: 8.0, fy: 8.0, cx: 4.0, cy: 3.0 },
        lens: Lens::None,
    };
    let image = |id, name: &str, x| Image {
        id,
        name: name.to_owned(),
        camera_id: 2,
        cam_from_world: Pose { rotation: Matrix3::identity(), translation: Vector3::new(x, 0.0, 0.0) },
        observations: vec![Observation { pixel: Vector2::new(1.5, 2.5), point_id: Some(5) }],
    };
    let point = |id, track: &[(u32, u32)]| Point {
        id,
        x_in_world: Vector3::new(0.5, 0.25, 4.0),
        rgb: [1, 2, 3],
        error: 0.5,
        track: track.to_vec(),
    };
    Model {
        cameras: BTreeMap::from([(2, camera)]),
        images: vec![image(9, "b ü.png", 0.0), image(3, "a.png", 1.0)],
        points: vec![point(5, &[(9, 0), (3, 0), (9, 1)]), point(6, &[]), point(7, &[(3, 1), (44, 0)])],
        broken: Vec::new(),
    }
}

fn assert_same(found: &Model, expected: &Model) {
    assert_eq!(found.cameras, expected.cameras);
    assert_eq!(found.points, expected.points);
    assert_eq!(found.images.len(), expected.images.len());
    for (found, expected) in found.images.iter().zip(&expected.images) {
        let rotation = expected.cam_from_world.rotation;
        assert!((found.cam_from_world.rotation - rotation).amax() < 1e-12);
        let exact = Image { cam_from_world: Pose { rotation, ..found.cam_from_world }, ..found.clone() };
        assert_eq!(&exact, expected);
    }
}

fn save(path: &Path, bytes: &[u8]) {
    atomic::write(path, |out| out.write_all(bytes)).unwrap();
}

/// A folder with `small_model` as text files, one of them changed.
fn changed_text(file: &str, from: &str, to: &str) -> TempDir {
    let folder = tempdir().unwrap();
    small_model().write_text(folder.path()).unwrap();
    let text = fs::read_to_string(folder.path().join(file)).unwrap();
    assert!(text.contains(from), "{file} holds no {from:?}: {text}");
    save(&folder.path().join(file), text.replacen(from, to, 1).as_bytes());
    folder
}

fn message(folder: &Path) -> String {
    Model::read(folder).unwrap_err().to_string()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn text_and_binary_models_are_read_as_written(model in model()) {
        let folder = tempdir().unwrap();
        let mut without_keypoints = model.clone();
        without_keypoints.images.iter_mut().for_each(|image| image.observations.clear());
        let assert_read = || {
            assert_same(&Model::read(folder.path()).unwrap(), &model);
            assert_same(&Model::read_without_keypoints(folder.path()).unwrap(), &without_keypoints);
        };
        model.write_text(folder.path()).unwrap();
        assert_read();
        for name in TEXT {
            fs::remove_file(folder.path().join(name)).unwrap();
        }
        model.write_binary(folder.path()).unwrap();
        assert_read();
    }

    #[test]
    fn mangled_files_never_panic(
        binary in any::<bool>(),
        file in 0usize..3,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let folder = tempdir().unwrap();
        let model = small_model();
        let names = if binary { BINARY } else { TEXT };
        if binary { model.write_binary(folder.path()).unwrap() } else { model.write_text(folder.path()).unwrap() }
        let path = folder.path().join(names[file]);
        let mut bytes = fs::read(&path).unwrap();
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        save(&path, &bytes);
        let _ = Model::read(folder.path());
    }
}

#[test]
fn binary_files_cut_anywhere_are_refused() {
    let folder = tempdir().unwrap();
    small_model().write_binary(folder.path()).unwrap();
    for name in BINARY {
        let path = folder.path().join(name);
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() {
            save(&path, &whole[..length]);
            let error = message(folder.path());
            assert!(error.contains(name) && error.contains("byte"), "{name} cut to {length}: {error}");
        }
        save(&path, &whole);
    }
    assert!(Model::read(folder.path()).is_ok());
}

#[test]
fn text_files_cut_anywhere_do_not_panic() {
    let folder = tempdir().unwrap();
    small_model().write_text(folder.path()).unwrap();
    for name in TEXT {
        let path = folder.path().join(name);
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() {
            save(&path, &whole[..length]);
            let _ = Model::read(folder.path());
        }
        save(&path, &whole);
    }
}

#[test]
fn counts_larger_than_the_file_are_refused_before_anything_is_allocated() {
    let folder = tempdir().unwrap();
    small_model().write_binary(folder.path()).unwrap();
    for name in BINARY {
        let path = folder.path().join(name);
        let whole = fs::read(&path).unwrap();
        for count in [100, u64::from(u32::MAX), u64::MAX] {
            let mut bytes = whole.clone();
            bytes[..8].copy_from_slice(&count.to_le_bytes());
            save(&path, &bytes);
            let error = message(folder.path());
            assert!(error.contains(&format!("{count} are announced")), "{error}");
        }
        save(&path, &whole);
    }
    // The number of keypoints of the first image follows its pose, its camera's id and its name.
    let path = folder.path().join("images.bin");
    let mut bytes = fs::read(&path).unwrap();
    let keypoints = 8 + 4 + 7 * 8 + 4 + "b ü.png".len() + 1;
    bytes[keypoints..][..8].copy_from_slice(&u64::MAX.to_le_bytes());
    save(&path, &bytes);
    assert!(message(folder.path()).contains(&format!("images.bin byte {keypoints}: keypoints")));
}

#[test]
fn a_name_without_end_is_refused() {
    let folder = tempdir().unwrap();
    small_model().write_binary(folder.path()).unwrap();
    let path = folder.path().join("images.bin");
    let mut bytes = fs::read(&path).unwrap();
    bytes.truncate(8 + 4 + 7 * 8 + 4);
    bytes[..8].copy_from_slice(&1u64.to_le_bytes());
    bytes.extend([b'a'; 10_000]);
    save(&path, &bytes);
    assert!(message(folder.path()).contains("no zero byte"));
}

#[test]
fn wrong_values_are_refused_with_the_entity_and_the_place() {
    let cases = [
        ("images.txt", "9 1 0 0 0", "9 NaN 0 0 0", "images.txt line 1: image 9 (\"b ü.png\")"),
        ("images.txt", "9 1 0 0 0", "9 0 0 0 0", "quaternion other than 0"),
        ("images.txt", "9 1 0 0 0 0", "9 1 0 0 0 inf", "not a finite number"),
        ("images.txt", "9 1 0 0 0 0 0 0 2", "9 1 0 0 0 0 0 0 3", "camera 3 does not exist"),
        ("images.txt", "b ü.png", "../b ü.png", "no path inside"),
        ("images.txt", "b ü.png", "/b ü.png", "no path inside"),
        ("images.txt", "b ü.png", "a.png", "occurs twice"),
        ("images.txt", "1.5 2.5 5", "1.5 2.5", "images.txt line 2: image 9"),
        ("images.txt", "1.5 2.5 5", "1.5 x 5", "keypoint: expected a number, found \"x\""),
        ("cameras.txt", "PINHOLE", "THIN_PRISM_FISHEYE", "undistort"),
        ("cameras.txt", "2 PINHOLE 8 6 8", "2 PINHOLE 8 6 0", "camera 2: focal lengths must be positive"),
        ("cameras.txt", "2 PINHOLE 8 6 8", "2 PINHOLE 8 6 nan", "camera 2: expected finite parameters"),
        ("cameras.txt", "PINHOLE 8 6 8", "PINHOLE 8 6", "camera parameter: missing"),
        ("cameras.txt", "PINHOLE 8 6 8", "PINHOLE 8 6 8 8", "PINHOLE has 4 parameters"),
        ("cameras.txt", "PINHOLE 8 6", "PINHOLE 0 6", "found 0×6"),
        ("cameras.txt", "2 PINHOLE", "-2 PINHOLE", "camera id: expected a whole number, found \"-2\""),
        ("points3D.txt", "1 2 3", "1 2 300", "blue: expected a whole number, found \"300\""),
        ("points3D.txt", "9 0 3 0 9 1", "9 0 3 0 9", "track's keypoint: missing"),
    ];
    for (file, from, to, expected) in cases {
        let folder = changed_text(file, from, to);
        let error = message(folder.path());
        assert!(error.contains(expected), "{from} → {to}: {error}");
    }
}

#[test]
fn binary_values_are_checked_like_those_of_text_files() {
    let mut model = small_model();
    model.images[0].cam_from_world.translation.x = f64::NAN;
    let folder = tempdir().unwrap();
    model.write_binary(folder.path()).unwrap();
    assert!(message(folder.path()).contains("images.bin byte 8: image 9 (\"b ü.png\")"));
}

/// One broken pose of three, as Microsoft's compilers print it, and as binary files hold it.
#[test]
fn an_image_without_a_pose_is_left_out_with_a_warning() {
    let mut model = small_model();
    let third = Image { id: 4, name: "c.png".to_owned(), ..model.images[1].clone() };
    model.images.push(third);
    let expected = |folder: &Path| {
        let read = Model::read(folder).unwrap();
        let names: Vec<&str> = read.images.iter().map(|image| image.name.as_str()).collect();
        assert_eq!(names, ["a.png", "c.png"]);
        assert_eq!(read.images[0].observations.len(), 1);
        assert!(read.broken.len() == 1 && read.broken[0].contains("b ü.png"), "{:?}", read.broken);
    };
    let text = tempdir().unwrap();
    model.write_text(text.path()).unwrap();
    let images = text.path().join("images.txt");
    let written = fs::read_to_string(&images).unwrap();
    save(&images, written.replace("9 1 0 0 0 0 0 0", "9 1 0 0 0 -nan(ind) 0 0").as_bytes());
    expected(text.path());
    let binary = tempdir().unwrap();
    model.images[0].cam_from_world.translation.x = f64::NAN;
    model.write_binary(binary.path()).unwrap();
    expected(binary.path());
}

#[test]
fn quaternions_are_normalised() {
    let folder = changed_text("images.txt", "9 1 0 0 0", "9 -3 0 0 -3");
    let model = Model::read(folder.path()).unwrap();
    let quarter_turn = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    assert!((model.images[0].cam_from_world.rotation - quarter_turn).amax() < 1e-12);
}

#[test]
fn comments_blank_lines_missing_keypoints_and_windows_line_ends_are_read() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    save(&path("cameras.txt"), b"# header\r\n\r\n1 SIMPLE_PINHOLE 8 6 9 4 3\r\n");
    save(&path("images.txt"), b"# x\n1 1 0 0 0 0 0 0 1 one image.jpg\r\n\r\n8 1 0 0 0 0 0 0 1 two.jpg");
    let model = Model::read(folder.path()).unwrap();
    assert_eq!(
        model.images.iter().map(|i| i.name.as_str()).collect::<Vec<_>>(),
        ["one image.jpg", "two.jpg"]
    );
    assert_eq!(model.cameras[&1].intrinsics.fy, 9.0);
    assert!(model.points.is_empty());
}

/// Some writers leave out the second line of each image. Names with two spaces make lines of twelve words, as many as four keypoints.
#[test]
fn images_without_second_lines_are_all_read() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    save(&path("cameras.txt"), b"1 SIMPLE_PINHOLE 8 6 9 4 3\n");
    let lines = (0..4).map(|i| format!("{} 1 0 0 0 {i} 0 0 1 WhatsApp Image {i}.jpg\n", i + 1));
    save(&path("images.txt"), lines.collect::<String>().as_bytes());
    let names = |model: &Model| model.images.iter().map(|image| image.name.clone()).collect::<Vec<_>>();
    let model = Model::read(folder.path()).unwrap();
    assert_eq!(names(&model), (0..4).map(|i| format!("WhatsApp Image {i}.jpg")).collect::<Vec<_>>());
    assert_eq!(model.images[3].cam_from_world.translation.x, 3.0);
    // Lines of keypoints may be there for some images only.
    save(&path("images.txt"), b"1 1 0 0 0 0 0 0 1 a b c.jpg\n1 2 -1 3 4 7 5 6 -1 7 8 9\n2 1 0 0 0 0 0 0 1 d.jpg\n3 1 0 0 0 0 0 0 1 e.jpg\n\n");
    let model = Model::read(folder.path()).unwrap();
    assert_eq!(names(&model), ["a b c.jpg", "d.jpg", "e.jpg"]);
    assert_eq!(model.images.iter().map(|image| image.observations.len()).collect::<Vec<_>>(), [4, 0, 0]);
}

/// Points that no file says who sees count as seen where they project; a photograph of nearly the same name is taken.
#[test]
fn points_without_tracks_are_used_and_near_names_are_taken() {
    let (model, images) = (tempdir().unwrap(), tempdir().unwrap());
    let mut trackless = small_model();
    trackless.points.iter_mut().for_each(|point| point.track.clear());
    trackless.points[0].x_in_world = Vector3::new(0.0, 0.0, 5.0);
    trackless.write_binary(model.path()).unwrap();
    photograph(images.path(), "A.PNG");
    photograph(images.path(), "b ü.png");
    let loaded = colmap::read_scene(model.path(), Some(images.path())).unwrap();
    let seen = loaded.scene.points.iter().filter(|point| !point.views.is_empty()).count();
    assert!(seen > 0, "{:?}", loaded.scene.points);
    let said = loaded.warnings.join("; ");
    assert!(
        said.contains("does not say which views see its points") && said.contains("a.png is A.PNG"),
        "{said}"
    );
    assert_eq!(loaded.scene.views[0].name, "A.PNG");
}

#[test]
fn a_folder_without_a_model_is_named() {
    let folder = tempdir().unwrap();
    assert!(message(folder.path()).contains("found none"));
    small_model().write_binary(folder.path()).unwrap();
    fs::remove_file(folder.path().join("images.bin")).unwrap();
    assert!(matches!(Model::read(folder.path()), Err(IoError::System { action: "open", .. })));
}

fn photograph(folder: &Path, name: &str) {
    image::save_png_rgb(&folder.join(name), &Grid::filled(Size::new(8, 6), [9; 3])).unwrap();
}

#[test]
fn a_scene_has_sorted_views_and_each_view_once_a_point() {
    let (model, images) = (tempdir().unwrap(), tempdir().unwrap());
    small_model().write_binary(model.path()).unwrap();
    for name in ["rigs.bin", "frames.bin"] {
        save(&model.path().join(name), b"of COLMAP 4, not read");
    }
    photograph(images.path(), "a.png");
    photograph(images.path(), "b ü.png");
    let loaded = colmap::read_scene(model.path(), Some(images.path())).unwrap();
    let views = &loaded.scene.views;
    assert_eq!(
        views.iter().map(|v| (v.id, v.name.as_str())).collect::<Vec<_>>(),
        [(3, "a.png"), (9, "b ü.png")]
    );
    assert_eq!(views[0].cam_from_world.translation.x, 1.0);
    let seen: Vec<&[usize]> = loaded.scene.points.iter().map(|point| point.views.as_slice()).collect();
    assert_eq!(seen, [&[0, 1][..], &[0]]);
    assert_eq!(loaded.warnings.len(), 1);
    assert!(loaded.warnings[0].contains("1 observation(s)"), "{:?}", loaded.warnings);
}

#[test]
fn missing_images_are_an_error_and_unregistered_ones_a_warning() {
    let (model, images) = (tempdir().unwrap(), tempdir().unwrap());
    small_model().write_text(model.path()).unwrap();
    photograph(images.path(), "a.png");
    photograph(images.path(), "unregistered.png");
    let error = colmap::read_scene(model.path(), Some(images.path())).unwrap_err().to_string();
    assert!(
        error.contains("half of the scene's photographs or more are missing there, 1")
            && error.contains("b ü.png"),
        "{error}"
    );
    photograph(images.path(), "b ü.png");
    let warnings = colmap::read_scene(model.path(), Some(images.path())).unwrap().warnings;
    assert!(warnings.iter().any(|warning| warning.contains("unregistered.png")), "{warnings:?}");
}

#[test]
fn a_workspace_has_its_model_in_sparse_and_its_photographs_beside_it() {
    let workspace = tempdir().unwrap();
    let path = |folder: &str| workspace.path().join(folder);
    let fails = |folder: &str| colmap::read_scene(&path(folder), None).unwrap_err().to_string();
    fs::create_dir_all(path("images")).unwrap();
    for name in ["a.png", "b ü.png"] {
        photograph(&path("images"), name);
    }
    assert!(fails("").contains("sparse/0"), "{}", fails(""));
    for model in ["sparse", "sparse/0"] {
        fs::create_dir_all(path(model)).unwrap();
        small_model().write_binary(&path(model)).unwrap();
        let scene = colmap::read_scene(&path(model), Some(&path("images"))).unwrap().scene;
        for folder in ["", "sparse", model] {
            let loaded = colmap::read_scene(&path(folder), None).unwrap();
            assert_eq!((&loaded.scene, &loaded.images), (&scene, &path("images")), "{folder:?} with {model}");
        }
        fs::remove_dir_all(path("sparse")).unwrap();
    }
    for model in ["sparse/0", "sparse/1"] {
        fs::create_dir_all(path(model)).unwrap();
        small_model().write_text(&path(model)).unwrap();
    }
    let error = fails("");
    assert!(
        error.contains("found 2") && error.contains("sparse/0, ") && error.contains("sparse/1"),
        "{error}"
    );
    fs::remove_dir_all(path("images")).unwrap();
    assert!(fails("sparse/1").contains("expected the photographs in images"), "{}", fails("sparse/1"));
}

#[test]
fn a_model_without_images_is_refused() {
    let folder = tempdir().unwrap();
    let model = Model { images: Vec::new(), points: Vec::new(), ..small_model() };
    model.write_binary(folder.path()).unwrap();
    let error = colmap::read_scene(folder.path(), Some(folder.path())).unwrap_err().to_string();
    assert!(error.contains("expected registered images"), "{error}");
}

#[test]
fn an_exported_scene_observes_points_where_they_project() {
    let (model, images, exported) = (tempdir().unwrap(), tempdir().unwrap(), tempdir().unwrap());
    small_model().write_text(model.path()).unwrap();
    photograph(images.path(), "a.png");
    photograph(images.path(), "b ü.png");
    let scene = colmap::read_scene(model.path(), Some(images.path())).unwrap().scene;
    Model::from_scene(&scene).write_binary(exported.path()).unwrap();
    assert_eq!(colmap::read_scene(exported.path(), Some(images.path())).unwrap().scene, scene);
    let again = Model::read(exported.path()).unwrap();
    let (image, keypoint) = again.points[0].track[1];
    let image = again.images.iter().find(|candidate| candidate.id == image).unwrap();
    let expected = Vector2::new(8.0 * 0.5 / 4.0 + 4.0, 8.0 * 0.25 / 4.0 + 3.0);
    assert_eq!(image.observations[keypoint as usize], Observation { pixel: expected, point_id: Some(1) });
}
