//! Turntable: one to three things on a table.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::Vector3;
use rand::RngExt;

use super::set::{Set, upright};
use super::{Focus, Layout};
use crate::assets::{AssetError, Look};
use crate::primitive::{cylinder, rectangle};

/// Height of the table top above the ground, metres; the table top is at z = 0.
const HEIGHT: f64 = 0.7;

/// Builds a round or square table above a large ground, and drops the things on it.
pub(super) fn build(mut set: Set) -> Result<Layout, AssetError> {
    let ground = set.material(Look::Any, 2.0)?;
    set.place(Arc::new(rectangle([8.0; 2])), &ground, upright(&Vector3::new(0.0, 0.0, -HEIGHT), 0.0));
    let count = set.rng.random_range(1..=3);
    let things = set.things(count)?;
    // The things are scaled to a similar size, so that together they fill the picture.
    let ring = if count == 1 { 0.0 } else { 0.12 };
    add_table(&mut set)?;
    let turn = set.rng.random_range(0.0..TAU);
    for (index, thing) in things.into_iter().enumerate() {
        let enlarged = set.rng.random_range(0.09..0.14) / thing.radius();
        let angle = turn + TAU * index as f64 / count as f64;
        set.drop(thing, enlarged, [ring * angle.cos(), ring * angle.sin()]);
    }
    let finished = set.finish(0.5);
    let centre = finished.things.iter().map(|(middle, _)| middle).sum::<Vector3<f64>>()
        / finished.things.len().max(1) as f64;
    let radius =
        finished.things.iter().map(|(middle, radius)| (middle - centre).norm() + radius).fold(0.1, f64::max);
    let focus = Focus {
        centre,
        radius,
        axis: Vector3::z(),
        spread: 80_f64.to_radians(),
        lowest: 10_f64.to_radians(),
    };
    Ok(Layout { objects: finished.objects, focus })
}

fn add_table(set: &mut Set) -> Result<(), AssetError> {
    let material = set.material(Look::Any, 0.6)?;
    let (side, thickness) = (set.rng.random_range(0.6..1.2), 0.04);
    let centre = Vector3::new(0.0, 0.0, -0.5 * thickness);
    if set.rng.random_bool(0.5) {
        let yaw = set.rng.random_range(0.0..TAU);
        set.block([side, side, thickness], &centre, yaw, &material);
    } else {
        // In physics the disc is the square inscribed in it.
        let inner = side * std::f64::consts::FRAC_1_SQRT_2;
        set.support([inner, inner, thickness], &centre, 0.0);
        let disc = cylinder(0.5 * side as f32, thickness as f32, 96);
        set.place(Arc::new(disc), &material, upright(&centre, 0.0));
    }
    Ok(())
}
