//! Reads numeric and logical arrays by name from MATLAB's level 5 MAT-files, plain or compressed (the default
//! of `save`). Other variables are skipped. Version 7.3 files, which are HDF5, are refused.
//!
//! No crate is used for this: those that read MAT-files print to the terminal, read a damaged file as a
//! shorter one, or panic on it.

use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;

use crate::{IoError, Place};

/// Largest variable that is decompressed, in bytes (256 MiB).
const LARGEST: u64 = 1 << 28;

/// Bytes before the first variable.
const HEADER: usize = 128;

/// Types of data elements (MATLAB's "MAT-File Format", table 1-1).
const UINT32: u32 = 6;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// An array of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Its length along each dimension. MATLAB writes at least two dimensions; a scalar is 1×1.
    pub shape: Vec<usize>,
    /// Its values, with the first dimension varying fastest; `true` is 1.
    pub values: Vec<f64>,
}

/// Reads the arrays of these names, in the order of the names. Imaginary parts are ignored.
///
/// # Errors
/// If the file cannot be read, is not a little-endian MAT-file of level 5, is damaged, or lacks one of the
/// arrays.
pub fn read<const N: usize>(path: &Path, names: [&str; N]) -> Result<[Array; N], IoError> {
    let bytes = std::fs::read(path).map_err(IoError::system("read", path))?;
    let malformed = |problem: String| IoError::malformed(path, Place::Whole, problem);
    check_header(&bytes).map_err(|problem| IoError::unsupported(path, Place::Whole, problem))?;
    let mut found: [Option<Array>; N] = [const { None }; N];
    let mut elements = Elements(&bytes[HEADER..]);
    while let Some(element) = elements.next().map_err(malformed)? {
        let variable = variable(&element, &names).map_err(malformed)?;
        if let Some((index, array)) = variable {
            found[index] = Some(array);
        }
    }
    if let Some(missing) = (0..N).find(|&index| found[index].is_none()) {
        return Err(malformed(format!("expected an array of numbers {:?}, found none", names[missing])));
    }
    Ok(found.map(|array| array.expect("all were found")))
}

fn check_header(bytes: &[u8]) -> Result<(), String> {
    let level_5 = "expected a MAT-file of level 5";
    if bytes.starts_with(b"MATLAB 7.3") {
        return Err(format!("{level_5}, found version 7.3 (HDF5): save it with '-v7'"));
    }
    match bytes.get(HEADER - 4..HEADER) {
        Some([0, 1, b'I', b'M']) => Ok(()),
        Some([1, 0, b'M', b'I']) => {
            Err(format!("{level_5} with little-endian numbers, found big-endian ones"))
        }
        _ => Err(format!("{level_5}, found something else")),
    }
}

/// A data element: its type and content.
struct Element<'a> {
    kind: u32,
    content: &'a [u8],
}

/// An iterator over consecutive data elements in a byte slice.
struct Elements<'a>(&'a [u8]);

impl<'a> Elements<'a> {
    fn next(&mut self) -> Result<Option<Element<'a>>, String> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let tag = self.take(4)?;
        let word = u32_of(tag);
        if word >> 16 != 0 {
            // A small element: length, type and up to four bytes of content, eight bytes in all.
            let content = self.take(4)?.get(..(word >> 16) as usize);
            let content = content.ok_or("found a small element of more than four bytes")?;
            return Ok(Some(Element { kind: word & 0xFFFF, content }));
        }
        let length = u32_of(self.take(4)?) as usize;
        let content = self.take(length)?;
        if word != COMPRESSED {
            // Elements begin at multiples of eight bytes; the last one may lack its padding.
            let padding = length.next_multiple_of(8) - length;
            self.0 = &self.0[padding.min(self.0.len())..];
        }
        Ok(Some(Element { kind: word, content }))
    }

    /// The next element, which holds `what`.
    fn expect(&mut self, what: &str) -> Result<Element<'a>, String> {
        self.next()?.ok_or_else(|| format!("{what}: missing, the variable ends here"))
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or_else(|| {
            format!("expected {count} more bytes, found {}: the file is truncated or damaged", self.0.len())
        })?;
        self.0 = rest;
        Ok(taken)
    }
}

fn u32_of(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes.try_into().expect("four bytes"))
}

/// The array in a top-level element and the index of its name in `names`; `None` if it is not one of these.
fn variable(element: &Element, names: &[&str]) -> Result<Option<(usize, Array)>, String> {
    match element.kind {
        MATRIX => matrix(element.content, names),
        COMPRESSED => {
            let bytes = inflated(element.content)?;
            match Elements(&bytes).next()? {
                Some(Element { kind: MATRIX, content }) => matrix(content, names),
                _ => Ok(None),
            }
        }
        _ => Ok(None),
    }
}

fn inflated(content: &[u8]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let read = ZlibDecoder::new(content).take(LARGEST + 1).read_to_end(&mut bytes);
    let read = read.map_err(|error| format!("a variable cannot be decompressed: {error}"))?;
    if read as u64 > LARGEST { Err(format!("a variable is larger than {LARGEST} bytes")) } else { Ok(bytes) }
}

fn matrix(content: &[u8], names: &[&str]) -> Result<Option<(usize, Array)>, String> {
    let mut parts = Elements(content);
    let flags = parts.expect("array flags")?;
    if flags.kind != UINT32 || flags.content.len() != 8 {
        return Err("expected array flags of 8 bytes at the beginning of a variable".to_owned());
    }
    // Classes 6 to 15 are numeric arrays. Others (cells, structures, text, sparse arrays) continue in another way.
    let is_numeric = (6..=15).contains(&flags.content[0]);
    let shape = shape(&parts.expect("dimensions")?)?;
    let name = String::from_utf8_lossy(parts.expect("name")?.content).into_owned();
    let Some(index) = names.iter().position(|wanted| *wanted == name).filter(|_| is_numeric) else {
        return Ok(None);
    };
    let values = numbers(&parts.expect(&name)?).map_err(|problem| format!("{name}: {problem}"))?;
    let announced = shape.iter().try_fold(1_usize, |product, &length| product.checked_mul(length));
    if announced != Some(values.len()) {
        return Err(format!("{name}: expected {shape:?} values, found {}", values.len()));
    }
    Ok(Some((index, Array { shape, values })))
}

fn shape(element: &Element) -> Result<Vec<usize>, String> {
    let lengths = element.content.chunks_exact(4).map(u32_of).map(|length| usize::try_from(length as i32));
    let shape: Result<Vec<usize>, _> = lengths.collect();
    shape.map_err(|_| "expected lengths of dimensions, found a negative one".to_owned())
}

/// The numbers of an element. MATLAB may store them in a smaller type than the array's.
fn numbers(element: &Element) -> Result<Vec<f64>, String> {
    let bytes = element.content;
    Ok(match element.kind {
        1 => bytes.iter().map(|&byte| f64::from(byte as i8)).collect(),
        2 => bytes.iter().map(|&byte| f64::from(byte)).collect(),
        3 => typed(bytes, |b| f64::from(i16::from_le_bytes(b))),
        4 => typed(bytes, |b| f64::from(u16::from_le_bytes(b))),
        5 => typed(bytes, |b| f64::from(i32::from_le_bytes(b))),
        UINT32 => typed(bytes, |b| f64::from(u32::from_le_bytes(b))),
        7 => typed(bytes, |b| f64::from(f32::from_le_bytes(b))),
        9 => typed(bytes, f64::from_le_bytes),
        12 => typed(bytes, |b| i64::from_le_bytes(b) as f64),
        13 => typed(bytes, |b| u64::from_le_bytes(b) as f64),
        other => return Err(format!("expected numbers, found data of type {other}")),
    })
}

fn typed<const B: usize>(bytes: &[u8], number: impl Fn([u8; B]) -> f64) -> Vec<f64> {
    bytes.as_chunks::<B>().0.iter().map(|&bytes| number(bytes)).collect()
}
