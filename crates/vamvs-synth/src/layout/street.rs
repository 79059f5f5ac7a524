//! A street: houses, bare trees, railings, wires and a monument against the sky, seen from the height of a person.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Isometry3, Similarity3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;

use super::set::{Set, upright};
use super::{Focus, Layout};
use crate::Material;
use crate::assets::{AssetError, Look};
use crate::primitive::{blob, cuboid, extrusion, lathe, rectangle};

/// Sides of the prisms that stand for thin round things.
const SIDES: usize = 8;

/// Builds houses around the middle, what stands before them, and on some streets hills far away.
pub(super) fn build(mut set: Set) -> Result<Layout, AssetError> {
    let is_open = set.rng.random_bool(0.5);
    let pavement = set.material(Look::Masonry, 2.0)?;
    let side = if is_open { 240.0 } else { 40.0 };
    set.place(Arc::new(rectangle([side; 2])), &pavement, Isometry3::identity());
    let house = add_house(&mut set, &Vector3::zeros(), 1.0)?;
    for _ in 0..set.rng.random_range(0..3) {
        let place = Vector3::new(set.rng.random_range(-14.0..14.0), set.rng.random_range(4.0..14.0), 0.0);
        let size = set.rng.random_range(0.7..1.6);
        add_house(&mut set, &place, size)?;
    }
    for _ in 0..set.rng.random_range(1..4) {
        add_tree(&mut set)?;
    }
    add_wires(&mut set)?;
    if set.rng.random_bool(0.5) {
        add_railing(&mut set)?;
    }
    if set.rng.random_bool(0.6) {
        add_monument(&mut set)?;
    }
    if is_open {
        add_hills(&mut set)?;
    }
    let radius = set.rng.random_range(2.0..4.5);
    let focus = Focus {
        centre: Vector3::new(set.rng.random_range(-2.0..2.0), -1.0, house * set.rng.random_range(0.6..1.05)),
        radius,
        axis: Vector3::new(0.0, -1.0, 0.0),
        spread: 65_f64.to_radians(),
        lowest: -18_f64.to_radians(),
    };
    Ok(Layout { objects: set.finish(0.0).objects, focus })
}

/// A house with its front towards −y: a body, a gabled or a flat roof, chimneys, windows as dark boxes. Returns the height
/// of its walls.
fn add_house(set: &mut Set, place: &Vector3<f64>, size: f64) -> Result<f64, AssetError> {
    let [walls, roof, dark] =
        [set.material(Look::Masonry, 1.5)?, set.material(Look::Rich, 1.0)?, set.material(Look::Any, 0.6)?];
    let [width, depth, height] =
        [(5.0, 9.0), (4.0, 7.0), (3.0, 6.5)].map(|(least, most)| size * set.rng.random_range(least..most));
    let middle = place + Vector3::new(0.0, 0.5 * depth, 0.0);
    block(set, [width, depth, height], &(middle + Vector3::z() * 0.5 * height), &walls);
    let bays = set.rng.random_range(2..5);
    for bay in 0..bays {
        let x = (f64::from(bay) + 0.5) / f64::from(bays) - 0.5;
        let centre = place + Vector3::new(x * width, 0.0, 0.62 * height);
        block(set, [0.4 * width / f64::from(bays), 0.12, 0.3 * height], &centre, &dark);
    }
    let top = middle + Vector3::z() * height;
    if set.rng.random_bool(0.7) {
        let (half, eaves) = (0.55 * depth as f32, -0.1);
        let rise = half * set.rng.random_range(0.5..1.2);
        let gable = extrusion(&[[0.0, rise], [-half, eaves], [half, eaves]], 1.06 * width as f32);
        set.place(Arc::new(gable), &roof, upright(&top, 0.0));
        for _ in 0..set.rng.random_range(0..3) {
            let tall = f64::from(rise) * set.rng.random_range(1.1..1.6);
            let at = Vector3::new(width * set.rng.random_range(-0.4..0.4), 0.0, 0.5 * tall);
            block(set, [0.5, 0.5, tall], &(top + at), &walls);
        }
    } else {
        let slab = [width + 0.3, depth + 0.3, 0.25];
        block(set, slab, &top, &roof);
        railing(set, &(top - Vector3::y() * 0.5 * depth), width, 0.9, &roof);
    }
    if set.rng.random_bool(0.5) {
        let foot = top + Vector3::new(width * set.rng.random_range(-0.3..0.3), 0.0, 0.0);
        aerial(set, &foot, 0.4 * height, &dark);
    }
    Ok(height)
}

/// A mast with a few cross bars.
fn aerial(set: &mut Set, foot: &Vector3<f64>, height: f64, material: &Material) {
    let tip = foot + Vector3::z() * height;
    rod(set, foot, &tip, 0.03, material);
    for bar in 0..set.rng.random_range(2..6) {
        let centre = tip - Vector3::z() * (0.12 * f64::from(bar));
        let half = Vector3::x() * set.rng.random_range(0.2..0.6);
        rod(set, &(centre - half), &(centre + half), 0.015, material);
    }
}

/// A bare tree, or one with clumps of leaves.
fn add_tree(set: &mut Set) -> Result<(), AssetError> {
    let (bark, leaves) = (set.material(Look::Any, 0.3)?, set.material(Look::Rich, 0.5)?);
    let rng = &mut *set.rng;
    let foot = Vector3::new(rng.random_range(-8.0..8.0), rng.random_range(-3.0..2.0), 0.0);
    let leafy = if rng.random_bool(0.5) { rng.random_range(0.3..1.0) } else { 0.0 };
    let height = rng.random_range(2.0..3.5);
    let up = Vector3::new(rng.random_range(-0.1..0.1), rng.random_range(-0.1..0.1), 1.0);
    branch(set, &foot, &(up * height), 0.045 * height, 4, &(bark, leaves, leafy));
    Ok(())
}

/// A branch from `foot` along `way`, and the branches that grow from it.
fn branch(
    set: &mut Set,
    foot: &Vector3<f64>,
    way: &Vector3<f64>,
    radius: f64,
    depth: usize,
    look: &(Material, Material, f64),
) {
    let (bark, leaves, leafy) = look;
    rod(set, foot, &(foot + way), radius, bark);
    if depth == 0 {
        if set.rng.random_bool(*leafy) {
            let clump = blob(0.3 * way.norm() as f32 + 0.1, 8, 0.45, 5.0, set.rng.random());
            let place = upright(&(foot + way), set.rng.random_range(0.0..TAU));
            set.place(Arc::new(clump), leaves, place);
        }
        return;
    }
    for _ in 0..set.rng.random_range(2..4) {
        let from = foot + way * set.rng.random_range(0.55..1.0);
        let aside = Vector3::from_fn(|_, _| set.rng.random_range(-1.0..1.0_f64));
        let onward = (way.normalize() + 0.9 * aside).normalize() + Vector3::z() * 0.15;
        let length = way.norm() * set.rng.random_range(0.55..0.8);
        branch(set, &from, &(onward.normalize() * length), 0.6 * radius, depth - 1, look);
    }
}

/// Two poles and the wires between them, which sag.
fn add_wires(set: &mut Set) -> Result<(), AssetError> {
    let material = set.material(Look::Any, 0.3)?;
    let height = set.rng.random_range(4.0..7.0);
    let mut ends = [-7.0, 7.0].map(|x| Vector3::new(x, set.rng.random_range(-4.0..-1.0), 0.0));
    for end in &mut ends {
        let foot = *end;
        end.z = height;
        rod(&mut *set, &foot, end, 0.09, &material);
    }
    for wire in 0..set.rng.random_range(1..5) {
        let [from, to] = ends.map(|end| end - Vector3::z() * (0.3 * f64::from(wire)));
        let (sag, radius) = (set.rng.random_range(0.2..0.9), set.rng.random_range(0.008..0.03));
        let at = |k: i32| {
            let t = f64::from(k) / 12.0;
            from.lerp(&to, t) - Vector3::z() * (sag * 4.0 * t * (1.0 - t))
        };
        for k in 0..12 {
            rod(set, &at(k), &at(k + 1), radius, &material);
        }
    }
    Ok(())
}

/// A railing before the houses.
fn add_railing(set: &mut Set) -> Result<(), AssetError> {
    let material = set.material(Look::Any, 0.3)?;
    let middle = Vector3::new(set.rng.random_range(-3.0..3.0), set.rng.random_range(-5.0..-2.0), 0.0);
    let width = set.rng.random_range(3.0..9.0);
    railing(set, &middle, width, 1.1, &material);
    Ok(())
}

/// Upright bars and a handrail along x, `height` above their middle's foot.
fn railing(set: &mut Set, middle: &Vector3<f64>, width: f64, height: f64, material: &Material) {
    let posts = (width / set.rng.random_range(0.12..0.5)) as usize;
    let at = |post: usize| middle + Vector3::x() * (width * (post as f64 / posts.max(1) as f64 - 0.5));
    let radius = set.rng.random_range(0.01..0.03);
    for post in 0..=posts {
        rod(set, &at(post), &(at(post) + Vector3::z() * height), radius, material);
    }
    for level in [0.15, 1.0] {
        let up = Vector3::z() * (level * height);
        rod(set, &(at(0) + up), &(at(posts) + up), 1.5 * radius, material);
    }
}

/// A thing on a plinth, larger than life, often dark.
fn add_monument(set: &mut Set) -> Result<(), AssetError> {
    let stone = set.material(Look::Masonry, 1.0)?;
    let foot = Vector3::new(set.rng.random_range(-3.0..3.0), set.rng.random_range(-4.0..-1.5), 0.0);
    let height = set.rng.random_range(0.8..2.5);
    block(set, [1.0, 1.0, height], &(foot + Vector3::z() * 0.5 * height), &stone);
    let bronze = set.rng.random_bool(0.5).then_some([0.25; 3]);
    for thing in set.things(1)? {
        let scale = set.rng.random_range(0.7..1.5) / thing.radius() * thing.scale;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), set.rng.random_range(0.0..TAU));
        let centre = foot + Vector3::z() * (height + 0.85 * scale / thing.scale * thing.radius());
        let moved = Translation3::from(centre - turn * thing.middle() * scale);
        let placed = Similarity3::from_isometry(Isometry3::from_parts(moved, turn), scale);
        for mut object in thing.objects(placed) {
            if let Some(tint) = bronze {
                object.material.tint = tint;
            }
            set.add(object);
        }
    }
    Ok(())
}

/// A few hills far away.
fn add_hills(set: &mut Set) -> Result<(), AssetError> {
    let material = set.material(Look::Earth, 20.0)?;
    for _ in 0..set.rng.random_range(1..6) {
        let radius = set.rng.random_range(8.0..25.0_f64);
        let (away, across) = (set.rng.random_range(40.0..110.0), set.rng.random_range(-70.0..70.0));
        let hill = blob(radius as f32, 24, 0.3, 4.0, set.rng.random());
        let centre = Vector3::new(across, away, -0.35 * radius);
        set.place(Arc::new(hill), &material, upright(&centre, 0.0));
    }
    Ok(())
}

/// A box that nothing falls onto.
fn block(set: &mut Set, size: [f64; 3], centre: &Vector3<f64>, material: &Material) {
    set.place(Arc::new(cuboid(size.map(|side| side as f32))), material, upright(centre, 0.0));
}

/// A round rod between two points.
fn rod(set: &mut Set, from: &Vector3<f64>, to: &Vector3<f64>, radius: f64, material: &Material) {
    let (way, r) = (to - from, radius as f32);
    let length = way.norm() as f32;
    let mesh = lathe(&[[0.0, 0.0], [r, 0.0], [0.8 * r, length], [0.0, length]], SIDES);
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &way)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.5 * TAU));
    set.place(Arc::new(mesh), material, Isometry3::from_parts(Translation3::from(*from), turn));
}
