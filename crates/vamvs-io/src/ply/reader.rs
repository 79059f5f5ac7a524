//! Reads clouds, ASCII or binary, with the vertices' properties in any order.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, PropertyAccess, PropertyType, ScalarType};
use vamvs_core::{Cloud, CloudPoint};

use super::vertex::{self, Position, Vertex};
use crate::{IoError, Place};

/// Number of elements that are in memory at a time as the parser gives them.
pub(super) const PART: usize = 1 << 16;

/// Reads the vertices of a PLY file.
///
/// The properties `x y z` are required. If missing, `nx ny nz` are 0, `red green blue` 255, `confidence` 1,
/// `sigma` 0 and `views` 0. Floating-point colours are read as 0 to 1. Other properties and elements are ignored.
/// Vertices whose position is not finite (organised scans have them) are left out.
///
/// # Errors
/// If the file cannot be read, is not a PLY file, has no vertices with positions, or is shorter than its
/// header announces.
pub fn read(path: &Path) -> Result<Cloud, IoError> {
    let vertices: Vec<Vertex> = read_vertices(path)?;
    Ok(vertices.into_iter().map(|vertex| vertex.0).filter(is_finite).collect())
}

/// Reads some vertices of a PLY file, and returns the number of all vertices and the chosen ones. Memory does not
/// grow with the number of vertices in the file.
///
/// `choose` gets the number of vertices in the file and returns the indices of those to read, in ascending order.
/// Chosen vertices whose position is not finite are left out.
///
/// # Errors
/// As [`read`].
pub fn read_some(path: &Path, choose: &dyn Fn(usize) -> Vec<usize>) -> Result<(usize, Cloud), IoError> {
    let (mut reader, header) = open_vertices(path)?;
    let count = header.elements.get(vertex::NAME).map_or(0, |vertices| vertices.count);
    if let Some(bytes) = equal_records(&header) {
        let taken = read_records(&mut reader, &header, bytes, choose(count), path)?;
        return Ok((count, taken.into_iter().filter(is_finite).collect()));
    }
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

/// The bytes of a vertex, if the file begins with vertices that all take the same number of them.
fn equal_records(header: &Header) -> Option<u64> {
    let (name, first) = header.elements.first()?;
    let mut kinds = first.properties.values().map(|property| &property.data_type);
    let equal =
        header.encoding != Encoding::Ascii && kinds.all(|kind| matches!(kind, PropertyType::Scalar(_)));
    (name == vertex::NAME && equal).then(|| least_bytes(first, header.encoding))
}

/// Reads the vertices of these indices, which ascend, from a file in which each takes as many `bytes`.
fn read_records(
    reader: &mut Reader<BufReader<File>>,
    header: &Header,
    bytes: u64,
    wanted: Vec<usize>,
    path: &Path,
) -> Result<Cloud, IoError> {
    let single = ElementDef { count: 1, ..header.elements[vertex::NAME].clone() };
    let (parser, mut next) = (Parser::<Vertex>::new(), 0);
    let mut taken = Cloud::with_capacity(wanted.len());
    for place in wanted {
        let skipped = (place - next) as u64 * bytes;
        reader.get_mut().seek_relative(skipped as i64).map_err(IoError::system("read", path))?;
        let vertices = parser.read_payload_for_element(reader, &single, header).map_err(malformed(path))?;
        taken.extend(vertices.into_iter().map(|vertex| vertex.0));
        next = place + 1;
    }
    Ok(taken)
}

/// Reads only the positions of a PLY file's vertices. This takes half the memory of whole points.
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

/// Opens a PLY file and reads its header. Fails unless there are vertices with positions and the file is long enough
/// for the elements that the header announces.
pub(super) fn open_vertices(path: &Path) -> Result<(Reader<BufReader<File>>, Header), IoError> {
    let (mut reader, length) = open(path)?;
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(malformed(path))?;
    let begin = reader.get_mut().stream_position().map_err(IoError::system("read", path))?;
    check_lengths(&header, length.saturating_sub(begin))
        .and_then(|()| check_positions(&header))
        .map_err(|problem| IoError::malformed(path, Place::Byte(begin), problem))?;
    Ok((reader, header))
}

/// Opens a file, which must begin with `ply`, and returns its length in bytes too.
fn open(path: &Path) -> Result<(Reader<BufReader<File>>, u64), IoError> {
    let file = File::open(path).map_err(IoError::system("open", path))?;
    let length = file.metadata().map_err(IoError::system("inspect", path))?.len();
    let mut buffered = BufReader::with_capacity(1 << 18, file);
    if !buffered.fill_buf().map_err(IoError::system("read", path))?.starts_with(b"ply") {
        return Err(IoError::malformed(path, Place::Byte(0), "expected a PLY file to begin with \"ply\""));
    }
    Ok((Reader::new(buffered), length))
}

/// Checks that the announced elements fit into the `remaining` bytes. Each takes at least one byte.
fn check_lengths(header: &Header, remaining: u64) -> Result<(), String> {
    let mut left = remaining;
    for element in header.elements.values() {
        let least = least_bytes(element, header.encoding).max(1);
        let needed = (element.count as u64).checked_mul(least);
        left = needed.and_then(|needed| left.checked_sub(needed)).ok_or_else(|| {
            let (name, count) = (&element.name, element.count);
            format!(
                "{count} elements {name:?} of at least {least} bytes are announced, but {left} bytes are left"
            )
        })?;
    }
    Ok(())
}

/// The fewest bytes that one element of this type takes.
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

/// Reads the vertices and passes them to `visit` in parts of at most `part` vertices.
fn read_payload<T: PropertyAccess>(
    reader: &mut Reader<BufReader<File>>,
    header: &Header,
    part: usize,
    visit: &mut dyn FnMut(Vec<T>),
) -> Result<(), ParseError> {
    for element in header.elements.values() {
        if element.name != vertex::NAME {
            Parser::<Skipped>::new().read_payload_for_element(reader, element, header)?;
            continue;
        }
        return read_parts(reader, (element, header), part, visit);
    }
    Ok(())
}

/// Reads all elements of a type, and passes them to `visit` in parts of at most `part`.
pub(super) fn read_parts<T: PropertyAccess>(
    reader: &mut Reader<BufReader<File>>,
    (element, header): (&ElementDef, &Header),
    part: usize,
    visit: &mut dyn FnMut(Vec<T>),
) -> Result<(), ParseError> {
    let mut left = element.count;
    while left > 0 {
        let next = ElementDef { count: left.min(part), ..element.clone() };
        visit(Parser::<T>::new().read_payload_for_element(reader, &next, header)?);
        left -= next.count;
    }
    Ok(())
}

/// The parser's error in this file, without what only its authors can read.
pub(super) fn malformed(path: &Path) -> impl FnOnce(ParseError) -> IoError {
    move |error| {
        let text = error.to_string();
        let Some(number) = error.line() else {
            return IoError::malformed(path, Place::Whole, text.lines().next().unwrap_or_default());
        };
        let problem = match line(path, number) {
            Some(found) => {
                format!("expected a line of a PLY header or the numbers of an element, found {found:?}")
            }
            None => "expected another line, found the end of the file".to_owned(),
        };
        IoError::malformed(path, Place::Line(number), problem)
    }
}

/// The beginning of a line, counted from 1.
fn line(path: &Path, number: usize) -> Option<String> {
    let mut lines = BufReader::new(File::open(path).ok()?).split(b'\n');
    let line = lines.nth(number - 1)?.ok()?;
    Some(String::from_utf8_lossy(&line).trim_end().chars().take(60).collect())
}

/// An element that is skipped: all its properties are ignored.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
