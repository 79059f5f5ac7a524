//! Clutter: a pile of things on the ground, in the open, in a box or in a corner.

use nalgebra::Vector3;
use rand::RngExt;

use super::set::{Finished, Set, in_disc};
use super::{Focus, Layout};
use crate::assets::{AssetError, Look};

/// Side of the ground, metres.
const GROUND: f64 = 4.0;

/// What surrounds the pile.
#[derive(Clone, Copy, PartialEq)]
enum Surround {
    Open,
    Corner,
    Box,
}

/// Drops 15 to 25 things onto a pile.
pub(super) fn build(mut set: Set) -> Result<Layout, AssetError> {
    let ground = set.material(Look::Any, 1.2)?;
    set.ground(GROUND, &ground);
    let surround =
        [Surround::Open, Surround::Open, Surround::Corner, Surround::Box][set.rng.random_range(0..4)];
    let half = set.rng.random_range(0.15..0.24);
    match surround {
        Surround::Open => {}
        Surround::Corner => add_corner(&mut set, half)?,
        Surround::Box => add_box(&mut set, half)?,
    }
    let count = set.rng.random_range(15..=25);
    for thing in set.things(count)? {
        let place = in_disc((half - thing.radius()).max(0.2 * half), set.rng);
        set.drop(thing, 1.0, place);
    }
    let finished = set.finish(2.0 * half);
    let focus = focus(&finished, surround, half);
    Ok(Layout { objects: finished.objects, focus })
}

/// Two walls behind the pile, one along x and one along y, that meet in a corner.
fn add_corner(set: &mut Set, half: f64) -> Result<(), AssetError> {
    let (height, thickness, length) = (set.rng.random_range(0.3..0.9), 0.05, 6.0 * half);
    let across = -half - 0.5 * thickness;
    let along = 0.5 * length - half - thickness;
    let along_x = set.material(Look::Any, 0.8)?;
    set.block([length, thickness, height], &Vector3::new(along, across, 0.5 * height), 0.0, &along_x);
    let along_y = set.material(Look::Any, 0.8)?;
    set.block([thickness, length, height], &Vector3::new(across, along, 0.5 * height), 0.0, &along_y);
    Ok(())
}

/// Four low walls around the pile.
fn add_box(set: &mut Set, half: f64) -> Result<(), AssetError> {
    let (height, thickness) = (set.rng.random_range(0.06..0.13), set.rng.random_range(0.006..0.02));
    let material = set.material(Look::Any, 0.5)?;
    let (centre, outer) = (half + 0.5 * thickness, 2.0 * (half + thickness));
    for side in [-1.0, 1.0] {
        let along_y = Vector3::new(side * centre, 0.0, 0.5 * height);
        set.block([thickness, outer, height], &along_y, 0.0, &material);
        let along_x = Vector3::new(0.0, side * centre, 0.5 * height);
        set.block([2.0 * half, thickness, height], &along_x, 0.0, &material);
    }
    Ok(())
}

fn focus(finished: &Finished, surround: Surround, half: f64) -> Focus {
    let count = finished.things.len().max(1) as f64;
    let centre = finished.things.iter().map(|(middle, _)| middle).sum::<Vector3<f64>>() / count;
    let reach = finished.things.iter().map(|(middle, _)| (middle - centre).norm()).sum::<f64>() / count;
    let (axis, spread, lowest) = match surround {
        Surround::Open => (Vector3::z(), 70.0_f64, 20.0_f64),
        Surround::Corner => (Vector3::new(1.0, 1.0, 1.4).normalize(), 42.0, 20.0),
        Surround::Box => (Vector3::z(), 50.0, 40.0),
    };
    let radius = (1.8 * reach).max(0.8 * half);
    Focus { centre, radius, axis, spread: spread.to_radians(), lowest: lowest.to_radians() }
}
