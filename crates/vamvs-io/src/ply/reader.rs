//! Reading of clouds: ascii and binary, the vertices' properties in any order.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, PropertyAccess, PropertyType, ScalarType};
use vamvs_core::{Cloud, CloudPoint};

use super::vertex::{self, Position, Vertex};
use crate::{IoError, Place};

/// Vertices that are read at once where only some are wanted.
const PART: usize = 1 << 16;

/// Reads the vertices of a PLY file.
///
/// Needed are `x y z`; `nx ny nz` are 0 if missing, `red green blue` 255 (those of a floating-point
/// type are taken as 0 to 1), `confidence` 1 and `views` 0. Other properties and elements are left out,
/// and so are vertices whose position is not finite, as organised scans have them.
///
/// # Errors
/// If the file cannot be read, is no PLY file, has no vertices with positions, or is shorter than its
/// header announces.
pub fn read(path: &Path) -> Result<Cloud, IoError> {
    let vertices: Vec<Vertex> = read_vertices(path)?;
    Ok(vertices.into_iter().map(|vertex| vertex.0).filter(is_finite).collect())
}

/// Reads some vertices of a PLY file, in little memory however many there are: those at the places, ascending, that
/// `choose` gives for their number, which is given back too.
///
/// # Errors
/// As [`read`].
pub fn read_some(path: &Path, choose: impl FnOnce(usize) -> Vec<usize>) -> Result<(usize, Cloud), IoError> {
    let (mut reader, header) = open_vertices(path)?;
    let count = header.elements.get(vertex::NAME).map_or(0, |vertices| vertices.count);
    let (mut wanted, mut taken) = (choose(count).into_iter().peekable(), Cloud::new());
    let mut begin = 0;
    let mut visit = |part: Vec<Vertex>| {
        while let Some(place) = wanted.next_if(|&place| place < begin + part.len()) {
            taken.push(part[place - begin].0);
        }
        begin += part.len();
    };
    read_payload(&mut reader, &header, PART, &mut visit).map_err(malformed(path))?;
    Ok((count, taken.into_iter().filter(is_finite).collect()))
}

/// Reads the positions of a PLY file's vertices alone, in half the memory that whole points take.
///
/// # Errors
/// As [`read`].
pub fn read_positions(path: &Path) -> Result<Vec<[f64; 3]>, IoError> {
    let vertices: Vec<Position> = read_vertices(path)?;
    let finite = |x: &[f64; 3]| x.iter().all(|value| value.is_finite());
    Ok(vertices.into_iter().map(|vertex| vertex.0).filter(finite).collect())
}

fn is_finite(point: &CloudPoint) -> bool {
    point.x_in_world.iter().all(|value| value.is_finite())
}

fn read_vertices<T: PropertyAccess>(path: &Path) -> Result<Vec<T>, IoError> {
    let (mut reader, header) = open_vertices(path)?;
    let mut all = Vec::new();
    read_payload(&mut reader, &header, usize::MAX, &mut |part| all = part).map_err(malformed(path))?;
    Ok(all)
}

/// A reader that stands behind the header, which announces vertices with positions, no more than there can be.
fn open_vertices(path: &Path) -> Result<(Reader<BufReader<File>>, Header), IoError> {
    let (mut reader, length) = open(path)?;
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(malformed(path))?;
    let begin = reader.get_mut().stream_position().map_err(IoError::system("read", path))?;
    check_lengths(&header, length.saturating_sub(begin))
        .and_then(|()| check_positions(&header))
        .map_err(|problem| IoError::malformed(path, Place::Byte(begin), problem))?;
    Ok((reader, header))
}

/// A reader of a file that begins as a PLY file, and the file's length.
fn open(path: &Path) -> Result<(Reader<BufReader<File>>, u64), IoError> {
    let file = File::open(path).map_err(IoError::system("open", path))?;
    let length = file.metadata().map_err(IoError::system("inspect", path))?.len();
    let mut buffered = BufReader::with_capacity(1 << 18, file);
    if !buffered.fill_buf().map_err(IoError::system("read", path))?.starts_with(b"ply") {
        return Err(IoError::malformed(path, Place::Byte(0), "expected a PLY file to begin with \"ply\""));
    }
    Ok((Reader::new(buffered), length))
}

/// Checks that the elements fit into the `remaining` bytes, each with at least one byte.
fn check_lengths(header: &Header, remaining: u64) -> Result<(), String> {
    let mut left = remaining;
    for element in header.elements.values() {
        let least = least_bytes(element, header.encoding).max(1);
        let needed = (element.count as u64).checked_mul(least);
        left = needed.and_then(|needed| left.checked_sub(needed)).ok_or_else(|| {
            let (name, count) = (&element.name, element.count);
            format!(
                "{count} elements {name:?} of at least {least} bytes are announced, {left} bytes are left"
            )
        })?;
    }
    Ok(())
}

/// The fewest bytes that an element takes.
fn least_bytes(element: &ElementDef, encoding: Encoding) -> u64 {
    let bytes = |property: &PropertyType| match (encoding, property) {
        (Encoding::Ascii, _) => 1,
        (_, PropertyType::Scalar(kind) | PropertyType::List(kind, _)) => scalar_bytes(kind),
    };
    element.properties.values().map(|property| bytes(&property.data_type)).sum()
}

fn scalar_bytes(kind: &ScalarType) -> u64 {
    match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

fn check_positions(header: &Header) -> Result<(), String> {
    let vertices = header.elements.get(vertex::NAME).ok_or("expected an element \"vertex\", found none")?;
    match ["x", "y", "z"].into_iter().find(|&axis| !vertices.properties.contains_key(axis)) {
        None => Ok(()),
        Some(axis) => Err(format!("expected the vertices to have x, y and z, found no {axis}")),
    }
}

/// Visits the vertices in parts of at most so many.
fn read_payload<T: PropertyAccess>(
    reader: &mut Reader<BufReader<File>>,
    header: &Header,
    part: usize,
    visit: &mut impl FnMut(Vec<T>),
) -> Result<(), ParseError> {
    for element in header.elements.values() {
        if element.name != vertex::NAME {
            Parser::<Skipped>::new().read_payload_for_element(reader, element, header)?;
            continue;
        }
        let mut left = element.clone();
        while left.count > 0 {
            let next = ElementDef { count: left.count.min(part), ..element.clone() };
            visit(Parser::<T>::new().read_payload_for_element(reader, &next, header)?);
            left.count -= next.count;
        }
        return Ok(());
    }
    Ok(())
}

fn malformed(path: &Path) -> impl FnOnce(ParseError) -> IoError {
    move |error| {
        let place = error.line().map_or(Place::Whole, Place::Line);
        IoError::malformed(path, place, error)
    }
}

/// An element of which nothing is kept.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
