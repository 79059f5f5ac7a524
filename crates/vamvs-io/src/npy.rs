//! NumPy's `.npy`: a header, padded to a multiple of 64 bytes, then rows from top to bottom. Version 1.0 with float32
//! is written; 1.0 to 3.0 with floats of 16, 32 and 64 bits and unsigned integers of 16 bits, little-endian, are read.

use std::path::Path;

use vamvs_core::{Grid, Size};

use crate::{IoError, Place, atomic};

/// The first bytes of a file.
const MAGIC: &[u8] = b"\x93NUMPY";

/// Number of bytes before the header's text: magic, version, length of the text.
const PREAMBLE: usize = 10;

/// Reads an array of shape (height, width); axes of length 1 before or after these two are ignored. The numbers are not
/// changed.
///
/// # Errors
/// If the file cannot be read, is no such array, or its length is not what its header announces.
pub(crate) fn read(path: &Path) -> Result<Grid<f32>, IoError> {
    let bytes = std::fs::read(path).map_err(IoError::system("read", path))?;
    let malformed = |problem: String| IoError::malformed(path, Place::Whole, problem);
    let (text, values) = split(&bytes)
        .ok_or_else(|| malformed("expected a NumPy array (.npy), found something else".to_owned()))?;
    let header = Header::of(text)
        .ok_or_else(|| malformed(format!("expected a NumPy header, found {:?}", text.trim_end())))?;
    let unsupported = |problem: String| IoError::unsupported(path, Place::Whole, problem);
    let &[height, width] = &header.sides[..] else {
        return Err(unsupported(format!(
            "expected an array of shape (height, width), found {:?}",
            header.shape
        )));
    };
    let (bytes_each, decode) = header.numbers().ok_or_else(|| {
        unsupported(format!(
            "expected numbers of type '<f2', '<f4', '<f8' or '<u2', rows from top to bottom, found {:?}{}",
            header.kind,
            if header.by_columns { ", by columns (fortran_order)" } else { "" }
        ))
    })?;
    let expected = height.checked_mul(width).and_then(|count| count.checked_mul(bytes_each));
    if expected != Some(values.len()) {
        let problem = format!(
            "expected {width}\u{d7}{height} numbers of {bytes_each} bytes after the header, found {} bytes",
            values.len()
        );
        return Err(malformed(problem));
    }
    Ok(Grid::from_vec(Size::new(width, height), values.chunks_exact(bytes_each).map(decode).collect()))
}

/// The header's text, and the numbers behind it.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (&[version, _], rest) = rest.split_first_chunk()?;
    let (length, rest) = if version == 1 {
        let (length, rest) = rest.split_first_chunk()?;
        (usize::from(u16::from_le_bytes(*length)), rest)
    } else {
        let (length, rest) = rest.split_first_chunk()?;
        (u32::from_le_bytes(*length) as usize, rest)
    };
    let (text, values) = rest.split_at_checked(length)?;
    Some((std::str::from_utf8(text).ok()?, values))
}

/// What the header says.
struct Header<'a> {
    kind: &'a str,
    by_columns: bool,
    /// The shape as it is written.
    shape: &'a str,
    /// Its sides without those of length 1 at both ends.
    sides: Vec<usize>,
}

/// A number of some bytes.
type Decode = fn(&[u8]) -> f32;

impl<'a> Header<'a> {
    fn of(text: &'a str) -> Option<Self> {
        let behind = |key: &str| Some(text.split_once(key)?.1.trim_start_matches([' ', ':']));
        let kind = behind("'descr'")?.strip_prefix('\'')?.split_once('\'')?.0;
        let by_columns = behind("'fortran_order'")?.starts_with("True");
        let shape = behind("'shape'")?.strip_prefix('(')?.split_once(')')?.0;
        let sides = shape.split(',').map(str::trim).filter(|side| !side.is_empty());
        let mut sides: Vec<usize> = sides.map(|side| side.parse().ok()).collect::<Option<_>>()?;
        while sides.len() > 2 && sides.last() == Some(&1) {
            sides.pop();
        }
        while sides.len() > 2 && sides[0] == 1 {
            sides.remove(0);
        }
        Some(Self { kind, by_columns, shape, sides })
    }

    /// The bytes of a number, and how it is decoded; `None` if that is not supported.
    fn numbers(&self) -> Option<(usize, Decode)> {
        match self.kind {
            _ if self.by_columns => None,
            "<f2" => Some((2, |bytes| half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32())),
            "<u2" => Some((2, |bytes| f32::from(u16::from_le_bytes([bytes[0], bytes[1]])))),
            "<f4" => Some((4, |bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))),
            "<f8" => Some((8, |bytes| {
                f64::from_le_bytes(bytes.try_into().expect("chunks have eight bytes")) as f32
            })),
            _ => None,
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, values: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.npy");
        atomic::write(&path, |out| {
            out.write_all(b"\x93NUMPY\x01\x00")?;
            out.write_all(&(header.len() as u16).to_le_bytes())?;
            out.write_all(header.as_bytes())?;
            out.write_all(values)
        })
        .unwrap();
        (folder, path)
    }

    #[test]
    fn arrays_of_all_kinds_are_read() {
        let expected = Grid::from_vec(Size::new(3, 1), vec![1.0, 2.5, 3.0]);
        let doubles: Vec<u8> = [1.0_f64, 2.5, 3.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        let floats: Vec<u8> = [1.0_f32, 2.5, 3.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        let halves = [0x00, 0x3c, 0x00, 0x41, 0x00, 0x42];
        for (kind, shape, values) in
            [("<f8", "(1, 3)", &doubles[..]), ("<f4", "(1, 1, 3, 1)", &floats), ("<f2", "(1, 3,)", &halves)]
        {
            let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
            let (_folder, path) = file(&header, values);
            assert_eq!(read(&path).unwrap(), expected, "{kind}");
        }
        let written = tempfile::tempdir().unwrap();
        let path = written.path().join("d.npy");
        write(&path, &expected).unwrap();
        assert_eq!(read(&path).unwrap(), expected);
    }

    #[test]
    fn what_is_no_map_is_told() {
        let header = |kind: &str, shape: &str| {
            format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n")
        };
        for (header, length, expected) in [
            (header("<f4", "(2, 3)"), 23, "found 23 bytes"),
            (header("<f4", "(2, 3, 4)"), 96, "(height, width), found \"2, 3, 4\""),
            (header("<i8", "(1, 1)"), 8, "found \"<i8\""),
            (header("<f4", "(99999999999, 99999999999)"), 8, "found 8 bytes"),
            ("{}".to_owned(), 0, "NumPy header"),
        ] {
            let (_folder, path) = file(&header, &vec![0; length]);
            let error = read(&path).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("d.npy"), "{error}");
        }
    }
}
