//! MVSNet folders: depth lines, pairs, the matching of images and cameras, and damaged or wrong files.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::Path;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use tempfile::{TempDir, tempdir};
use vamvs_core::{DepthRange, Grid, Intrinsics, Pinhole, Pose, Size, Source};
use vamvs_io::mvsnet::{
    DepthLine, Options, PixelCentre, read_cam, read_pairs, read_scene, write_cam, write_pairs,
};
use vamvs_io::{IoError, Loaded, atomic, image};

const HEAD: &str =
    "extrinsic\n1 0 0 1.5\n0 1 0 0\n0 0 1 0\n0.0 0.0 0.0 1.0\n\nintrinsic\n8 0 4\n0 8 3\n0 0 1\n\n";

fn save(path: &Path, text: &str) {
    atomic::write(path, |out| out.write_all(text.as_bytes())).unwrap();
}

fn photograph(path: &Path) {
    image::save_png_rgb(path, &Grid::filled(Size::new(8, 6), [9; 3])).unwrap();
}

fn read_text(text: &str, depth_line: DepthLine) -> Result<(Option<(f64, f64)>, bool), IoError> {
    let folder = tempdir().unwrap();
    let path = folder.path().join("0_cam.txt");
    save(&path, text);
    let cam = read_cam(&path, &Options { depth_line, ..Options::default() })?;
    Ok((cam.depth_range.map(|range| (range.near, range.far)), cam.warning.is_some()))
}

#[test]
fn depth_lines_are_read_by_their_number_of_words() {
    use DepthLine::{Auto, MinInterval, MinMax};
    let cases = [
        ("", Auto, None, false),
        ("425 2.5", Auto, Some((425.0, 425.0 + 2.5 * 191.0)), false),
        ("425 935", Auto, Some((425.0, 935.0)), true),
        ("425 935", MinMax, Some((425.0, 935.0)), false),
        ("0.1 0.2", MinInterval, Some((0.1, 0.1 + 0.2 * 191.0)), false),
        ("425 2.5 205", Auto, Some((425.0, 935.0)), false),
        ("425 2.5 205.0 900", Auto, Some((425.0, 900.0)), false),
        ("425 2.5 205 900", MinInterval, Some((425.0, 935.0)), false),
        ("425 935 205", MinMax, Some((425.0, 935.0)), false),
    ];
    for (line, reading, expected, warned) in cases {
        let found = read_text(&format!("{HEAD}{line}\n"), reading).unwrap();
        assert_eq!(found, (expected, warned), "{line:?} as {reading:?}");
    }
}

#[test]
fn depth_lines_without_a_range_are_warned_of_and_malformed_ones_refused() {
    for line in [
        "0 2.5",
        "-1 2.5",
        "425 0",
        "425 -2.5",
        "425 2.5 1",
        "425 2.5 205 425",
        "935 -1 9 425",
        "nan 1",
        "1 inf",
    ] {
        let found = read_text(&format!("{HEAD}{line}"), DepthLine::Auto).unwrap();
        assert_eq!(found, (None, true), "{line}");
    }
    assert_eq!(read_text(&format!("{HEAD}935 425"), DepthLine::MinMax).unwrap(), (None, true));
    let folder = folder(&["0", "1"], &["0.png", "1.png"]);
    for stem in ["0", "1"] {
        save(&folder.path().join(format!("cams/{stem}_cam.txt")), &format!("{HEAD}935 -1 9 425"));
    }
    let warnings = read(&folder).unwrap().warnings;
    let said = warnings.join("; ");
    assert!(
        warnings.len() == 1 && said.contains("near 935, far 425") && said.contains("(and 1 more)"),
        "{said}"
    );
    for line in ["425", "1 2 3 4 5", "425 x"] {
        let error = read_text(&format!("{HEAD}{line}"), DepthLine::Auto).unwrap_err().to_string();
        assert!(error.contains("depth line: expected"), "{line}: {error}");
    }
}

#[test]
fn what_is_no_camera_is_refused_with_its_line() {
    let cases = [
        ("1 0 0 1.5", "1 0 0 nan", "line 5: extrinsic: the pose has an entry"),
        ("1 0 0 1.5", "2 0 0 1.5", "not a rotation"),
        ("1 0 0 1.5", "-1 0 0 1.5", "not a rotation"),
        ("0.0 0.0 0.0 1.0", "0 0 0 2", "expected 0 0 0 1 as the last row"),
        ("8 0 4\n", "0 0 4\n", "line 10: intrinsic: focal lengths"),
        ("8 0 4\n", "8 5 4\n", "intrinsic: expected a calibration matrix"),
        ("0 0 1\n\n", "0 0 0\n\n", "intrinsic"),
        ("intrinsic", "intrinsics", "line 7: expected \"intrinsic\", found \"intrinsics\""),
        ("extrinsic", "", "expected \"extrinsic\", found \"1\""),
        ("0 8 3\n0 0 1", "0 8 3", "intrinsic: missing, the file ends here"),
    ];
    for (from, to, expected) in cases {
        let error = read_text(&HEAD.replacen(from, to, 1), DepthLine::Auto).unwrap_err().to_string();
        assert!(error.contains(expected), "{from:?} → {to:?}: {error}");
    }
}

/// Numbers of views stay those of all camera files, so that pairs keep their meaning.
#[test]
fn one_broken_camera_of_three_is_left_out_with_a_warning() {
    let folder = folder(&["a", "b", "c"], &["a.png", "b.png", "c.png"]);
    let broken = HEAD.replacen("1 0 0 1.5", "1 0 0 -nan(ind)", 1);
    save(&folder.path().join("cams/b_cam.txt"), &format!("{broken}425 2.5"));
    save(&folder.path().join("pair.txt"), "3\n0\n2 2 9 1 5\n1\n1 0 5\n2\n1 0 9\n");
    let loaded = read(&folder).unwrap();
    let views: Vec<(u32, &str)> =
        loaded.scene.views.iter().map(|view| (view.id, view.name.as_str())).collect();
    assert_eq!(views, [(0, "a.png"), (2, "c.png")]);
    let sources: Vec<Vec<usize>> =
        loaded.scene.pairs.unwrap().iter().map(|of| of.iter().map(|source| source.view).collect()).collect();
    assert_eq!(sources, [[1], [0]]);
    let said = loaded.warnings.join("; ");
    assert!(
        said.contains("1 of the scene's 3 cameras cannot be used") && said.contains("b_cam.txt line 5"),
        "{said}"
    );
}

#[test]
fn integer_pixel_centres_move_the_principal_point_by_half_a_pixel() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("0_cam.txt");
    save(&path, HEAD);
    let read =
        |pixel_centre| read_cam(&path, &Options { pixel_centre, ..Options::default() }).unwrap().intrinsics;
    assert_eq!(read(PixelCentre::Half), Intrinsics { fx: 8.0, fy: 8.0, cx: 4.0, cy: 3.0 });
    assert_eq!(read(PixelCentre::Integer), Intrinsics { fx: 8.0, fy: 8.0, cx: 4.5, cy: 3.5 });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn cameras_are_read_as_written(
        angles in prop::array::uniform3(-3.0..3.0),
        t in prop::array::uniform3(-1e6..1e6),
        (fx, fy, cx, cy) in (1.0..5000.0, 1.0..5000.0, -10.0..5000.0, -10.0..5000.0),
        range in prop::option::of((1e-6..1e3, 1e-3..1e6)),
    ) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("é_cam.txt");
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(angles)).to_rotation_matrix().into_inner();
        let cam_from_world = Pose { rotation, translation: t.into() };
        let intrinsics = Intrinsics { fx, fy, cx, cy };
        let depth_range = range.map(|(near, span)| DepthRange { near, far: near + span });
        let camera = Pinhole { size: Size::new(8, 6), intrinsics };
        write_cam(&path, &camera, &cam_from_world, depth_range).unwrap();
        let cam = read_cam(&path, &Options::default()).unwrap();
        prop_assert!((cam.cam_from_world.rotation - rotation).amax() < 1e-12);
        prop_assert_eq!(cam.cam_from_world.translation, cam_from_world.translation);
        prop_assert_eq!((cam.intrinsics, cam.depth_range, cam.warning), (intrinsics, depth_range, None));
    }

    #[test]
    fn mangled_files_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        pair in any::<bool>(),
    ) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("file.txt");
        let text = if pair { "2\n0\n1 1 0.5\n1\n1 0 0.5\n".to_owned() } else { format!("{HEAD}425 2.5 205 935") };
        let mut bytes = text.into_bytes();
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        atomic::write(&path, |out| out.write_all(&bytes)).unwrap();
        let _ = read_cam(&path, &Options::default());
        let _ = read_pairs(&path, &[0, 1]);
    }
}

#[test]
fn pairs_are_read_as_written() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("pair.txt");
    let source = |view, score| Source { view, score };
    let pairs = vec![vec![source(2, 12.5), source(1, 0.25)], vec![], vec![source(0, 1.0)]];
    write_pairs(&path, &[10, 4, 7], &pairs).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "3\n10\n2 7 12.5 4 0.25\n4\n0\n7\n1 10 1\n");
    let read = read_pairs(&path, &[10, 4, 7]).unwrap();
    assert_eq!((read.sources, read.unknown.len()), (pairs, 0));
}

#[test]
fn pairs_of_a_whole_scene_serve_a_part_of_its_views() {
    let folder = folder(&["00000004", "00000010"], &["00000004.jpg", "00000010.jpg"]);
    let path = folder.path().join("pair.txt");
    save(&path, "3\n10\n2 7 12.5 4 0.25\n4\n1 7 0.5\n7\n1 10 1\n");
    let loaded = read(&folder).unwrap();
    let source = Source { view: 0, score: 0.25 };
    assert_eq!(loaded.scene.pairs.unwrap(), [vec![], vec![source]]);
    let unnumbered = self::folder(&["a", "b"], &["a.jpg", "b.jpg"]);
    save(&unnumbered.path().join("pair.txt"), "2\n1\n1 2 0.5\n2\n1 1 0.5\n");
    let error = read(&unnumbered).unwrap_err().to_string();
    assert!(error.contains("expected numbers from 0 to 1") && error.ends_with("found 2"), "{error}");
    let expected = "pair.txt: 1 of the views have no camera file and are not used (7 …)";
    assert!(loaded.warnings.iter().any(|warning| warning.ends_with(expected)), "{:?}", loaded.warnings);
}

#[test]
fn wrong_pairs_are_refused_with_their_line() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("pair.txt");
    let cases = [
        ("1\n6\n1 0 0.5", "line 3: expected numbers of views that have cameras, found only others"),
        ("1\n0\n2 5 0.5 5 0.4", "expected other views, each once"),
        ("2\n0\n1 1 0.5\n0\n0", "line 4: view 0 is listed twice"),
        ("1\n0\n1 0 0.5", "expected other views, each once"),
        ("1\n0\n2 1 0.5 1 0.4", "expected other views, each once"),
        ("9999999999999\n0\n1 1 0.5", "reference view: missing"),
        ("1\n0\n99999999999 1 0.5", "source view: missing"),
        ("1\n0\n1 1 0.5\n1\n0", "expected the end after 1 views, found \"1\""),
        ("1\n0\n1 1 x", "score: expected a number"),
        ("1\n0\n1 1 NaN", "score: expected a number of at least 0, found NaN"),
        ("1\n0\n1 1 -0.5", "score: expected a number of at least 0, found -0.5"),
        ("", "number of views: missing"),
    ];
    for (text, expected) in cases {
        save(&path, text);
        let error = read_pairs(&path, &[0, 1]).unwrap_err().to_string();
        assert!(error.contains("pair.txt") && error.contains(expected), "{text:?}: {error}");
    }
    save(&path, "1\n1\n0 ");
    assert_eq!(read_pairs(&path, &[0, 1]).unwrap().sources, [vec![], vec![]]);
}

/// A folder with `cams/STEM_cam.txt` and `images/NAME`.
fn folder(stems: &[&str], names: &[&str]) -> TempDir {
    let folder = tempdir().unwrap();
    for sub in ["cams", "images"] {
        fs::create_dir(folder.path().join(sub)).unwrap();
    }
    for stem in stems {
        save(&folder.path().join(format!("cams/{stem}_cam.txt")), HEAD);
    }
    for name in names {
        photograph(&folder.path().join("images").join(name));
    }
    folder
}

fn read(folder: &TempDir) -> Result<Loaded, IoError> {
    let folder = folder.path();
    read_scene(&folder.join("cams"), &folder.join("images"), None, &Options::default())
}

#[test]
fn a_scene_matches_images_by_stem_and_finds_its_pairs() {
    let folder = folder(&["00000003", "00000012"], &["00000003.PNG", "00000012.webp.png", "00000012.png"]);
    save(&folder.path().join("pair.txt"), "2\n12\n1 3 0.5\n3\n0");
    let Loaded { scene, warnings, .. } = read(&folder).unwrap();
    let views: Vec<_> =
        scene.views.iter().map(|view| (view.id, view.name.as_str(), view.camera.size)).collect();
    let size = Size::new(8, 6);
    assert_eq!(views, [(3, "00000003.PNG", size), (12, "00000012.png", size)]);
    assert_eq!(scene.views[0].cam_from_world.rotation, Matrix3::identity());
    assert_eq!(scene.pairs, Some(vec![vec![], vec![Source { view: 0, score: 0.5 }]]));
    assert!(warnings.len() == 1 && warnings[0].contains("00000012.webp.png"), "{warnings:?}");
}

#[test]
fn numbers_come_from_the_stem_or_else_from_the_order() {
    let ids = |stems: &[&str]| {
        let names: Vec<String> = stems.iter().map(|stem| format!("{stem}.png")).collect();
        let folder = folder(stems, &names.iter().map(String::as_str).collect::<Vec<_>>());
        let scene = read(&folder).unwrap().scene;
        assert_eq!(scene.pairs, None);
        scene.views.iter().map(|view| view.id).collect::<Vec<_>>()
    };
    assert_eq!(ids(&["rect_2 frame-07", "rect_2 frame-11"]), [7, 11]);
    assert_eq!(ids(&["é", "ü 5"]), [0, 1]);
    assert_eq!(ids(&["a1", "b1", "c1"]), [0, 1, 2]);
    assert_eq!(ids(&["99999999999"]), [0]);
}

#[test]
fn missing_ambiguous_and_extra_images_are_told() {
    let error = read(&folder(&["0", "1", "2"], &["1.png"])).unwrap_err().to_string();
    assert!(
        error.contains("half of the scene's photographs or more are missing there, 2")
            && error.contains("0, 2"),
        "{error}"
    );
    let error = read(&folder(&["0"], &["0.png", "0.PNG"])).unwrap_err().to_string();
    assert!(error.contains("expected one image for the camera \"0\""), "{error}");
    let error = read(&folder(&[], &["0.png"])).unwrap_err().to_string();
    assert!(error.contains("expected camera files"), "{error}");
    let loaded = read(&folder(&["0", "1", "2"], &["0.png", "2.png"])).unwrap();
    assert!(
        loaded.warnings.len() == 1 && loaded.warnings[0].contains("left out (1)"),
        "{:?}",
        loaded.warnings
    );
    assert_eq!(
        loaded.scene.views.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(),
        ["0.png", "1", "2.png"]
    );
    let loaded = read(&folder(&["Dsc_1"], &["dsc_1.JPG.png"])).map(|loaded| loaded.warnings);
    assert!(loaded.is_err(), "another name is no near one: {loaded:?}");
    let loaded = read(&folder(&["Dsc_1"], &["DSC_1.png"])).unwrap();
    assert!(loaded.scene.views[0].name == "DSC_1.png" && loaded.warnings[0].contains("Dsc_1 is DSC_1.png"));
    let warnings = read(&folder(&["0"], &["0.png", "9.png"])).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("9.png"), "{warnings:?}");
}

/// Cameras of photographs of half, a quarter or 1.25 of the size are scaled to those that are there; one camera that is off its
/// middle, or a common offset in one direction, is none of another size.
#[test]
fn cameras_of_photographs_of_another_size_are_scaled_with_a_warning() {
    let stems = ["0", "1", "2", "3", "4"];
    let files = folder(&stems, &["0.png", "1.png", "2.png", "3.png", "4.png"]);
    let write = |stem: &str, [f, cx, cy]: [f64; 3]| {
        let text = HEAD.replace("8 0 4", &format!("{f} 0 {cx}")).replace("0 8 3", &format!("0 {f} {cy}"));
        save(&files.path().join(format!("cams/{stem}_cam.txt")), &text);
    };
    for factor in [0.5, 0.25, 1.25] {
        for stem in stems {
            write(stem, [8.0, 4.02, 2.99].map(|value| value * factor));
        }
        let Loaded { scene, warnings, .. } = read(&files).unwrap();
        assert!(warnings.len() == 1 && warnings[0].contains("were scaled to those of 8×6"), "{warnings:?}");
        for view in &scene.views {
            let k = view.camera.intrinsics;
            assert!(
                (k.fx - 8.0).abs() < 0.05 && (k.cx - 4.0).abs() < 0.05 && (k.cy - 3.0).abs() < 0.05,
                "{k:?}"
            );
        }
    }
    for odd in [[8.0, 4.0, 1.5], [8.0, 2.0, 3.0]] {
        stems.iter().for_each(|stem| write(stem, odd));
        let Loaded { scene, warnings, .. } = read(&files).unwrap();
        assert!(warnings.is_empty() && scene.views[0].camera.intrinsics.fx == 8.0, "{odd:?}: {warnings:?}");
    }
    stems.iter().for_each(|stem| write(stem, [8.0, 4.0, 3.0]));
    write("2", [4.0, 2.0, 1.5]);
    assert!(read(&files).unwrap().warnings.is_empty(), "one camera of five may differ");
}

#[test]
fn a_camera_of_another_image_size_and_a_guessed_depth_line_are_warned_of() {
    let folder = folder(&["0"], &["0.png"]);
    let path = folder.path().join("cams/0_cam.txt");
    save(&path, &HEAD.replace("8 0 4", "8 0 400"));
    let warnings = read(&folder).unwrap().warnings;
    assert!(
        warnings.len() == 1 && warnings[0].contains("(400, 3) is outside of the 8×6 image"),
        "{warnings:?}"
    );
    save(&path, &format!("{HEAD}2 5"));
    let warnings = read(&folder).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("`2 5` was read as `min max`"), "{warnings:?}");
}
