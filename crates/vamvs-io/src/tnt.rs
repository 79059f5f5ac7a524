//! The files that Tanks and Temples evaluates a scene with: its crop volume (`SCENE.json`, in Open3D's format)
//! and an alignment of the cloud with the ground truth.

use std::fs;
use std::path::Path;

use nalgebra::Matrix4;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use vamvs_core::Similarity;

use crate::text::WordReader;
use crate::{IoError, Place};

/// A crop volume: a prism along an axis of the ground truth's frame, in its units.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// The prism's axis: 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// Where the prism begins and ends along its axis.
    pub span: [f64; 2],
    /// The polygon that is the prism's cross-section, in the other two axes, in the order x, y, z.
    pub outline: Vec<[f64; 2]>,
}

/// The JSON of Open3D's `SelectionPolygonVolume`.
#[derive(Deserialize)]
struct VolumeFile {
    class_name: String,
    orthogonal_axis: String,
    axis_min: f64,
    axis_max: f64,
    bounding_polygon: Vec<[f64; 3]>,
}

/// The JSON of a 4×4 transform, column by column.
#[derive(Deserialize)]
struct AlignmentFile {
    transformation: [f64; 16],
}

/// Reads a crop volume.
///
/// # Errors
/// If the file cannot be read or does not hold a `SelectionPolygonVolume`.
pub fn read_volume(path: &Path) -> Result<Volume, IoError> {
    let file: VolumeFile = read_json(path)?;
    let malformed = |problem: String| IoError::malformed(path, Place::Whole, problem);
    if file.class_name != "SelectionPolygonVolume" {
        let problem = format!("class_name: expected \"SelectionPolygonVolume\", found {:?}", file.class_name);
        return Err(malformed(problem));
    }
    let axis = match file.orthogonal_axis.as_str() {
        "X" | "x" => 0,
        "Y" | "y" => 1,
        "Z" | "z" => 2,
        other => return Err(malformed(format!("orthogonal_axis: expected X, Y or Z, found {other:?}"))),
    };
    if file.bounding_polygon.len() < 3 {
        let found = file.bounding_polygon.len();
        return Err(malformed(format!("bounding_polygon: expected at least 3 points, found {found}")));
    }
    let others: Vec<usize> = (0..3).filter(|&other| other != axis).collect();
    let outline = file.bounding_polygon.iter().map(|point| [point[others[0]], point[others[1]]]).collect();
    Ok(Volume { axis, span: [file.axis_min, file.axis_max], outline })
}

/// Reads an alignment `ground_truth_from_cloud`: a text file with 4×4 numbers row by row (`SCENE_trans.txt`), or a
/// `.json` file with 16 numbers column by column in `transformation`.
///
/// # Errors
/// If the file cannot be read or the numbers are not a similarity transform.
pub fn read_alignment(path: &Path) -> Result<Similarity, IoError> {
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let matrix = match is_json {
        true => Matrix4::from_column_slice(&read_json::<AlignmentFile>(path)?.transformation),
        false => Matrix4::from_row_slice(&sixteen(path)?),
    };
    if matrix.row(3) != Matrix4::identity().row(3) {
        let problem = format!("expected 0 0 0 1 as the last row of the transform, found{}", matrix.row(3));
        return Err(IoError::malformed(path, Place::Whole, problem));
    }
    Similarity::try_from_matrix(&matrix).map_err(|error| IoError::malformed(path, Place::Whole, error))
}

fn sixteen(path: &Path) -> Result<[f64; 16], IoError> {
    let mut words = WordReader::open(path)?;
    let numbers = words.numbers("transform")?;
    match words.next_word()?.map(str::to_owned) {
        None => Ok(numbers),
        Some(word) => Err(words.malformed(format!("expected the end after 16 numbers, found {word:?}"))),
    }
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, IoError> {
    let text = fs::read_to_string(path).map_err(IoError::system("read", path))?;
    serde_json::from_str(&text).map_err(|error| IoError::malformed(path, Place::Line(error.line()), error))
}
