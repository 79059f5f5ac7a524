//! A streaming writer of clouds: the number of points need not be known before the end.

use std::io::{self, Seek, SeekFrom};
use std::path::Path;

use ply_rs_bw::ply::{Addable, ElementDef, Encoding, Header, PropertyDef, PropertyType, ScalarType};
use ply_rs_bw::writer::Writer;
use vamvs_core::CloudPoint;

use super::vertex::{self, SeenVertex, VIEW_INDICES, VIEW_WEIGHTS, Vertex};
use crate::IoError;
use crate::atomic::AtomicFile;

/// Ratio of the largest absolute coordinate to the cloud's extent above which floats are too coarse. A float
/// has 24 significant bits, so at this ratio the extent is still resolved into about 170 000 steps.
const FAR_FROM_ORIGIN: f64 = 1e2;

/// The weights of a point's views: all 1, and as many as the `uchar` length of a list allows.
const WEIGHTS: [f32; 255] = [1.0; 255];

/// Number of digits that the header reserves for the number of points.
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
        Self::at_distance(largest, extent)
    }

    /// `Double` if the distance from the origin is more than 100 times the extent.
    #[must_use]
    pub fn at_distance(largest: f64, extent: f64) -> Self {
        if largest.is_finite() && largest > FAR_FROM_ORIGIN * extent { Self::Double } else { Self::Float }
    }

    fn kind(self) -> ScalarType {
        match self {
            Self::Float => ScalarType::Float,
            Self::Double => ScalarType::Double,
        }
    }
}

/// Writes a cloud, with coordinates of the type that [`Coordinates::for_points`] chooses.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write(path: &Path, cloud: &[CloudPoint]) -> Result<(), IoError> {
    let mut writer = PlyWriter::create(path, Coordinates::for_points(cloud))?;
    cloud.iter().try_for_each(|point| writer.push(point))?;
    writer.finish()
}

/// Writes a cloud point by point; the file appears only with [`PlyWriter::finish`].
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

    /// Begins a file that also holds, for each point, the views that see it, as the lists `view_indices` and
    /// `view_weights` of OpenMVS. Its points are added with [`PlyWriter::push_seen`].
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

    /// Adds a point, to a file begun with [`PlyWriter::create`].
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn push(&mut self, point: &CloudPoint) -> Result<(), IoError> {
        self.element.count += 1;
        let writer = Writer::<Vertex>::new();
        let written = writer.write_little_endian_element(&mut self.file, &Vertex(*point), &self.element);
        self.check(written.map(drop))
    }

    /// Adds a point and the numbers of the views that see it, to a file begun with
    /// [`PlyWriter::create_with_views`]. Only the first 255 views are written.
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

    /// Number of points added so far.
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

/// The header. A comment of dots pads it to a length that does not depend on the number of points, so that it can
/// be overwritten at the end.
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
    add(&["confidence", "sigma"], ScalarType::Float);
    add(&["views"], ScalarType::UChar);
    element
}
