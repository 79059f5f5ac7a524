//! A streaming writer: points as they come, their number known only at the end.

use std::io::{self, Seek, SeekFrom};
use std::path::Path;

use ply_rs_bw::ply::{Addable, ElementDef, Encoding, Header, PropertyDef, PropertyType, ScalarType};
use ply_rs_bw::writer::Writer;
use vamvs_core::CloudPoint;

use super::vertex::{self, SeenVertex, VIEW_INDICES, VIEW_WEIGHTS, Vertex};
use crate::IoError;
use crate::atomic::AtomicFile;

/// Ratio of the largest coordinate to the cloud's extent above which floats do not suffice: a float
/// has 2²⁴ steps, so that at this ratio the extent has some 170 000 of them.
const FAR_FROM_ORIGIN: f64 = 1e2;

/// The weights of a point's views: all alike, and as many as a `uchar` counts.
const WEIGHTS: [f32; 255] = [1.0; 255];

/// Digits of the largest number of points, for which the header leaves room.
const COUNT_DIGITS: usize = 20;

/// The type of the coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinates {
    /// `float`, 32 bits.
    Float,
    /// `double`, 64 bits.
    Double,
}

impl Coordinates {
    /// `Double` if the largest absolute coordinate is more than 100 times the cloud's extent (the
    /// largest side of its bounding box), as with UTM coordinates.
    #[must_use]
    pub fn for_points<'a>(points: impl IntoIterator<Item = &'a CloudPoint>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in points {
            for axis in 0..3 {
                low[axis] = low[axis].min(point.x_in_world[axis]);
                high[axis] = high[axis].max(point.x_in_world[axis]);
            }
        }
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        let largest = low.iter().chain(&high).map(|value| value.abs()).fold(0.0, f64::max);
        if largest.is_finite() && largest > FAR_FROM_ORIGIN * extent { Self::Double } else { Self::Float }
    }

    fn kind(self) -> ScalarType {
        match self {
            Self::Float => ScalarType::Float,
            Self::Double => ScalarType::Double,
        }
    }
}

/// Writes a cloud with the coordinates that fit it.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write(path: &Path, cloud: &[CloudPoint]) -> Result<(), IoError> {
    let mut writer = PlyWriter::create(path, Coordinates::for_points(cloud))?;
    cloud.iter().try_for_each(|point| writer.push(point))?;
    writer.finish()
}

/// Writes a cloud point by point; the file comes into being with [`PlyWriter::finish`].
#[derive(Debug)]
pub struct PlyWriter {
    file: AtomicFile,
    element: ElementDef,
}

impl PlyWriter {
    /// Begins the file `path`; its folder must exist.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn create(path: &Path, coordinates: Coordinates) -> Result<Self, IoError> {
        Self::begin(path, element(coordinates))
    }

    /// Begins a file the points of which come with the views that see them, by [`PlyWriter::push_seen`]:
    /// as `view_indices` and `view_weights`, where OpenMVS looks for them.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn create_with_views(path: &Path, coordinates: Coordinates) -> Result<Self, IoError> {
        let mut element = element(coordinates);
        for (name, kind) in [(VIEW_INDICES, ScalarType::UInt), (VIEW_WEIGHTS, ScalarType::Float)] {
            let list = PropertyType::List(ScalarType::UChar, kind);
            element.properties.add(PropertyDef::new(name.to_owned(), list));
        }
        Self::begin(path, element)
    }

    fn begin(path: &Path, element: ElementDef) -> Result<Self, IoError> {
        let mut writer = Self { file: AtomicFile::create(path)?, element };
        let written = writer.write_header();
        writer.check(written)?;
        Ok(writer)
    }

    /// Adds a point.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn push(&mut self, point: &CloudPoint) -> Result<(), IoError> {
        self.element.count += 1;
        let writer = Writer::<Vertex>::new();
        let written = writer.write_little_endian_element(&mut self.file, &Vertex(*point), &self.element);
        self.check(written.map(drop))
    }

    /// Adds a point that the views of these numbers see, the first 255 of them, to a file with views.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn push_seen(&mut self, point: &CloudPoint, views: &[u32]) -> Result<(), IoError> {
        self.element.count += 1;
        let views = &views[..views.len().min(WEIGHTS.len())];
        let seen = SeenVertex { vertex: Vertex(*point), views, weights: &WEIGHTS[..views.len()] };
        let writer = Writer::<SeenVertex>::new();
        let written = writer.write_little_endian_element(&mut self.file, &seen, &self.element);
        self.check(written.map(drop))
    }

    /// Number of points so far.
    #[must_use]
    pub fn count(&self) -> usize {
        self.element.count
    }

    /// Completes the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<(), IoError> {
        let written = self.file.seek(SeekFrom::Start(0)).and_then(|_| self.write_header());
        self.check(written)?;
        self.file.commit()
    }

    fn write_header(&mut self) -> io::Result<()> {
        Writer::<Vertex>::new().write_header(&mut self.file, &header(&self.element)).map(drop)
    }

    fn check(&self, written: io::Result<()>) -> Result<(), IoError> {
        written.map_err(IoError::system("write", self.file.path()))
    }
}

/// A header whose length does not depend on the number of points: a comment makes up for it.
fn header(element: &ElementDef) -> Header {
    let mut header = Header::new();
    header.encoding = Encoding::BinaryLittleEndian;
    header.comments.push(format!("vamvs {}", ".".repeat(COUNT_DIGITS - element.count.to_string().len())));
    header.elements.add(element.clone());
    header
}

fn element(coordinates: Coordinates) -> ElementDef {
    let mut element = ElementDef::new(vertex::NAME.to_owned());
    let mut add = |names: &[&str], kind: ScalarType| {
        for &name in names {
            element.properties.add(PropertyDef::new(name.to_owned(), PropertyType::Scalar(kind.clone())));
        }
    };
    add(&["x", "y", "z"], coordinates.kind());
    add(&["nx", "ny", "nz"], ScalarType::Float);
    add(&["red", "green", "blue"], ScalarType::UChar);
    add(&["confidence"], ScalarType::Float);
    add(&["views"], ScalarType::UChar);
    element
}
