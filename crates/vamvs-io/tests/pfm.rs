//! Portable float maps: round trips, headers as found in the wild, and hostile files.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use tempfile::tempdir;
use vamvs_core::{Grid, Size};
use vamvs_io::{atomic, pfm};

fn save(folder: &Path, header: &str, body: &[u8]) -> PathBuf {
    let path = folder.join("depth.pfm");
    atomic::write(&path, |out| {
        out.write_all(header.as_bytes())?;
        out.write_all(body)
    })
    .unwrap();
    path
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn maps_are_read_as_written(width in 1usize..9, height in 1usize..9, seed in any::<u32>()) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("é map.pfm");
        let value = |x, y| f32::from_bits(seed.wrapping_mul(1 + x as u32).wrapping_add(y as u32 * 77));
        let grid = Grid::from_fn(Size::new(width, height), value);
        pfm::write(&path, &grid).unwrap();
        prop_assert_eq!(pfm::read(&path).unwrap().map(|v| v.to_bits()), grid.map(|v| v.to_bits()));
    }

    #[test]
    fn mangled_maps_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let folder = tempdir().unwrap();
        let mut whole = [b"Pf\n3 2\n-1.0\n".to_vec(), bytes(&[1.0; 6])].concat();
        for (place, value) in changes {
            let place = place.index(whole.len());
            whole[place] = value;
        }
        let path = save(folder.path(), "", &whole);
        let _ = pfm::read(&path);
        let _ = pfm::read_rgb(&path);
    }
}

#[test]
fn maps_of_three_channels_are_read_as_written() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("normals.pfm");
    let grid = Grid::from_fn(Size::new(3, 2), |x, y| [x as f32, y as f32, -0.5]);
    pfm::write_rgb(&path, &grid).unwrap();
    assert_eq!(pfm::read_rgb(&path).unwrap(), grid);
    assert!(pfm::read(&path).unwrap_err().to_string().contains("\"Pf\""));
}

#[test]
fn rows_are_stored_from_bottom_to_top() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.pfm");
    pfm::write(&path, &Grid::from_vec(Size::new(2, 2), vec![1.0, 2.0, 3.0, 4.0])).unwrap();
    let expected = [b"Pf\n2 2\n-1.0\n".to_vec(), bytes(&[3.0, 4.0, 1.0, 2.0])].concat();
    assert_eq!(fs::read(&path).unwrap(), expected);
}

#[test]
fn headers_as_found_in_the_wild_are_read() {
    let folder = tempdir().unwrap();
    // The first pixel's first byte is a line feed, which must not be taken for the end of the header.
    let values = [f32::from_le_bytes([10, 0, 0, 64]), 2.0];
    for header in
        ["Pf\n2 1\n-1.0\n", "Pf\r\n2 1\r\n-1\r\n", "Pf\n# by hand\n2\n1\n# x\n-0.003 ", "Pf 2 1 -1e0\n"]
    {
        let path = save(folder.path(), header, &bytes(&values));
        assert_eq!(pfm::read(&path).unwrap().data(), values, "{header:?}");
    }
    let big_endian: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
    assert_eq!(pfm::read(&save(folder.path(), "Pf\n2 1\n1.0\n", &big_endian)).unwrap().data(), values);
}

#[test]
fn three_channels_are_read_as_such_only() {
    let folder = tempdir().unwrap();
    let path = save(folder.path(), "PF\n1 2\n-1\n", &bytes(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    assert_eq!(pfm::read_rgb(&path).unwrap().data(), [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]);
    assert!(pfm::read(&path).unwrap_err().to_string().contains("expected \"Pf\""));
    let path = save(folder.path(), "Pf\n1 1\n-1\n", &bytes(&[1.0]));
    assert!(pfm::read_rgb(&path).unwrap_err().to_string().contains("expected \"PF\""));
}

#[test]
fn what_is_no_depth_is_read_as_none() {
    let folder = tempdir().unwrap();
    let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.0, 3.5];
    let path = save(folder.path(), "Pf\n6 1\n-1\n", &bytes(&values));
    assert_eq!(pfm::read_depth(&path).unwrap().data(), [0.0, 0.0, 0.0, 0.0, 0.0, 3.5]);
    assert!(pfm::read(&path).unwrap()[(0, 0)].is_nan());
}

#[test]
fn maps_cut_anywhere_are_refused() {
    let folder = tempdir().unwrap();
    let whole = [b"Pf\n3 2\n-1.0\n".to_vec(), bytes(&[1.0; 6])].concat();
    for length in 0..whole.len() {
        let error = pfm::read(&save(folder.path(), "", &whole[..length])).unwrap_err().to_string();
        assert!(error.contains("depth.pfm byte"), "{length}: {error}");
    }
}

#[test]
fn absurd_headers_are_refused_before_anything_is_allocated() {
    let folder = tempdir().unwrap();
    for (header, expected) in [
        ("Pf\n100000 100000\n-1\n", "take 40000000000 bytes, found 4"),
        ("Pf\n4294967296 4294967296\n-1\n", "more than any file holds"),
        ("Pf\n99999999999999999999 1\n-1\n", "width: expected a positive whole number"),
        ("Pf\n0 1\n-1\n", "width"),
        ("Pf\n1 -1\n-1\n", "height"),
        ("Pf\n1 1\nnan\n", "scale"),
        ("Pf\n1 1\n0\n", "scale"),
        ("P6\n1 1\n255\n", "expected \"Pf\""),
        ("Pf\n1 2\n-1\n", "take 8 bytes, found 4"),
    ] {
        let error = pfm::read(&save(folder.path(), header, &[0; 4])).unwrap_err().to_string();
        assert!(error.contains(expected), "{header:?}: {error}");
    }
    let error = pfm::read(&save(folder.path(), "", &[b'x'; 1000])).unwrap_err().to_string();
    assert!(error.contains("found other data"), "{error}");
    let error = pfm::read(&save(folder.path(), "Pf\n1 1\n-1\n", &[0; 6])).unwrap_err().to_string();
    assert!(error.contains("take 4 bytes, found 6"), "{error}");
}
