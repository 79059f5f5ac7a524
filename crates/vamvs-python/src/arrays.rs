//! NumPy arrays from and to grids.

use nalgebra::{Matrix3, Vector3};
use numpy::ndarray::{Array, IntoDimension};
use numpy::{Element, IntoPyArray, PyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use vamvs::core::{Grid, Intrinsics, Pose, Size};

/// A grid as an array (H, W).
pub fn from_grid<'py, T: Element + Copy>(
    py: Python<'py>,
    grid: &Grid<T>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let shape = (grid.height(), grid.width());
    array(py, shape, grid.data())
}

/// A grid of triples as an array (H, W, 3).
pub fn from_triples<'py, T: Element + Copy>(
    py: Python<'py>,
    grid: &Grid<[T; 3]>,
) -> PyResult<Bound<'py, PyArray3<T>>> {
    let shape = (grid.height(), grid.width(), 3);
    array(py, shape, grid.data().as_flattened())
}

/// Rows of numbers as an array.
pub fn from_rows<'py, T: Element + Copy, const N: usize>(
    py: Python<'py>,
    rows: &[[T; N]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    array(py, (rows.len(), N), rows.as_flattened())
}

/// An array of this shape, its last index the fastest.
fn array<'py, T: Element + Copy, S: IntoDimension>(
    py: Python<'py>,
    shape: S,
    values: &[T],
) -> PyResult<Bound<'py, PyArray<T, S::Dim>>> {
    let array = Array::from_shape_vec(shape.into_dimension(), values.to_vec());
    Ok(array.map_err(|error| PyValueError::new_err(error.to_string()))?.into_pyarray(py))
}

/// An array (H, W) as a grid.
pub fn to_grid<T: Element + Copy>(array: &PyReadonlyArray2<'_, T>) -> Grid<T> {
    let view = array.as_array();
    let (height, width) = view.dim();
    Grid::from_vec(Size::new(width, height), view.iter().copied().collect())
}

/// An array (H, W, 3) as a grid of triples.
pub fn to_triples<T: Element + Copy>(what: &str, array: &PyReadonlyArray3<'_, T>) -> PyResult<Grid<[T; 3]>> {
    let view = array.as_array();
    let (height, width, channels) = view.dim();
    if channels != 3 {
        return Err(PyValueError::new_err(format!(
            "{what}: expected an array of shape (height, width, 3), found {:?}",
            view.dim()
        )));
    }
    Ok(Grid::from_fn(Size::new(width, height), |x, y| [view[(y, x, 0)], view[(y, x, 1)], view[(y, x, 2)]]))
}

/// A matrix K as intrinsics.
pub fn to_intrinsics(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Intrinsics> {
    let k = array.as_array();
    let wrong = || {
        let expected = "K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0";
        PyValueError::new_err(format!("{expected}, found {k}"))
    };
    if k.dim() != (3, 3) {
        return Err(wrong());
    }
    Intrinsics::try_from_matrix(&Matrix3::from_fn(|row, column| k[(row, column)])).map_err(|_| wrong())
}

/// The matrix K.
pub fn from_intrinsics<'py>(py: Python<'py>, camera: &Intrinsics) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let Intrinsics { fx, fy, cx, cy } = *camera;
    from_rows(py, &[[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
}

/// [R | t], of three or four rows, as a pose.
pub fn to_pose(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Pose> {
    let p = array.as_array();
    if p.dim() != (3, 4) && p.dim() != (4, 4) {
        return Err(PyValueError::new_err(format!(
            "cam_from_world: expected [R | t] of shape (3, 4) or (4, 4), found {:?}",
            p.dim()
        )));
    }
    let rotation = Matrix3::from_fn(|row, column| p[(row, column)]);
    let translation = Vector3::new(p[(0, 3)], p[(1, 3)], p[(2, 3)]);
    Pose::try_new(rotation, translation)
        .map_err(|error| PyValueError::new_err(format!("cam_from_world: {error}")))
}

/// [R | t] of three rows.
pub fn from_pose<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (r, t) = (&pose.rotation, &pose.translation);
    from_rows(py, &[0, 1, 2].map(|row| [r[(row, 0)], r[(row, 1)], r[(row, 2)], t[row]]))
}
