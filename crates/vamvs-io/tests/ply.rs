//! Clouds: round trips, PLY files of other programs, and hostile ones.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use tempfile::tempdir;
use vamvs_core::CloudPoint;
use vamvs_io::{atomic, ply};

fn point(x_in_world: [f64; 3]) -> CloudPoint {
    CloudPoint {
        x_in_world,
        normal: [0.0, 0.6, -0.8],
        colour: [1, 20, 255],
        confidence: 0.25,
        sigma: 0.5,
        views: 4,
    }
}

fn save(folder: &Path, header: &str, body: &[u8]) -> PathBuf {
    let path = folder.join("cloud.ply");
    atomic::write(&path, |out| {
        out.write_all(header.as_bytes())?;
        out.write_all(body)
    })
    .unwrap();
    path
}

fn any_point() -> impl Strategy<Value = CloudPoint> {
    let position = prop::array::uniform3(-1e3f32..1e3);
    (position, any::<[u8; 3]>(), prop::array::uniform3(-1.0f32..1.0), 0.0f32..1.0, any::<u8>()).prop_map(
        |(x, colour, normal, confidence, views)| CloudPoint {
            x_in_world: x.map(f64::from),
            normal,
            colour,
            confidence,
            sigma: 0.0,
            views,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn clouds_are_read_as_written(cloud in prop::collection::vec(any_point(), 0..40)) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("é cloud.ply");
        ply::write(&path, &cloud).unwrap();
        let positions: Vec<[f64; 3]> = cloud.iter().map(|point| point.x_in_world).collect();
        prop_assert_eq!(ply::read_positions(&path).unwrap(), positions);
        prop_assert_eq!(ply::read(&path).unwrap(), cloud);
    }

    #[test]
    fn mangled_clouds_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        ply::write(&path, &[point([1.0, 2.0, 3.0]); 3]).unwrap();
        let mut bytes = fs::read(&path).unwrap();
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        save(folder.path(), "", &bytes);
        let _ = ply::read(&path);
    }
}

#[test]
fn the_file_is_what_other_programs_expect() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    let cloud: Vec<CloudPoint> = (1..=12).map(|x| point([f64::from(x), 2.0, 3.0])).collect();
    ply::write(&path, &cloud).unwrap();
    let bytes = fs::read(&path).unwrap();
    let body = bytes.len() - 12 * (6 * 4 + 3 + 4 + 4 + 1);
    let header = String::from_utf8(bytes[..body].to_vec()).unwrap();
    assert_eq!(
        header,
        "ply\nformat binary_little_endian 1.0\ncomment vamvs ..................\nelement vertex 12\n\
         property float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         property float confidence\nproperty float sigma\nproperty uchar views\nend_header\n"
    );
    let floats: Vec<u8> = [1.0f32, 2.0, 3.0, 0.0, 0.6, -0.8].iter().flat_map(|v| v.to_le_bytes()).collect();
    let sigma = 0.5f32.to_le_bytes();
    assert_eq!(
        bytes[body..][..36],
        [&floats[..], &[1, 20, 255], &0.25f32.to_le_bytes(), &sigma, &[4]].concat()
    );
}

#[test]
fn a_cloud_far_from_the_origin_keeps_its_digits() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    let cloud = vec![
        point([691_234.123_456, 5_334_567.654_321, 510.000_001]),
        point([691_234.5, 5_334_567.0, 512.0]),
    ];
    ply::write(&path, &cloud).unwrap();
    assert!(fs::read(&path).unwrap().windows(17).any(|bytes| bytes == b"property double x"));
    assert_eq!(ply::read(&path).unwrap(), cloud);
    // A survey of 600 m in UTM coordinates, which floats would round to half a metre.
    let survey = [point([691_000.0, 5_334_000.0, 500.0]), point([691_600.0, 5_334_600.0, 520.0])];
    assert_eq!(ply::Coordinates::for_points(&survey), ply::Coordinates::Double);
    let near = [point([90.0, 0.0, 0.0]), point([91.0, 0.0, 0.0])];
    assert_eq!(ply::Coordinates::for_points(&near), ply::Coordinates::Float);
    assert_eq!(ply::Coordinates::for_points(&[]), ply::Coordinates::Float);
}

#[test]
fn some_points_of_many_are_those_of_the_whole() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    let cloud: Vec<_> = (0..200_003).map(|i| point([f64::from(i), 1.0, 2.0])).collect();
    ply::write(&path, &cloud).unwrap();
    let places = [0, 1, 65_535, 65_536, 131_072, 200_002];
    let (count, some) =
        ply::read_some(&path, &|count| places.iter().copied().filter(|&i| i < count).collect()).unwrap();
    assert_eq!(count, cloud.len());
    assert_eq!(some, places.iter().map(|&i| cloud[i]).collect::<Vec<_>>());
    assert_eq!(ply::read(&path).unwrap().len(), cloud.len());
    // Records of text differ in length, so these are read one after the other.
    let header =
        "ply\nformat ascii 1.0\nelement vertex 70000\nproperty float x\nproperty float y\nproperty float z\n";
    let lines: String = (0..70_000).map(|i| format!("{i} 1 2\n")).collect();
    save(folder.path(), &format!("{header}end_header\n"), lines.as_bytes());
    let (count, some) = ply::read_some(&path, &|_| vec![3, 65_536, 69_999]).unwrap();
    assert_eq!(count, 70_000);
    assert_eq!(some.iter().map(|point| point.x_in_world[0]).collect::<Vec<_>>(), [3.0, 65_536.0, 69_999.0]);
}

#[test]
fn a_writer_that_is_not_finished_leaves_nothing() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    let mut writer = ply::PlyWriter::create(&path, ply::Coordinates::Float).unwrap();
    writer.push(&point([1.0, 2.0, 3.0])).unwrap();
    assert_eq!(writer.count(), 1);
    drop(writer);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn clouds_cut_anywhere_are_refused() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    ply::write(&path, &[point([1.0, 2.0, 3.0]); 3]).unwrap();
    let whole = fs::read(&path).unwrap();
    for length in 0..whole.len() {
        save(folder.path(), "", &whole[..length]);
        let error = ply::read(&path).unwrap_err().to_string();
        assert!(error.contains("cloud.ply"), "{length}: {error}");
    }
}

#[test]
fn foreign_files_are_read_whatever_their_order_and_encoding() {
    let folder = tempdir().unwrap();
    let ascii = "ply\nformat ascii 1.0\ncomment by hand\nelement camera 1\nproperty list uchar int ids\n\
                 element vertex 2\nproperty uchar blue\nproperty double z\nproperty float y\nproperty int x\n\
                 property float quality\nproperty float red\nelement face 1\nproperty list uchar int vertex_indices\n\
                 end_header\n2 5 6\n7 1.5 -2 3 0.5 1\n8 1e3 0 -1 0 0.5\n3 0 1 0\n";
    let cloud = ply::read(&save(folder.path(), ascii, b"")).unwrap();
    let expected = |x_in_world, colour| CloudPoint {
        x_in_world,
        normal: [0.0; 3],
        colour,
        confidence: 1.0,
        sigma: 0.0,
        views: 0,
    };
    assert_eq!(
        cloud,
        [expected([3.0, -2.0, 1.5], [255, 255, 7]), expected([-1.0, 0.0, 1000.0], [128, 255, 8])]
    );
    let header = "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float z\nproperty float y\n\
                  property short x\nend_header\n";
    let body = [&3.5f32.to_be_bytes()[..], &2.5f32.to_be_bytes(), &(-7i16).to_be_bytes()].concat();
    let cloud = ply::read(&save(folder.path(), header, &body)).unwrap();
    assert_eq!(cloud, [expected([-7.0, 2.5, 3.5], [255; 3])]);
}

#[test]
fn vertices_without_a_position_are_left_out() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    let cloud = vec![point([1.0, 2.0, 3.0]), point([f64::NAN, 0.0, 0.0]), point([0.0, f64::INFINITY, 0.0])];
    ply::write(&path, &cloud).unwrap();
    assert_eq!(ply::read(&path).unwrap(), cloud[..1]);
    assert_eq!(ply::read_positions(&path).unwrap(), [[1.0, 2.0, 3.0]]);
}

#[test]
fn absurd_headers_are_refused_before_anything_is_allocated() {
    let folder = tempdir().unwrap();
    let head = |format: &str, elements: &str| format!("ply\nformat {format} 1.0\n{elements}end_header\n");
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    for (format, elements, expected) in [
        ("binary_little_endian", format!("element vertex 9999999999\n{xyz}"), "9999999999 elements"),
        ("ascii", format!("element vertex 9999999999\n{xyz}"), "9999999999 elements"),
        ("binary_little_endian", format!("element vertex 18446744073709551615\n{xyz}"), "elements"),
        ("binary_little_endian", format!("element a 9999999999\nelement vertex 0\n{xyz}"), "elements \"a\""),
        ("binary_little_endian", "element vertex 1\nproperty float x\nproperty float y\n".to_owned(), "no z"),
        ("binary_little_endian", "element points 1\nproperty float x\n".to_owned(), "\"vertex\", found none"),
        (
            "binary_little_endian",
            format!("element vertex -1\n{xyz}"),
            "line 3: expected a line of a PLY header",
        ),
        ("binary", format!("element vertex 1\n{xyz}"), "line 2: expected a line of a PLY header"),
        ("ascii", format!("element vertex 1\n{xyz}"), "found \"1 2 x 4 5 6 7 8 9 0\""),
    ] {
        let path = save(folder.path(), &head(format, &elements), b"1 2 x 4 5 6 7 8 9 0 ");
        let error = ply::read(&path).unwrap_err().to_string();
        assert!(error.contains("cloud.ply") && error.contains(expected), "{elements}: {error}");
    }
    let list = head(
        "binary_little_endian",
        &format!("element a 1\nproperty list uint int i\nelement vertex 0\n{xyz}"),
    );
    assert!(ply::read(&save(folder.path(), &list, &[0xFF; 8])).is_err());
    let error = ply::read(&save(folder.path(), "solid stl", b"")).unwrap_err().to_string();
    assert!(error.contains("expected a PLY file"), "{error}");
}
