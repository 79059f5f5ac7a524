//! The signed distance from the surface at the corners of cells: the mean of what all views say.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::bricks::{BRICK, Brick, Bricks, Place};
use crate::view::SeenView;

/// Corners along an edge of a brick.
const CORNERS: usize = BRICK as usize + 1;

/// Corners of a brick's cells.
const VALUES: usize = CORNERS * CORNERS * CORNERS;

/// The value of places that no view sees.
const UNKNOWN: i16 = i16::MIN;

/// The value of a distance of one cell.
const PER_CELL: f32 = 4096.0;

/// The values of a brick.
enum Values {
    /// All corners' that are known are on one side of the surface: an inner and an outer value, or `None` if none is known.
    Uniform(Option<i16>),
    /// Those of all corners.
    All(Box<[i16; VALUES]>),
}

/// Signed distances at the corners of all bricks' cells.
pub(crate) struct Field<'a> {
    pub bricks: &'a Bricks,
    values: Vec<Values>,
}

impl<'a> Field<'a> {
    /// The field of what all views say; `near` is what is near a surface, sizes of a pixel.
    pub fn of(bricks: &'a Bricks, views: &[SeenView], near: f32) -> Self {
        let of_brick = |brick| reduced(bricks, brick, values(bricks, (views, near), bricks.all[brick]));
        Self { bricks, values: (0..bricks.all.len()).into_par_iter().map(of_brick).collect() }
    }

    /// The field of a function, which says `None` where it is unknown.
    #[cfg(test)]
    pub fn of_function(bricks: &'a Bricks, f: impl Fn(Vector3<f64>) -> Option<f64> + Sync) -> Self {
        let of_brick = |number: usize| {
            let brick = bricks.all[number];
            let cell = bricks.unit as f32 * brick.cell() as f32;
            let at = |number: usize| {
                let distance = f(bricks.x_in_world(&corner(brick, number).cast()));
                distance.map_or(UNKNOWN, |distance| packed(distance as f32, cell, true))
            };
            reduced(bricks, number, Box::new(std::array::from_fn(at)))
        };
        Self { bricks, values: (0..bricks.all.len()).into_par_iter().map(of_brick).collect() }
    }

    /// Whether a surface may go through a brick.
    pub fn may_have_surface(&self, brick: usize) -> bool {
        matches!(self.values[brick], Values::All(_))
    }

    /// The distance at a point of the grid that is a corner of a brick's cell, in sizes of that brick's cells; `None` if
    /// it is unknown.
    #[inline]
    pub fn at(&self, brick: usize, place: &Place) -> Option<f32> {
        self.value(brick, place).map(|value| f32::from(value & !1) / PER_CELL)
    }

    /// Whether a view sees a surface near a point of the grid that is a corner of a brick's cell.
    #[inline]
    pub fn is_near(&self, brick: usize, place: &Place) -> bool {
        self.value(brick, place).is_some_and(|value| value & 1 == 1)
    }

    #[inline]
    fn value(&self, brick: usize, place: &Place) -> Option<i16> {
        let value = match &self.values[brick] {
            Values::Uniform(value) => (*value)?,
            Values::All(values) => {
                let Brick { low, level } = self.bricks.all[brick];
                let [x, y, z]: [i32; 3] = (place - low).map(|x| x >> level).into();
                values[(z as usize * CORNERS + y as usize) * CORNERS + x as usize]
            }
        };
        (value != UNKNOWN).then_some(value)
    }
}

/// Only what is needed of a brick's values: of one that a surface does not go through, on which side of it it is.
fn reduced(bricks: &Bricks, brick: usize, values: Box<[i16; VALUES]>) -> Values {
    let is_inner = |value: &&i16| **value < 0 && **value != UNKNOWN;
    let is_outer = |value: &&i16| **value >= 0;
    match (values.iter().find(is_inner), values.iter().find(is_outer)) {
        (Some(_), Some(_)) => Values::All(values),
        (Some(_), None) | (None, Some(_)) if bricks.has_finer_beside(brick) => Values::All(values),
        (inner, outer) => Values::Uniform(inner.or(outer).copied()),
    }
}

/// The place of a brick's corner with this number.
fn corner(brick: Brick, number: usize) -> Place {
    let [x, y, z] = [number % CORNERS, number / CORNERS % CORNERS, number / (CORNERS * CORNERS)];
    brick.low + Vector3::new(x, y, z).map(|x| x as i32 * brick.cell())
}

/// A distance in cells with three digits behind the point, never 0 if it is negative. The last bit says whether a view sees a
/// surface near.
fn packed(distance: f32, cell: f32, is_near: bool) -> i16 {
    let value = (distance / cell * PER_CELL).clamp(-32000.0, 32000.0) as i16 & !1;
    let value = if distance < 0.0 { value.min(-2) } else { value };
    value | i16::from(is_near)
}

/// The values of a brick. Each depends on the place alone, not on the brick, so bricks agree on corners that they share.
fn values(bricks: &Bricks, (views, near): (&[SeenView], f32), brick: Brick) -> Box<[i16; VALUES]> {
    let middle = brick.low.cast::<f64>() + Vector3::repeat(f64::from(brick.width()) / 2.0);
    let radius = f64::from(brick.width()) / 2.0 * 3.0_f64.sqrt() * bricks.unit;
    let middle = bricks.x_in_world(&middle);
    let mut sums = [(0.0_f32, 0.0_f32, false); VALUES];
    for view in views.iter().filter(|view| view.may_see((&middle, radius), near)) {
        add(bricks, (view, near), brick, &mut sums);
    }
    let cell = bricks.unit as f32 * brick.cell() as f32;
    let mean = |(distance, weight, is_near)| {
        if weight > 0.0 { packed(distance / weight, cell, is_near) } else { UNKNOWN }
    };
    Box::new(sums.map(mean))
}

/// Adds what a view says of a brick's corners to the sums of distances and weights.
fn add(bricks: &Bricks, (view, near): (&SeenView, f32), brick: Brick, sums: &mut [(f32, f32, bool); VALUES]) {
    let pose = &view.cam_from_world;
    let at_origin = pose.transform(&bricks.origin);
    let [along_x, along_y, along_z] = [0, 1, 2].map(|axis| pose.rotation.column(axis) * bricks.unit);
    for (number, row) in sums.as_chunks_mut::<CORNERS>().0.iter_mut().enumerate() {
        let first = corner(brick, number * CORNERS);
        let begin = at_origin + along_z * f64::from(first.z) + along_y * f64::from(first.y);
        for (step, sum) in row.iter_mut().enumerate() {
            let x = f64::from(first.x + step as i32 * brick.cell());
            let opinion = view.opinion(&(begin + along_x * x), near);
            sum.0 += opinion.weight * opinion.distance;
            sum.1 += opinion.weight;
            sum.2 |= opinion.is_near;
        }
    }
}
