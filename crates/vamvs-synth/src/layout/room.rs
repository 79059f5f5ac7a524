//! Room: a corner seen from inside, with two or three walls, furniture, pictures and things.
//!
//! The corner is at (0, 0); its walls run along +x and +y.

mod furniture;

use nalgebra::Vector3;
use rand::RngExt;

use super::set::Set;
use super::{Focus, Layout};
use crate::assets::{AssetError, Look};
use furniture::{Wall, add_table, hang_pictures, stand_along};

/// Length of the walls, metres.
const LENGTH: f64 = 4.5;

/// Height of the walls, metres.
const HEIGHT: f64 = 2.6;

/// Thickness of walls and floor, metres.
const THICKNESS: f64 = 0.1;

/// Builds the floor, walls and furniture, then drops things onto them.
pub(super) fn build(mut set: Set) -> Result<Layout, AssetError> {
    add_shell(&mut set)?;
    let mut tops = Vec::new();
    for wall in [Wall::AlongX, Wall::AlongY] {
        tops.extend(stand_along(&mut set, wall)?);
        hang_pictures(&mut set, wall)?;
    }
    if set.rng.random_bool(0.6) {
        tops.push(add_table(&mut set)?);
    }
    drop_things(&mut set, &tops)?;
    let focus = focus(&mut set);
    Ok(Layout { objects: set.finish(2.0 * LENGTH).objects, focus })
}

fn add_shell(set: &mut Set) -> Result<(), AssetError> {
    let floor = set.material(Look::Any, 1.2)?;
    let middle = 0.5 * LENGTH;
    let wide = LENGTH + 2.0 * THICKNESS;
    set.block([wide, wide, THICKNESS], &Vector3::new(middle, middle, -0.5 * THICKNESS), 0.0, &floor);
    // Half of the rooms have the same wallpaper on all walls.
    let paper = set.material(Look::Any, 1.0)?;
    let other = if set.rng.random_bool(0.5) { paper.clone() } else { set.material(Look::Any, 1.0)? };
    let sizes = [[wide, THICKNESS, HEIGHT], [THICKNESS, LENGTH, HEIGHT]];
    let centre = |x: f64, y: f64| Vector3::new(x, y, 0.5 * HEIGHT);
    set.block(sizes[0], &centre(middle, -0.5 * THICKNESS), 0.0, &paper);
    set.block(sizes[1], &centre(-0.5 * THICKNESS, middle), 0.0, &other);
    if set.rng.random_bool(0.3) {
        set.block(sizes[1], &centre(LENGTH + 0.5 * THICKNESS, middle), 0.0, &other);
    }
    let skirting = set.material(Look::Any, 0.5)?;
    set.block([LENGTH, 0.02, 0.1], &Vector3::new(middle, 0.01, 0.05), 0.0, &skirting);
    set.block([0.02, LENGTH, 0.1], &Vector3::new(0.01, middle, 0.05), 0.0, &skirting);
    Ok(())
}

/// Drops 8 to 16 things, enlarged, as they would hardly be visible at their own size.
fn drop_things(set: &mut Set, tops: &[[f64; 2]]) -> Result<(), AssetError> {
    let count = set.rng.random_range(8..=16);
    for thing in set.things(count)? {
        let enlarged = set.rng.random_range(1.3..2.4);
        let on_top = !tops.is_empty() && set.rng.random_bool(0.7);
        let place = if on_top {
            let top = tops[set.rng.random_range(0..tops.len())];
            top.map(|c| c + set.rng.random_range(-0.12..0.12))
        } else {
            [0, 1].map(|_| set.rng.random_range(0.4..2.2))
        };
        set.drop(thing, enlarged, place);
    }
    Ok(())
}

fn focus(set: &mut Set) -> Focus {
    let mut between = |low: f64, high: f64| set.rng.random_range(low..high);
    Focus {
        centre: Vector3::new(between(0.5, 1.1), between(0.5, 1.1), between(0.5, 0.9)),
        radius: between(1.0, 1.5),
        axis: Vector3::new(1.0, 1.0, between(0.2, 0.9)).normalize(),
        spread: 38_f64.to_radians(),
        lowest: 3_f64.to_radians(),
    }
}
