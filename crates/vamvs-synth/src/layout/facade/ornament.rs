//! Ornaments that project from a façade: sills, pediments, ledges, columns, quoins, roundels; and things in
//! front of it.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

use super::{Palette, Plan, place, slab};
use crate::assets::{AssetError, Look};
use crate::layout::set::Set;
use crate::primitive::{Opening, blob, extrusion, lathe, rounded_cuboid, torus};

/// Which ornaments a house has.
pub(super) struct Taste {
    /// Width of the frames around openings, if there are any, metres.
    surround: Option<f64>,
    pediments: bool,
    columns: bool,
    stones: bool,
    roundels: bool,
    /// How far ledges project, metres.
    ledge: f64,
}

impl Taste {
    pub fn random(rng: &mut Pcg64) -> Self {
        Self {
            surround: rng.random_bool(0.6).then(|| rng.random_range(0.06..0.16)),
            pediments: rng.random_bool(0.5),
            columns: rng.random_bool(0.5),
            stones: rng.random_bool(0.5),
            roundels: rng.random_bool(0.4),
            ledge: rng.random_range(0.06..0.25),
        }
    }
}

/// Adds the sill, surround and pediment of an opening.
pub(super) fn around(set: &mut Set, opening: &Opening, palette: &Palette, taste: &Taste, is_door: bool) {
    let [x, z] = [opening.x, opening.z].map(|ends| ends.map(f64::from));
    let (middle, width) = (0.5 * (x[0] + x[1]), x[1] - x[0]);
    let border = taste.surround.unwrap_or(0.0);
    if let Some(border) = taste.surround {
        for side in [x[0] - 0.5 * border, x[1] + 0.5 * border] {
            let centre = Vector3::new(side, 0.0, 0.5 * (z[0] + z[1]));
            slab(set, [border, 0.08, z[1] - z[0]], &centre, &palette.trim);
        }
        let lintel = Vector3::new(middle, 0.0, z[1] + 0.5 * border);
        slab(set, [width + 2.0 * border, 0.1, border], &lintel, &palette.trim);
    }
    if !is_door {
        let sill = moulding(0.6 * taste.ledge, 0.08, width + 2.0 * border + 0.1);
        place(set, sill, &Vector3::new(middle, 0.0, z[0] - 0.08), &palette.trim);
    }
    if taste.pediments {
        pediment(set, [middle, z[1] + border], width + 2.0 * border + 0.2, palette, taste);
    }
}

/// A triangular gable over an opening; the middle of its lower edge is at `[x, z]`.
fn pediment(set: &mut Set, [x, z]: [f64; 2], width: f64, palette: &Palette, taste: &Taste) {
    let (half, height, thick) = (0.5 * width as f32, 0.22 * width as f32, 0.8 * taste.ledge as f32);
    // The extrusion runs along x; turning x to −y makes the triangle face the front.
    let gable = extrusion(&[[-half, 0.0], [half, 0.0], [0.0, height]], thick);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_2);
    let centre = Translation3::new(x, -0.5 * f64::from(thick) + 0.01, z);
    set.place(Arc::new(gable), &palette.trim, Isometry3::from_parts(centre, turn));
}

/// Adds the plinth, the ledges between storeys, the cornice, and the ornaments between bays.
pub(super) fn along(set: &mut Set, plan: &Plan, palette: &Palette, taste: &Taste) {
    let length = plan.width() + 2.0 * plan.bay;
    slab(set, [length, 0.12, 0.35], &Vector3::new(0.0, 0.0, 0.175), &palette.trim);
    for storey in 1..=plan.storeys {
        let grow = if storey == plan.storeys { 2.0 } else { 1.0 };
        let ledge = moulding(grow * taste.ledge, grow * 0.12, length);
        place(set, ledge, &Vector3::new(0.0, 0.0, storey as f64 * plan.storey), &palette.trim);
    }
    for bay in 0..=plan.bays {
        let x = plan.bay_x(bay) - 0.5 * plan.bay;
        if taste.columns {
            column(set, x, plan, palette);
        }
        if taste.stones && (bay == 0 || bay == plan.bays) {
            stones(set, x, plan, palette);
        }
        if taste.roundels && !taste.columns && bay > 0 && bay < plan.bays {
            roundel(set, x, plan, palette);
        }
    }
}

/// A ledge of `length` along x, from height 0 to `height`, that projects by `reach`. Its profile has a flat face, a
/// hollow and a step.
fn moulding(reach: f64, height: f64, length: f64) -> crate::Mesh {
    let (reach, height) = (reach as f32, height as f32);
    let hollow = (0..=6).map(|step| {
        let angle = std::f32::consts::FRAC_PI_2 * step as f32 / 6.0;
        [-reach * (0.3 + 0.5 * angle.cos()), height * (0.6 - 0.4 * angle.sin())]
    });
    let mut profile = vec![[0.02, height], [-reach, height], [-reach, 0.6 * height]];
    profile.extend(hollow);
    profile.extend([[-0.3 * reach, 0.0], [0.02, 0.0]]);
    extrusion(&profile, length as f32)
}

/// A column over all storeys, partly embedded in the wall.
fn column(set: &mut Set, x: f64, plan: &Plan, palette: &Palette) {
    let (r, h) = (0.09 * plan.bay as f32, (plan.height() - 0.35) as f32);
    let base = [[0.0, 0.0], [1.4 * r, 0.0], [1.4 * r, 0.6 * r], [1.25 * r, 0.9 * r], [1.1 * r, 1.2 * r]];
    let shaft = [[r, 1.5 * r], [0.85 * r, h - 1.5 * r]];
    let capital = [[1.0 * r, h - 1.2 * r], [1.35 * r, h - 0.5 * r], [1.35 * r, h], [0.0, h]];
    let profile = [&base[..], &shaft, &capital].concat();
    place(set, lathe(&profile, 48), &Vector3::new(x, -0.4 * f64::from(r), 0.35), &palette.trim);
}

/// Quoins: long and short stones in alternation at one end of the wall.
fn stones(set: &mut Set, x: f64, plan: &Plan, palette: &Palette) {
    let height = 0.3;
    for index in 0..(plan.height() / height) as usize {
        let length = if index % 2 == 0 { 0.6 } else { 0.4 };
        let depth = set.rng.random_range(0.05..0.09);
        let stone = rounded_cuboid([length, 2.0 * depth, 0.97 * height as f32], 0.02, 3);
        place(set, stone, &Vector3::new(x, 0.0, (index as f64 + 0.5) * height), &palette.trim);
    }
}

/// A ring around a round boss, between the windows of the top storey.
fn roundel(set: &mut Set, x: f64, plan: &Plan, palette: &Palette) {
    let radius = 0.1 * plan.bay;
    let place = Translation3::new(x, 0.0, plan.height() - 0.45 * plan.storey);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let ring = torus(radius as f32, 0.25 * radius as f32, 48);
    set.place(Arc::new(ring), &palette.trim, Isometry3::from_parts(place, turn));
    let boss = blob(0.5 * radius as f32, 16, 0.3, 4.0, set.rng.random());
    set.place(Arc::new(boss), &palette.trim, Isometry3::from_parts(place, turn));
}

/// Adds bushes and boxes in front of the wall.
pub(super) fn before(set: &mut Set, plan: &Plan) -> Result<(), AssetError> {
    for _ in 0..set.rng.random_range(2..7) {
        let size = set.rng.random_range(0.2..0.5_f64);
        let x = 0.5 * plan.width() * set.rng.random_range(-1.0..1.0);
        let y = -size * set.rng.random_range(0.7..2.0);
        let material = set.material(Look::Rich, 2.0 * size)?;
        if set.rng.random_bool(0.5) {
            let bush = blob(0.6 * size as f32, 32, 0.45, 6.0, set.rng.random());
            place(set, bush, &Vector3::new(x, y, 0.3 * size), &material);
        } else {
            let crate_of = rounded_cuboid([size as f32, 0.7 * size as f32, 0.8 * size as f32], 0.01, 2);
            place(set, crate_of, &Vector3::new(x, y, 0.4 * size), &material);
        }
    }
    Ok(())
}
