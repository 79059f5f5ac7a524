//! The files of DTU and Tanks and Temples: synthetic files with known content, and damaged ones.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod mat_file;

use std::path::{Path, PathBuf};

use mat_file::{compressed, doubles, element, mask_variables, mat_file, variable};
use tempfile::tempdir;
use vamvs_io::{atomic, dtu, mat, tnt};

fn save(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    atomic::write(&path, |out| out.write_all(bytes)).unwrap();
    path
}

#[test]
fn masks_are_read_plain_and_compressed_among_other_variables() {
    let folder = tempdir().unwrap();
    let text = variable("note", 4, &[1, 2], &element(4, &[104, 0, 105, 0]));
    let plain = [vec![text], mask_variables()].concat();
    let squeezed: Vec<_> = plain.iter().map(|variable| compressed(variable)).collect();
    for variables in [plain, squeezed] {
        let mask = dtu::read_mask(&save(folder.path(), "ObsMask1_10.mat", &mat_file(&variables))).unwrap();
        assert_eq!((mask.low, mask.high), ([-10.0, -20.0, 500.0], [90.5, 80.0, 700.0]));
        assert_eq!((mask.side, mask.size), (3.0, [2, 3, 2]));
        let inside: Vec<usize> = (0..12).filter(|&voxel| mask.inside[voxel]).collect();
        assert_eq!(inside, [1, 10]);
    }
}

#[test]
fn planes_are_read() {
    let folder = tempdir().unwrap();
    let bytes = mat_file(&[variable("P", 6, &[4, 1], &doubles(&[0.5, -1.5, 2.25, -300.0]))]);
    let path = save(folder.path(), "Plane1.mat", &bytes);
    assert_eq!(dtu::read_plane(&path).unwrap(), [0.5, -1.5, 2.25, -300.0]);
    let error = dtu::read_mask(&path).unwrap_err().to_string();
    assert!(error.contains("Plane1.mat") && error.contains("ObsMask"), "{error}");
}

#[test]
fn every_type_of_number_is_read() {
    let folder = tempdir().unwrap();
    let cases: [(u32, Vec<u8>, f64); 10] = [
        (1, vec![0xFE], -2.0),
        (2, vec![0xFE], 254.0),
        (3, (-300_i16).to_le_bytes().into(), -300.0),
        (4, 60_000_u16.to_le_bytes().into(), 60_000.0),
        (5, (-70_000_i32).to_le_bytes().into(), -70_000.0),
        (6, 4_000_000_000_u32.to_le_bytes().into(), 4e9),
        (7, 1.5_f32.to_le_bytes().into(), 1.5),
        (9, (-0.1_f64).to_le_bytes().into(), -0.1),
        (12, (-5_i64).to_le_bytes().into(), -5.0),
        (13, 7_u64.to_le_bytes().into(), 7.0),
    ];
    for (kind, bytes, expected) in cases {
        let file = mat_file(&[variable("x", 6, &[1, 1], &element(kind, &bytes))]);
        let [x] = mat::read(&save(folder.path(), "x.mat", &file), ["x"]).unwrap();
        assert_eq!((x.shape, x.values), (vec![1, 1], vec![expected]), "type {kind}");
    }
}

#[test]
fn what_is_no_such_file_is_told() {
    let folder = tempdir().unwrap();
    let error = |bytes: &[u8]| {
        let error = mat::read(&save(folder.path(), "x.mat", bytes), ["x"]).unwrap_err().to_string();
        assert!(error.contains("x.mat"), "{error}");
        error
    };
    let mut hdf5 = b"MATLAB 7.3 MAT-file".to_vec();
    hdf5.resize(600, 0);
    assert!(error(&hdf5).contains("-v7"));
    assert!(error(b"ply").contains("level 5"));
    let whole = mat_file(&[variable("x", 6, &[2, 1], &doubles(&[1.0, 2.0]))]);
    for length in 0..whole.len() {
        error(&whole[..length]);
    }
    assert!(error(&mat_file(&[variable("x", 6, &[3, 1], &doubles(&[1.0, 2.0]))])).contains("[3, 1]"));
    assert!(error(&mat_file(&[variable("x", 6, &[-1, 1], &doubles(&[1.0]))])).contains("negative"));
    let huge = [i32::MAX, i32::MAX, i32::MAX];
    assert!(error(&mat_file(&[variable("x", 6, &huge, &doubles(&[1.0]))])).contains("found 1"));
    let mut broken = compressed(&variable("x", 6, &[1, 1], &doubles(&[1.0])));
    broken[20] ^= 0xFF;
    assert!(error(&mat_file(&[broken])).contains("decompressed"));
}

const VOLUME: &str = r#"{
    "axis_max": 3.5, "axis_min": -1.25,
    "bounding_polygon": [[0, 0, 9], [4, 0, 9], [4, 0, 2], [0, 0, 2]],
    "class_name": "SelectionPolygonVolume", "orthogonal_axis": "Y", "version_major": 1, "version_minor": 0 }"#;

#[test]
fn crop_volumes_are_read_along_their_axis() {
    let folder = tempdir().unwrap();
    let volume = tnt::read_volume(&save(folder.path(), "Barn.json", VOLUME.as_bytes())).unwrap();
    assert_eq!((volume.axis, volume.span), (1, [-1.25, 3.5]));
    assert_eq!(volume.outline, [[0.0, 9.0], [4.0, 9.0], [4.0, 2.0], [0.0, 2.0]]);
    for (from, to, expected) in [
        ("\"Y\"", "\"W\"", "orthogonal_axis"),
        ("SelectionPolygonVolume", "PointCloud", "class_name"),
        (", [4, 0, 2], [0, 0, 2]", "", "bounding_polygon"),
        ("\"axis_min\": -1.25,", "", "axis_min"),
        ("[4, 0, 9]", "[4, 0]", "line 3"),
    ] {
        let path = save(folder.path(), "Barn.json", VOLUME.replace(from, to).as_bytes());
        let error = tnt::read_volume(&path).unwrap_err().to_string();
        assert!(error.contains("Barn.json") && error.contains(expected), "{error}");
    }
}

#[test]
fn alignments_are_read_as_text_and_as_json() {
    let folder = tempdir().unwrap();
    let text = "0 -2 0 5\n2 0 0 6\n0 0 2 7\n0 0 0 1\n";
    let json = r#"{"transformation": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1]}"#;
    for path in
        [save(folder.path(), "a.txt", text.as_bytes()), save(folder.path(), "a.json", json.as_bytes())]
    {
        let ground_truth_from_cloud = tnt::read_alignment(&path).unwrap();
        assert!((ground_truth_from_cloud.scale - 2.0).abs() < 1e-12);
        let moved = ground_truth_from_cloud.transform(&nalgebra::Vector3::new(1.0, 2.0, 3.0));
        assert!((moved - nalgebra::Vector3::new(1.0, 8.0, 13.0)).norm() < 1e-12);
    }
    for (wrong, expected) in [
        ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0", "missing"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1", "the end"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 2", "last row"),
        ("1 0 0 0 0 3 0 0 0 0 1 0 0 0 0 1", "not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 x 0 0 0 0 1", "\"x\""),
    ] {
        let error =
            tnt::read_alignment(&save(folder.path(), "b.txt", wrong.as_bytes())).unwrap_err().to_string();
        assert!(error.contains("b.txt") && error.contains(expected), "{error}");
    }
}
