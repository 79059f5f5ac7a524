//! COLMAP's dense workspaces, OpenMVS's depth maps, and lists of the views that see each point.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::Path;

use nalgebra::Vector3;
use proptest::prelude::*;
use tempfile::tempdir;
use vamvs_core::{CloudPoint, DepthMap, Grid, Intrinsics, Pinhole, Pose, Size};
use vamvs_io::atomic;
use vamvs_io::colmap::SeenByWriter;
use vamvs_io::colmap::dense::{self, MapKind};
use vamvs_io::openmvs::{DepthMapFile, write_depth_map};
use vamvs_io::ply::{self, Coordinates, PlyWriter};

fn save(path: &Path, bytes: &[u8]) {
    atomic::write(path, |out| out.write_all(bytes)).unwrap();
}

proptest! {
    #[test]
    fn maps_are_read_as_written(width in 1_usize..9, height in 1_usize..9, seed in 0.1_f32..10.0) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("a.png.geometric.bin");
        let size = Size::new(width, height);
        let depth = Grid::from_fn(size, |x, y| seed * (1 + x + 10 * y) as f32);
        dense::write_depth_map(&path, &depth).unwrap();
        prop_assert_eq!(dense::read_depth_map(&path).unwrap(), depth);
        let normals = Grid::from_fn(size, |x, y| [x as f32, -seed, y as f32]);
        dense::write_normal_map(&path, &normals).unwrap();
        prop_assert_eq!(dense::read_normal_map(&path).unwrap(), normals);
    }
}

#[test]
fn maps_are_planes_of_rows_after_a_text_header() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("n.bin");
    let normals = Grid::from_vec(Size::new(2, 1), vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    dense::write_normal_map(&path, &normals).unwrap();
    let expected =
        [b"2&1&3&".to_vec(), [1f32, 4.0, 2.0, 5.0, 3.0, 6.0].map(f32::to_le_bytes).concat()].concat();
    assert_eq!(fs::read(&path).unwrap(), expected);
    save(&path, &[b"2&2&1&".to_vec(), [-1.0, f32::NAN, 0.0, 2.5].map(f32::to_le_bytes).concat()].concat());
    assert_eq!(dense::read_depth_map(&path).unwrap().data(), [0.0, 0.0, 0.0, 2.5]);
}

#[test]
fn wrong_maps_are_refused() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("d.bin");
    let cases: [(&[u8], &str); 8] = [
        (b"", "header: expected 1 more bytes"),
        (b"2&2&", "header: expected 1 more bytes"),
        (b"2&x&1&", "expected a header like 640&480&1&"),
        (&[b'9'; 100], "expected a header like 640&480&1&"),
        (b"0&2&1&", "expected a size of pixels"),
        (b"18446744073709551615&18446744073709551615&1&", "expected a size of pixels"),
        (b"1&1&3&aaaaaaaaaaaa", "expected a map of 1 channels, found 3"),
        (b"1000000&1000000&1&aaaa", "values: expected 1000000000000 numbers of 4 bytes, found 4 bytes"),
    ];
    for (bytes, expected) in cases {
        save(&path, bytes);
        let error = dense::read_depth_map(&path).unwrap_err().to_string();
        assert!(error.contains("d.bin byte") && error.contains(expected), "{error}");
    }
}

#[test]
fn files_of_a_workspace_are_named_as_colmap_does() {
    let folder = tempdir().unwrap();
    let workspace = folder.path();
    fs::create_dir(workspace.join("stereo")).unwrap();
    let depth = dense::depth_map_path(workspace, "a/b.jpg", MapKind::Photometric);
    assert_eq!(depth, workspace.join("stereo/depth_maps/a/b.jpg.photometric.bin"));
    let normal = dense::normal_map_path(workspace, "b.jpg", MapKind::Geometric);
    assert_eq!(normal, workspace.join("stereo/normal_maps/b.jpg.geometric.bin"));
    dense::write_configurations(workspace, &["b.jpg".to_owned(), "c.png".to_owned()]).unwrap();
    let read = |name: &str| fs::read_to_string(workspace.join(name)).unwrap();
    assert_eq!(read("stereo/fusion.cfg"), "b.jpg\nc.png\n");
    assert_eq!(read("stereo/patch-match.cfg"), "b.jpg\n__auto__, 20\nc.png\n__auto__, 20\n");
}

#[test]
fn the_views_of_points_are_counted_lists() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("fused.ply.vis");
    let mut writer = SeenByWriter::create(&path).unwrap();
    writer.push(&[3, 258]).unwrap();
    writer.push(&[]).unwrap();
    assert!(!path.exists());
    writer.finish().unwrap();
    let expected = [2, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0];
    assert_eq!(fs::read(&path).unwrap(), expected);
}

#[test]
fn a_cloud_with_views_has_them_as_lists_and_is_read_like_any_other() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("scene_dense.ply");
    let point = |x: f64| CloudPoint {
        x_in_world: [x, 0.0, 0.0],
        normal: [0.0, 1.0, 0.0],
        colour: [1, 2, 3],
        confidence: 0.5,
        sigma: 0.0,
        views: 2,
    };
    let mut writer = PlyWriter::create_with_views(&path, Coordinates::Float).unwrap();
    writer.push_seen(&point(1.0), &[7, 300]).unwrap();
    writer.push_seen(&point(2.0), &(0..400).collect::<Vec<_>>()).unwrap();
    writer.finish().unwrap();
    assert_eq!(ply::read(&path).unwrap(), [point(1.0), point(2.0)]);
    let bytes = fs::read(&path).unwrap();
    let head = b"end_header\n";
    let start = bytes.windows(head.len()).position(|window| window == head).unwrap() + head.len();
    let text = String::from_utf8_lossy(&bytes[..start]);
    assert!(text.contains("property list uchar uint view_indices\nproperty list uchar float view_weights\n"));
    // Skips x y z, normal, colour, confidence, sigma and views; the lists follow.
    let lists = &bytes[start + 12 + 12 + 3 + 4 + 4 + 1..];
    assert_eq!(lists[..9], [2, 7, 0, 0, 0, 44, 1, 0, 0]);
    assert_eq!(lists[9..18], [&[2], &1f32.to_le_bytes()[..], &1f32.to_le_bytes()].concat());
    assert_eq!(bytes.len() - start, 2 * 36 + 2 * (1 + 8) + 2 * (1 + 4 * 255));
}

#[test]
fn an_openmvs_depth_map_is_laid_out_as_its_header_says() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("depth0000.dmap");
    let size = Size::new(2, 1);
    let intrinsics = Intrinsics { fx: 10.0, fy: 11.0, cx: 1.0, cy: 0.5 };
    let eye = Vector3::new(1.0, 2.0, 3.0);
    let map = DepthMap {
        camera: Pinhole { size, intrinsics },
        cam_from_world: Pose::look_at(&eye, &Vector3::zeros(), &Vector3::y()),
        depth: Grid::from_vec(size, vec![0.0, 4.0]),
        confidence: Grid::from_vec(size, vec![0.25, 0.75]),
        coarse_confidence: None,
    };
    let normals = Grid::from_vec(size, vec![[0.0; 3], [0.0, 0.0, -1.0]]);
    let file = DepthMapFile { map: &map, normals: &normals, image: "images/a.png", views: &[5, 2] };
    write_depth_map(&path, &file).unwrap();
    let bytes = fs::read(&path).unwrap();
    assert_eq!(bytes[..4], [b'D', b'R', 7, 0]);
    assert_eq!(bytes[4..20], [2, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]);
    assert_eq!(bytes[20..28], [4f32, 4.0].map(f32::to_le_bytes).concat());
    assert_eq!(bytes[28..42], [&[12, 0], &b"images/a.png"[..]].concat());
    assert_eq!(bytes[42..54], [2, 0, 0, 0, 5, 0, 0, 0, 2, 0, 0, 0]);
    let number = |i: usize| f64::from_le_bytes(bytes[54 + 8 * i..][..8].try_into().unwrap());
    // The principal point is half a pixel less, because pixel centres are at whole numbers.
    assert_eq!([0, 1, 2, 4, 5, 8].map(number), [10.0, 0.0, 0.5, 11.0, 0.0, 1.0]);
    let third_row = [15, 16, 17].map(number);
    assert!((Vector3::from(third_row) - map.cam_from_world.forward()).norm() < 1e-12);
    assert!((Vector3::from([18, 19, 20].map(number)) - eye).norm() < 1e-12);
    let maps = [0f32, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.25, 0.75];
    assert_eq!(bytes[54 + 21 * 8..], maps.map(f32::to_le_bytes).concat());
}
