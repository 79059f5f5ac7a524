//! NumPy's `.npy`, version 1.0: a header, padded to a multiple of 64 bytes, then float32 rows from top to bottom.

use std::path::Path;

use vamvs_core::Grid;

use crate::{IoError, atomic};

/// Number of bytes before the header's text: magic, version, length of the text.
const PREAMBLE: usize = 10;

/// Writes a map as an array of shape (height, width).
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub(crate) fn write(path: &Path, grid: &Grid<f32>) -> Result<(), IoError> {
    let (height, width) = (grid.height(), grid.width());
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    let length = (PREAMBLE + text.len() + 1).next_multiple_of(64) - PREAMBLE;
    atomic::write(path, |out| {
        out.write_all(b"\x93NUMPY\x01\x00")?;
        out.write_all(&(length as u16).to_le_bytes())?;
        writeln!(out, "{text:<padded$}", padded = length - 1)?;
        let bytes: Vec<u8> = grid.data().iter().flat_map(|value| value.to_le_bytes()).collect();
        out.write_all(&bytes)
    })
}
