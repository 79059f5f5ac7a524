//! The files by which DTU's benchmark selects the points of a scan that it evaluates: the observability mask
//! `ObsMask{scan}_10.mat` and the ground plane `Plane{scan}.mat`.

use std::path::Path;

use crate::mat::{self, Array};
use crate::{IoError, Place};

/// An observability mask: the voxels of a bounding box that the reference scan could see.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// The bounding box's lower corner in the world, scene units: the centre of voxel (0, 0, 0).
    pub low: [f64; 3],
    /// The bounding box's upper corner in the world, scene units.
    pub high: [f64; 3],
    /// Side of a voxel in scene units.
    pub side: f64,
    /// Number of voxels along x, y, z.
    pub size: [usize; 3],
    /// Whether voxel (i, j, k) is in the mask, at index `i + size[0] · (j + size[1] · k)` (MATLAB's order).
    pub inside: Vec<bool>,
}

/// Reads an observability mask: `ObsMask`, the bounding box `BB` (2×3) and the side of a voxel `Res`.
///
/// # Errors
/// If the file cannot be read, an array is missing or has another shape, the box is empty, or the side is not
/// positive.
pub fn read_mask(path: &Path) -> Result<Mask, IoError> {
    let [mask, corners, side] = mat::read(path, ["ObsMask", "BB", "Res"])?;
    let corners = of_shape(path, "BB", &corners, &[2, 3])?;
    let side = of_shape(path, "Res", &side, &[1, 1])?[0];
    let &[x, y, z] = mask.shape.as_slice() else {
        let problem = format!("ObsMask: expected three dimensions, found {:?}", mask.shape);
        return Err(IoError::malformed(path, Place::Whole, problem));
    };
    let [low, high] = [0, 1].map(|row| [corners[row], corners[row + 2], corners[row + 4]]);
    let makes_sense = side > 0.0 && side.is_finite() && (0..3).all(|axis| low[axis] < high[axis]);
    if !makes_sense {
        let problem = format!(
            "expected BB's first row below its second and Res above 0, found {low:?}, {high:?} and {side}"
        );
        return Err(IoError::malformed(path, Place::Whole, problem));
    }
    let inside = mask.values.iter().map(|&value| value != 0.0).collect();
    Ok(Mask { low, high, side, size: [x, y, z], inside })
}

/// Reads a ground plane: `P`, four numbers. P · (x, y, z, 1) is positive for points above the ground.
///
/// # Errors
/// If the file cannot be read, or `P` is missing or has another shape.
pub fn read_plane(path: &Path) -> Result<[f64; 4], IoError> {
    let [plane] = mat::read(path, ["P"])?;
    let values = of_shape(path, "P", &plane, &[4, 1])?;
    Ok([values[0], values[1], values[2], values[3]])
}

fn of_shape<'a>(path: &Path, name: &str, array: &'a Array, shape: &[usize]) -> Result<&'a [f64], IoError> {
    if array.shape == shape {
        return Ok(&array.values);
    }
    let problem = format!("{name}: expected {shape:?} numbers, found {:?}", array.shape);
    Err(IoError::malformed(path, Place::Whole, problem))
}
