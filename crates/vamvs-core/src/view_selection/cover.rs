//! What the points that a view saw count for: they stand for the part of the image around them, however many there are in it.

use nalgebra::{Vector2, Vector3};

use crate::{Pinhole, lift::lift};

/// Columns and rows of the cells of an image in which points count together.
const CELLS: usize = 8;

/// What a cell without points counts for, as a share of one with points.
const FILL: f64 = 0.1;

/// Points that a view saw, and the parts of its image in which it saw none.
pub(super) struct Cover {
    /// The weight of each point, 1 in the mean.
    pub weights: Vec<f64>,
    /// Points, in the camera's frame, in place of those that parts of the image lack, as far away as in the nearest part that has some.
    pub fills: Vec<Vector3<f64>>,
    /// The weight of each of these.
    pub fill: f64,
}

/// The points in a cell of the image.
#[derive(Clone, Copy, Default)]
struct Cell {
    count: f64,
    inverse_depths: f64,
}

impl Cover {
    /// Of the points that a camera saw, in its frame.
    pub(super) fn new(in_cam: &[Vector3<f64>], camera: &Pinhole) -> Self {
        let mut cells = [Cell::default(); CELLS * CELLS];
        let cell_of = |x_in_cam: &Vector3<f64>| cell_at(&camera.intrinsics.project(x_in_cam), camera);
        let cell_of: Vec<usize> = in_cam.iter().map(cell_of).collect();
        for (&cell, x_in_cam) in cell_of.iter().zip(in_cam) {
            cells[cell].count += 1.0;
            cells[cell].inverse_depths += 1.0 / x_in_cam.z;
        }
        let (occupied, empty): (Vec<usize>, Vec<usize>) =
            (0..cells.len()).partition(|&cell| cells[cell].count > 0.0);
        let mean = in_cam.len() as f64 / occupied.len().max(1) as f64;
        let fill = |cell: usize| {
            let Cell { count, inverse_depths } =
                cells[*occupied.iter().min_by_key(|&&other| apart(cell, other))?];
            Some(lift(camera, &centre(cell, camera), count / inverse_depths))
        };
        Self {
            weights: cell_of.into_iter().map(|cell| mean / cells[cell].count).collect(),
            fills: empty.into_iter().filter_map(fill).collect(),
            fill: FILL * mean,
        }
    }
}

/// The cell of a pixel, or the nearest one.
fn cell_at(pixel: &Vector2<f64>, camera: &Pinhole) -> usize {
    let at = |position: f64, side: usize| ((CELLS as f64 * position / side as f64) as usize).min(CELLS - 1);
    CELLS * at(pixel.y, camera.size.height) + at(pixel.x, camera.size.width)
}

/// The pixel in the middle of a cell.
fn centre(cell: usize, camera: &Pinhole) -> Vector2<f64> {
    let at = |index: usize, side: usize| (index as f64 + 0.5) / CELLS as f64 * side as f64;
    Vector2::new(at(cell % CELLS, camera.size.width), at(cell / CELLS, camera.size.height))
}

/// The squared distance of two cells.
fn apart(a: usize, b: usize) -> usize {
    let (across, down) = ((a % CELLS).abs_diff(b % CELLS), (a / CELLS).abs_diff(b / CELLS));
    across * across + down * down
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Intrinsics, Size};

    /// Three points in one cell and one in another: each cell counts for two, and the other 62 are filled.
    #[test]
    fn cells_count_alike_and_empty_ones_are_as_far_as_the_nearest_with_points() {
        let camera = Pinhole {
            size: Size::new(80, 80),
            intrinsics: Intrinsics { fx: 40.0, fy: 40.0, cx: 40.0, cy: 40.0 },
        };
        let at = |x: f64, y: f64, depth| lift(&camera, &Vector2::new(x, y), depth);
        let points = vec![at(5.0, 5.0, 2.0), at(6.0, 5.0, 2.0), at(5.0, 6.0, 2.0), at(75.0, 75.0, 10.0)];
        let Cover { weights, fills, fill } = Cover::new(&points, &camera);
        assert_eq!(weights, [2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 2.0]);
        assert_eq!((fills.len(), fill), (62, 2.0 * FILL));
        let depth_at = |x: f64, y: f64| {
            let is_there =
                |fill: &&Vector3<f64>| (camera.intrinsics.project(fill) - Vector2::new(x, y)).norm() < 1e-9;
            fills.iter().find(is_there).unwrap().z
        };
        assert!((depth_at(15.0, 5.0) - 2.0).abs() < 1e-12 && (depth_at(75.0, 65.0) - 10.0).abs() < 1e-12);
    }
}
