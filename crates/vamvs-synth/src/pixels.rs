//! Rasters filled by many threads.

use rayon::prelude::*;
use vamvs_core::{Grid, Size};

/// Fills each pixel with `value(x, y)`, rows in parallel.
pub(crate) fn fill<T: Send>(size: Size, value: impl Fn(usize, usize) -> T + Sync) -> Grid<T> {
    let row = |y| (0..size.width).map(|x| value(x, y)).collect::<Vec<T>>();
    let rows: Vec<Vec<T>> = (0..size.height).into_par_iter().map(row).collect();
    Grid::from_vec(size, rows.into_iter().flatten().collect())
}
