//! Planes averaged over neighbours on the same surface.

use rayon::prelude::*;
use vamvs_core::Grid;

use crate::field::{Field, State};
use crate::matcher::Matcher;
use crate::plane::Plane;

/// Pixels to each side.
const RADIUS: i32 = 3;

/// Difference in disparity at which a neighbour counts a quarter, pixels.
const SAME: f32 = 0.3;

/// Each plane as the mean of those around it, as seen from its pixel: the more a neighbour's plane passes through the
/// same point, the more it counts, so that edges of depth stay.
pub(crate) fn smoothed(field: &Field, matcher: &Matcher) -> Field {
    let size = field.size();
    let mut planes = Grid::filled(size, Plane::default());
    planes.data_mut().par_chunks_exact_mut(size.width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, plane) in row.iter_mut().enumerate() {
            *plane = mean(field, matcher, x, y);
        }
    });
    Field::new(size, |x, y| State { plane: planes[(x, y)], ..*field.at(x, y) })
}

fn mean(field: &Field, matcher: &Matcher, x: usize, y: usize) -> Plane {
    let own = field.at(x, y).plane;
    if own.w <= 0.0 {
        return own;
    }
    let scale = 1.0 / (SAME * matcher.step(x, y, own.w));
    let (mut sum, mut total) = (Plane::default(), 0.0);
    for dy in -RADIUS..=RADIUS {
        for dx in -RADIUS..=RADIUS {
            let Some(state) = field.get(x as i32 + dx, y as i32 + dy) else { continue };
            let seen = state.plane.seen_from(-dx as f32, -dy as f32);
            let difference = (seen.w - own.w) * scale;
            let likeness = 1.0 / (1.0 + difference * difference);
            let weight = likeness * likeness;
            sum = Plane {
                w: sum.w + weight * (seen.w - own.w),
                gx: sum.gx + weight * seen.gx,
                gy: sum.gy + weight * seen.gy,
            };
            total += weight;
        }
    }
    Plane { w: own.w + sum.w / total, gx: sum.gx / total, gy: sum.gy / total }
}
