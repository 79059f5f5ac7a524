//! Points sorted into cubic cells. The points of a row of cells along x are contiguous in memory.

use rayon::prelude::*;

/// A point with its cell. Entries are ordered by cell, then point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Entry {
    /// The cell's numbers along z, y and x, so that cells along x follow each other.
    pub(crate) cell: [i32; 3],
    /// The point's index.
    pub(crate) point: u32,
}

/// The cells are too small for the cloud: there would be too many of them.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "cells of {side} are too small for a cloud that is {extent} long: crop it, or remove distant outliers"
)]
pub struct TooFine {
    /// The side of a cell, scene units.
    pub side: f64,
    /// The cloud's longest side, scene units.
    pub extent: f64,
}

/// Sorts points into cells of `side`; within a cell, points are ordered by index. The first cell begins
/// `margin` before the cloud's lower corner along each axis. Points must be finite.
pub(crate) fn sorted(points: &[[f64; 3]], side: f64, margin: f64) -> Result<Vec<Entry>, TooFine> {
    let (low, high) = bounds(points);
    let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    // Callers also address the next cell on either side.
    if (extent + margin) / side >= f64::from(i32::MAX - 2) {
        return Err(TooFine { side, extent });
    }
    let number = |x: &[f64; 3], axis: usize| ((x[axis] - low[axis] + margin) / side).floor() as i32;
    let entry = |(point, x): (usize, &[f64; 3])| Entry {
        cell: [2, 1, 0].map(|axis| number(x, axis)),
        point: index(point),
    };
    let mut entries: Vec<Entry> = points.par_iter().enumerate().map(entry).collect();
    entries.par_sort_unstable();
    Ok(entries)
}

/// A point's index as 32 bits.
pub(crate) fn index(point: usize) -> u32 {
    u32::try_from(point).expect("a cloud has fewer than 2³² points")
}

/// The lower and the upper corner of the points' bounding box; (∞, −∞) if there are no points.
pub(crate) fn bounds(points: &[[f64; 3]]) -> ([f64; 3], [f64; 3]) {
    let none = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    points.iter().fold(none, |(low, high), x| {
        ([0, 1, 2].map(|i| low[i].min(x[i])), [0, 1, 2].map(|i| high[i].max(x[i])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_along_x_follow_each_other() {
        let points = [[2.5, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.9, 0.0]];
        let order: Vec<_> = sorted(&points, 1.0, 0.0).unwrap().iter().map(|e| (e.cell, e.point)).collect();
        let expected = [([0, 0, 0], 4), ([0, 0, 1], 3), ([0, 0, 2], 0), ([0, 1, 0], 2), ([1, 0, 0], 1)];
        assert_eq!(order, expected);
    }

    #[test]
    fn cells_that_cannot_be_numbered_are_refused() {
        let error = sorted(&[[0.0; 3], [1e10, 0.0, 0.0]], 0.1, 0.0).unwrap_err();
        assert_eq!(error, TooFine { side: 0.1, extent: 1e10 });
        assert!(sorted(&[], 0.1, 0.0).unwrap().is_empty());
    }
}
