//! Writes MAT-files as MATLAB does, for tests.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::Write;

use flate2::{Compression, write::ZlibEncoder};

/// A data element of a MAT-file, padded to a multiple of eight bytes.
pub fn element(kind: u32, content: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (content.len() as u32).to_le_bytes()].concat();
    bytes.extend(content);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// An element of up to four bytes in MATLAB's short form.
pub fn small(kind: u16, content: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (content.len() as u16).to_le_bytes()].concat();
    bytes.extend(content);
    bytes.resize(8, 0);
    bytes
}

pub fn variable(name: &str, class: u8, shape: &[i32], data: &[u8]) -> Vec<u8> {
    let flags = element(6, &[class, 0, 0, 0, 0, 0, 0, 0]);
    let shape: Vec<u8> = shape.iter().flat_map(|length| length.to_le_bytes()).collect();
    let name = if name.len() <= 4 { small(1, name.as_bytes()) } else { element(1, name.as_bytes()) };
    element(14, &[&flags[..], &element(5, &shape), &name, data].concat())
}

pub fn doubles(values: &[f64]) -> Vec<u8> {
    element(9, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
}

pub fn compressed(variable: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(variable).unwrap();
    let stream = encoder.finish().unwrap();
    [&15_u32.to_le_bytes()[..], &(stream.len() as u32).to_le_bytes(), &stream].concat()
}

pub fn mat_file(variables: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"MATLAB 5.0 MAT-file, made by a test".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(variables.concat());
    bytes
}

/// The variables of an observability mask of 2×3×2 voxels, with the voxels (1, 0, 0) and (0, 2, 1) set.
pub fn mask_variables() -> Vec<Vec<u8>> {
    let mut voxels = [0_u8; 12];
    (voxels[1], voxels[4 + 6]) = (1, 1);
    vec![
        variable("ObsMask", 9, &[2, 3, 2], &element(2, &voxels)),
        // Columns: x of both corners, y of both, z of both.
        variable("BB", 6, &[2, 3], &doubles(&[-10.0, 90.5, -20.0, 80.0, 500.0, 700.0])),
        variable("Res", 6, &[1, 1], &small(2, &[3])),
    ]
}
