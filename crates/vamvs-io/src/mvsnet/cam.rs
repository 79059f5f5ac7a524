//! A camera file: `extrinsic` with a 4×4 matrix, camera from world; `intrinsic` with the 3×3 matrix K; and an
//! optional depth line in scene units.
//!
//! Writers disagree about the depth line, so the number of its words decides how it is read:
//!
//! | words | line | depth range |
//! |---|---|---|
//! | 0 | | none |
//! | 2 | `min interval` | min to min + interval · 191 ([`DEFAULT_PLANES`] planes) |
//! | 2 | `min max`, if the second number is larger than the first | min to max, with a warning |
//! | 3 | `min interval num` | min to min + interval · (num − 1) |
//! | 4 | `min interval num max` | min to max |

use std::path::Path;

use nalgebra::{Matrix3, Matrix4, Vector3};
use serde::{Deserialize, Serialize};
use vamvs_core::{DepthRange, Intrinsics, Pinhole, Pose};

use crate::text::WordReader;
use crate::{IoError, atomic};

/// Number of sweep planes if the depth line gives only `min interval`, as in MVSNet's own code.
pub const DEFAULT_PLANES: f64 = 192.0;

/// How camera files are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// How the depth line is read.
    pub depth_line: DepthLine,
    /// The convention of pixel centres, which the principal point depends on.
    pub pixel_centre: PixelCentre,
}

/// The meaning of the first two numbers of a depth line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum DepthLine {
    /// Decided by the number of words.
    #[default]
    Auto,
    /// `min interval …`: the range ends at min + interval · (num − 1); a fourth number is ignored.
    MinInterval,
    /// `min max …`: further numbers are ignored.
    MinMax,
}

/// The image coordinates of the first pixel's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum PixelCentre {
    /// (0.5, 0.5), as in COLMAP and MVSNet: the principal point is read unchanged.
    #[default]
    Half,
    /// (0, 0), as in OpenCV: half a pixel is added to the principal point.
    Integer,
}

/// The content of a camera file.
#[derive(Clone, Debug, PartialEq)]
pub struct Cam {
    /// Focal lengths and principal point in pixels, for pixel centres at (0.5, 0.5).
    pub intrinsics: Intrinsics,
    /// The pose.
    pub cam_from_world: Pose,
    /// The depth range in scene units, if there is a depth line with one.
    pub depth_range: Option<DepthRange>,
    /// A warning that says how an ambiguous depth line was read, or that it gives no range.
    pub warning: Option<String>,
}

/// Reads a camera file.
///
/// # Errors
/// If the file cannot be read or is malformed, or the pose or the intrinsics are invalid.
pub fn read_cam(path: &Path, options: &Options) -> Result<Cam, IoError> {
    let mut words = WordReader::open(path)?;
    let cam_from_world = read_pose(&mut words)?;
    let intrinsics = read_intrinsics(&mut words, options.pixel_centre)?;
    let numbers = read_depth_line(&mut words)?;
    let (end, warning) =
        range_end(&numbers, options.depth_line).map_err(|problem| words.malformed(problem))?;
    let range = end.map(|far| DepthRange::try_new(numbers[0], far));
    let no_range = range.as_ref().and_then(|range| range.as_ref().err()).map(|error| {
        format!(
            "the depth line is not used: {error}; if its first two numbers mean something else, choose how depth lines are read (--depth-line)"
        )
    });
    let depth_range = range.and_then(Result::ok);
    Ok(Cam { intrinsics, cam_from_world, depth_range, warning: no_range.or(warning) })
}

/// Writes a camera file. If there is a depth range, its depth line is `min interval num max` for
/// [`DEFAULT_PLANES`] planes.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write_cam(
    path: &Path,
    camera: &Pinhole,
    cam_from_world: &Pose,
    depth_range: Option<DepthRange>,
) -> Result<(), IoError> {
    let (r, t) = (&cam_from_world.rotation, &cam_from_world.translation);
    let k = camera.intrinsics.matrix();
    atomic::write(path, |out| {
        writeln!(out, "extrinsic")?;
        for i in 0..3 {
            writeln!(out, "{} {} {} {}", r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i])?;
        }
        writeln!(out, "0 0 0 1\n\nintrinsic")?;
        for i in 0..3 {
            writeln!(out, "{} {} {}", k[(i, 0)], k[(i, 1)], k[(i, 2)])?;
        }
        let Some(DepthRange { near, far }) = depth_range else { return Ok(()) };
        let interval = (far - near) / (DEFAULT_PLANES - 1.0);
        writeln!(out, "\n{near} {interval} {DEFAULT_PLANES} {far}")
    })
}

fn read_pose(words: &mut WordReader) -> Result<Pose, IoError> {
    words.keyword("extrinsic")?;
    let matrix = Matrix4::from_row_slice(&words.numbers::<16>("extrinsic")?);
    let last = matrix.row(3);
    if last != Matrix4::<f64>::identity().row(3) {
        let problem = format!(
            "extrinsic: expected 0 0 0 1 as the last row, found {} {} {} {}",
            last[0], last[1], last[2], last[3]
        );
        return Err(words.malformed(problem));
    }
    let rotation: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into();
    let translation: Vector3<f64> = matrix.fixed_view::<3, 1>(0, 3).into();
    Pose::try_new(rotation, translation).map_err(|error| words.malformed(format!("extrinsic: {error}")))
}

fn read_intrinsics(words: &mut WordReader, centre: PixelCentre) -> Result<Intrinsics, IoError> {
    words.keyword("intrinsic")?;
    let matrix = Matrix3::from_row_slice(&words.numbers::<9>("intrinsic")?);
    let k = Intrinsics::try_from_matrix(&matrix)
        .map_err(|error| words.malformed(format!("intrinsic: {error}")))?;
    Ok(match centre {
        PixelCentre::Half => k,
        PixelCentre::Integer => k.cropped(-0.5, -0.5),
    })
}

/// The numbers up to the end of the file, four at most.
fn read_depth_line(words: &mut WordReader) -> Result<Vec<f64>, IoError> {
    let mut numbers = Vec::new();
    while let Some(number) = words.optional_number("depth line")? {
        if numbers.len() == 4 {
            return Err(words.malformed("depth line: expected at most 4 numbers, found more"));
        }
        numbers.push(number);
    }
    Ok(numbers)
}

/// The far end of a depth line's range, and a warning if it had to be guessed.
fn range_end(numbers: &[f64], line: DepthLine) -> Result<(Option<f64>, Option<String>), String> {
    let by_interval = |min: f64, interval: f64, planes: f64| min + interval * (planes - 1.0);
    let end = match (line, numbers) {
        (_, []) => return Ok((None, None)),
        (_, [_]) => return Err("depth line: expected 0, 2, 3 or 4 numbers, found 1".to_owned()),
        (DepthLine::MinMax, [_, max, ..]) | (DepthLine::Auto, [_, _, _, max, ..]) => *max,
        (DepthLine::Auto, [min, second]) if second > min => {
            let warning = format!("the depth line `{min} {second}` was read as `min max`");
            return Ok((Some(*second), Some(warning)));
        }
        (_, [min, interval]) => by_interval(*min, *interval, DEFAULT_PLANES),
        (_, [min, interval, planes, ..]) => by_interval(*min, *interval, *planes),
    };
    Ok((Some(end), None))
}
