//! Cabinets, shelves, seats and tables, all made of boxes, and pictures on the walls.

use nalgebra::Vector3;
use rand::RngExt;

use super::{HEIGHT, LENGTH};
use crate::Material;
use crate::assets::{AssetError, Look};
use crate::layout::set::Set;

/// One of the two walls that meet in the corner.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Wall {
    AlongX,
    AlongY,
}

impl Wall {
    /// The world point at distance `along` the wall from the corner, at distance `out` from the wall, at height `z`.
    fn point(self, along: f64, out: f64, z: f64) -> Vector3<f64> {
        match self {
            Self::AlongX => Vector3::new(along, out, z),
            Self::AlongY => Vector3::new(out, along, z),
        }
    }

    fn size(self, along: f64, out: f64, z: f64) -> [f64; 3] {
        self.point(along, out, z).into()
    }

    /// Places a box; `along`, `out` and `z` are its ranges in the coordinates of [`Self::point`].
    fn block(self, set: &mut Set, [along, out, z]: [[f64; 2]; 3], material: &Material) {
        let (middle, side) = (|[a, b]: [f64; 2]| 0.5 * (a + b), |[a, b]: [f64; 2]| b - a);
        let size = self.size(side(along), side(out), side(z));
        set.block(size, &self.point(middle(along), middle(out), middle(z)), 0.0, material);
    }
}

/// Places furniture along a wall; returns the middle (x, y) of each piece, for things to be dropped on.
pub(super) fn stand_along(set: &mut Set, wall: Wall) -> Result<Vec<[f64; 2]>, AssetError> {
    let mut tops = Vec::new();
    // Only the first wall's furniture may reach into the corner.
    let mut along = if wall == Wall::AlongX { 0.05 } else { 0.75 };
    along += set.rng.random_range(0.0..0.4);
    while along < 0.6 * LENGTH {
        let width = set.rng.random_range(0.5..1.3);
        let depth = set.rng.random_range(0.3..0.6);
        let kind = set.rng.random_range(0..4);
        match kind {
            0 => cabinet(set, wall, [along, along + width], depth)?,
            1 => shelf(set, wall, [along, along + width], depth)?,
            2 => seat(set, wall, [along, along + width], depth)?,
            _ => {}
        }
        if kind < 3 {
            let top = wall.point(along + 0.5 * width, 0.03 + 0.5 * depth, 0.0);
            tops.push([top.x, top.y]);
        }
        along += width + set.rng.random_range(0.02..0.4);
    }
    Ok(tops)
}

/// A box with doors and knobs.
fn cabinet(set: &mut Set, wall: Wall, along: [f64; 2], depth: f64) -> Result<(), AssetError> {
    let body = set.material(Look::Any, 0.7)?;
    let door = if set.rng.random_bool(0.5) { body.clone() } else { set.material(Look::Any, 0.5)? };
    let height = set.rng.random_range(0.5..1.1);
    let front = 0.03 + depth;
    wall.block(set, [along, [0.03, front], [0.0, height]], &body);
    let doors = set.rng.random_range(1..=3);
    let width = (along[1] - along[0]) / f64::from(doors);
    for index in 0..doors {
        let start = along[0] + f64::from(index) * width;
        let z = [0.08, height - 0.04];
        wall.block(set, [[start + 0.015, start + width - 0.015], [front, front + 0.02], z], &door);
        let knob = [start + width - 0.07, start + width - 0.04];
        wall.block(set, [knob, [front + 0.02, front + 0.05], [0.6 * height, 0.6 * height + 0.03]], &body);
    }
    Ok(())
}

/// A shelf with books on most of its boards.
fn shelf(set: &mut Set, wall: Wall, along: [f64; 2], depth: f64) -> Result<(), AssetError> {
    let wood = set.material(Look::Any, 0.6)?;
    let covers =
        [set.material(Look::Any, 0.2)?, set.material(Look::Rich, 0.2)?, set.material(Look::Rich, 0.2)?];
    let boards = set.rng.random_range(2..=5);
    let gap = set.rng.random_range(0.28..0.4);
    let height = f64::from(boards) * gap;
    let out = [0.03, 0.03 + depth];
    for side in [[along[0], along[0] + 0.025], [along[1] - 0.025, along[1]]] {
        wall.block(set, [side, out, [0.0, height]], &wood);
    }
    wall.block(set, [along, [0.025, 0.03], [0.0, height]], &wood);
    for board in 0..=boards {
        let z = f64::from(board) * gap;
        wall.block(set, [along, out, [z, z + 0.025]], &wood);
        if board < boards && set.rng.random_bool(0.8) {
            books(set, wall, [along[0] + 0.03, along[1] - 0.03], z + 0.025, &covers);
        }
    }
    Ok(())
}

/// Books side by side on a board at height `z`.
fn books(set: &mut Set, wall: Wall, along: [f64; 2], z: f64, covers: &[Material]) {
    let end = along[0] + (along[1] - along[0]) * set.rng.random_range(0.3..1.0);
    let mut start = along[0];
    loop {
        let (thick, height) = (set.rng.random_range(0.015..0.06), set.rng.random_range(0.15..0.24));
        let depth = set.rng.random_range(0.12..0.2);
        if start + thick > end {
            return;
        }
        let cover = &covers[set.rng.random_range(0..covers.len())];
        wall.block(set, [[start, start + thick], [0.05, 0.05 + depth], [z, z + height]], cover);
        start += thick + 0.001;
    }
}

/// A bench with a back and two cushions.
fn seat(set: &mut Set, wall: Wall, along: [f64; 2], depth: f64) -> Result<(), AssetError> {
    let (cloth, cushion) = (set.material(Look::Any, 0.5)?, set.material(Look::Any, 0.5)?);
    let height = set.rng.random_range(0.35..0.5);
    wall.block(set, [along, [0.03, 0.03 + depth], [0.0, height]], &cloth);
    wall.block(set, [along, [0.03, 0.13], [height, height + 0.4]], &cloth);
    let middle = 0.5 * (along[0] + along[1]);
    for half in [[along[0] + 0.01, middle - 0.01], [middle + 0.01, along[1] - 0.01]] {
        wall.block(set, [half, [0.13, 0.02 + depth], [height, height + 0.08]], &cushion);
    }
    Ok(())
}

/// Places a table with four legs in front of the corner; returns its middle (x, y).
pub(super) fn add_table(set: &mut Set) -> Result<[f64; 2], AssetError> {
    let wood = set.material(Look::Any, 0.7)?;
    let size = [set.rng.random_range(0.5..1.0), set.rng.random_range(0.4..0.8)];
    let height = set.rng.random_range(0.35..0.7);
    let centre = [0, 1].map(|_| set.rng.random_range(1.1..1.7));
    let top = Vector3::new(centre[0], centre[1], height - 0.015);
    set.block([size[0], size[1], 0.03], &top, 0.0, &wood);
    for corner in 0..4 {
        let side = |axis: usize| if corner >> axis & 1 == 0 { -0.5 } else { 0.5 };
        let [x, y] = [0, 1].map(|axis| centre[axis] + side(axis) * (size[axis] - 0.08));
        set.block([0.05, 0.05, height - 0.03], &Vector3::new(x, y, 0.5 * (height - 0.03)), 0.0, &wood);
    }
    Ok(centre)
}

/// Hangs up to three framed pictures on a wall, at least 1.3 m above the floor.
pub(super) fn hang_pictures(set: &mut Set, wall: Wall) -> Result<(), AssetError> {
    let frame = set.material(Look::Any, 0.4)?;
    let mut along = 0.2 + set.rng.random_range(0.0..0.5);
    for _ in 0..set.rng.random_range(0..4) {
        let (width, height) = (set.rng.random_range(0.25..0.8), set.rng.random_range(0.25..0.7));
        let low = set.rng.random_range(1.3..HEIGHT - 0.2 - height);
        let (x, z) = ([along, along + width], [low, low + height]);
        wall.block(set, [x, [0.0, 0.02], z], &frame);
        let picture = set.material(Look::Rich, width)?;
        let inner = |[a, b]: [f64; 2]| [a + 0.03, b - 0.03];
        wall.block(set, [inner(x), [0.02, 0.023], inner(z)], &picture);
        along += width + set.rng.random_range(0.1..0.5);
    }
    Ok(())
}
