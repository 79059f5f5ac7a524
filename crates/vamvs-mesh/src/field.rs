//! The signed distance from the surface at the corners of cells: the mean of what all views say.

use std::sync::{Arc, OnceLock};

use nalgebra::Vector3;

use crate::bricks::{BRICK, Brick, Bricks, Place};
use crate::opinion::{Opinions, PLACES, Places};
use crate::view::SeenView;

/// Corners along an edge of a brick.
const CORNERS: usize = BRICK as usize + 1;

/// Corners of a slice of a brick, 9×9.
const SLICE: usize = PLACES;

/// Corners of a brick's cells.
const VALUES: usize = CORNERS * SLICE;

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

/// Signed distances at the corners of bricks' cells, each brick's when they are first asked for.
pub(crate) struct Field<'a> {
    pub bricks: &'a Bricks,
    values_of: Box<dyn Fn(usize) -> Box<[i16; VALUES]> + Sync + 'a>,
    values: Vec<OnceLock<Values>>,
}

impl<'a> Field<'a> {
    /// The field of what views say; `near` is what is near a surface, sizes of a pixel.
    pub fn of(bricks: &'a Bricks, views: &'a [Arc<SeenView>], near: f32) -> Self {
        Self::new(bricks, move |brick| values(bricks, (views, near), brick))
    }

    fn new(bricks: &'a Bricks, values_of: impl Fn(usize) -> Box<[i16; VALUES]> + Sync + 'a) -> Self {
        let values = bricks.all.iter().map(|_| OnceLock::new()).collect();
        Self { bricks, values_of: Box::new(values_of), values }
    }

    /// The field of a function, which says `None` where it is unknown.
    #[cfg(test)]
    pub fn of_function(bricks: &'a Bricks, f: impl Fn(Vector3<f64>) -> Option<f64> + Sync + 'a) -> Self {
        let of_brick = move |number: usize| {
            let brick = bricks.all[number];
            let cell = bricks.unit as f32 * brick.cell() as f32;
            let at = |number: usize| {
                let distance = f(bricks.x_in_world(&corner(brick, number).cast()));
                distance.map_or(UNKNOWN, |distance| packed(distance as f32, cell, true))
            };
            Box::new(std::array::from_fn(at))
        };
        Self::new(bricks, of_brick)
    }

    /// Whether a surface may go through a brick.
    pub fn may_have_surface(&self, brick: usize) -> bool {
        matches!(self.values(brick), Values::All(_))
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
    fn values(&self, brick: usize) -> &Values {
        self.values[brick].get_or_init(|| reduced(self.bricks, brick, (self.values_of)(brick)))
    }

    #[inline]
    fn value(&self, brick: usize, place: &Place) -> Option<i16> {
        let value = match self.values(brick) {
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
fn values(bricks: &Bricks, (views, near): (&[Arc<SeenView>], f32), number: usize) -> Box<[i16; VALUES]> {
    let brick = bricks.all[number];
    let (middle, radius) = bricks.ball(number);
    let mut slices = [Opinions::default(); CORNERS];
    for view in views.iter().filter(|view| view.sight.may_see((&middle, radius), near)) {
        for (z, slice) in slices.iter_mut().enumerate() {
            view.add(&places(bricks, view, brick, z), near, slice);
        }
    }
    let cell = bricks.unit as f32 * brick.cell() as f32;
    let mean = |number: usize| {
        let (slice, number) = (&slices[number / SLICE], number % SLICE);
        let (distance, weight) = (slice.distances[number], slice.weights[number]);
        if weight > 0.0 { packed(distance / weight, cell, slice.are_near[number] > 0.0) } else { UNKNOWN }
    };
    Box::new(std::array::from_fn(mean))
}

/// The places of a slice of a brick's corners in a view's frame.
fn places(bricks: &Bricks, view: &SeenView, brick: Brick, z: usize) -> Places {
    let pose = &view.sight.cam_from_world;
    let at_origin = pose.transform(&bricks.origin);
    let mut places = [[0.0; SLICE]; 3];
    for (axis, values) in places.iter_mut().enumerate() {
        let [along_x, along_y, along_z] = [0, 1, 2].map(|column| pose.rotation[(axis, column)] * bricks.unit);
        for (y, row) in values.as_chunks_mut::<CORNERS>().0.iter_mut().enumerate() {
            let first = corner(brick, (z * CORNERS + y) * CORNERS);
            let begin = at_origin[axis] + along_z * f64::from(first.z) + along_y * f64::from(first.y);
            for (x, value) in row.iter_mut().enumerate() {
                *value = (begin + along_x * f64::from(first.x + x as i32 * brick.cell())) as f32;
            }
        }
    }
    places
}
