//! A façade: openings in storeys and bays, ledges, columns, ornaments.
//!
//! The wall stands in the plane y = 0 and is seen from the side of −y; x runs along it.

mod ornament;

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use rand::RngExt;

use super::set::{Set, upright};
use super::{Focus, Layout};
use crate::assets::{AssetError, Look};
use crate::primitive::{Opening, cuboid, pierced_wall, rectangle};
use crate::{Material, Mesh};
use ornament::Taste;

/// The materials of a house.
struct Palette {
    wall: Material,
    trim: Material,
    frame: Material,
    pane: Material,
    door: Material,
}

/// The dimensions of a façade; lengths in metres.
struct Plan {
    bays: usize,
    storeys: usize,
    bay: f64,
    storey: f64,
    /// Width and height of a window.
    window: [f64; 2],
    /// Depth of the openings.
    depth: f64,
    /// The bay that has the door.
    door: usize,
}

/// Builds a wall with two to five bays and one to three storeys, the ground, and some things in front of it.
pub(super) fn build(mut set: Set) -> Result<Layout, AssetError> {
    let plan = Plan::random(&mut set);
    let palette = palette(&mut set)?;
    let taste = Taste::random(set.rng);
    let openings = plan.openings();
    // The wall extends beyond its bays, so that cameras seldom see past it.
    let half = 0.5 * plan.width() + plan.bay;
    let outline = Opening { x: [-half as f32, half as f32], z: [-0.2, (plan.height() + 0.4) as f32] };
    let wall = pierced_wall(&outline, &openings, plan.depth as f32);
    set.place(Arc::new(wall), &palette.wall, Isometry3::identity());
    for (index, opening) in openings.iter().enumerate() {
        let is_door = index == plan.door;
        fill(&mut set, opening, plan.depth, &palette, is_door);
        ornament::around(&mut set, opening, &palette, &taste, is_door);
    }
    ornament::along(&mut set, &plan, &palette, &taste);
    let ground = set.material(Look::Masonry, 1.5)?;
    let pavement = rectangle([16.0, 12.0]);
    set.place(Arc::new(pavement), &ground, upright(&Vector3::zeros(), 0.0));
    ornament::before(&mut set, &plan)?;
    let focus = plan.focus(&mut set);
    Ok(Layout { objects: set.finish(0.0).objects, focus })
}

fn palette(set: &mut Set) -> Result<Palette, AssetError> {
    Ok(Palette {
        wall: set.material(Look::Masonry, 1.2)?,
        trim: set.material(Look::Any, 0.8)?,
        frame: set.material(Look::Any, 0.4)?,
        pane: Material { specular: 0.06, roughness: 0.1, tint: [0.25; 3], ..set.material(Look::Any, 1.0)? },
        door: set.material(Look::Rich, 0.8)?,
    })
}

impl Plan {
    fn random(set: &mut Set) -> Self {
        let rng = &mut *set.rng;
        let (bays, bay) = (rng.random_range(2..=5), rng.random_range(1.1..2.0));
        let storey = rng.random_range(1.8..2.8);
        let window = [bay * rng.random_range(0.35..0.6), storey * rng.random_range(0.4..0.6)];
        let storeys = rng.random_range(1..=3);
        Self {
            bays,
            storeys,
            bay,
            storey,
            window,
            depth: rng.random_range(0.08..0.3),
            door: rng.random_range(0..bays),
        }
    }

    fn width(&self) -> f64 {
        self.bay * self.bays as f64
    }

    fn height(&self) -> f64 {
        self.storey * self.storeys as f64
    }

    /// The x of a bay's middle.
    fn bay_x(&self, bay: usize) -> f64 {
        (bay as f64 + 0.5) * self.bay - 0.5 * self.width()
    }

    /// All openings, storey by storey, each from the left. The door reaches down to the ground.
    fn openings(&self) -> Vec<Opening> {
        let places = (0..self.storeys).flat_map(|storey| (0..self.bays).map(move |bay| (storey, bay)));
        let opening = |(storey, bay): (usize, usize)| {
            let is_door = storey == 0 && bay == self.door;
            let x = self.bay_x(bay);
            let z = (storey as f64 + 0.55) * self.storey;
            let low = if is_door { 0.0 } else { z - 0.5 * self.window[1] };
            let half = 0.5 * self.window[0];
            Opening {
                x: [(x - half) as f32, (x + half) as f32],
                z: [low as f32, (z + 0.5 * self.window[1]) as f32],
            }
        };
        places.map(opening).collect()
    }

    /// A random part of the wall, seen from the front.
    fn focus(&self, set: &mut Set) -> Focus {
        let largest = 0.5 * self.width().min(self.height().max(3.0));
        let radius = largest * set.rng.random_range(0.6..1.0);
        let aside = (0.5 * self.width() - radius).max(0.0) * set.rng.random_range(-1.0..1.0);
        let free = (self.height() - radius).max(0.6 * radius);
        let height = set.rng.random_range(0.6 * radius..=free);
        Focus {
            centre: Vector3::new(aside, 0.0, height),
            radius,
            axis: Vector3::new(0.0, -1.0, 0.0),
            spread: 55_f64.to_radians(),
            lowest: -5_f64.to_radians(),
        }
    }
}

/// Closes an opening with a window or a door.
fn fill(set: &mut Set, opening: &Opening, depth: f64, palette: &Palette, is_door: bool) {
    let [low, high] = [0, 1].map(|end| Vector3::new(opening.x[end].into(), 0.0, f64::from(opening.z[end])));
    let (centre, size) = (0.5 * (low + high), high - low);
    let back = Vector3::new(centre.x, depth, centre.z);
    let pane = if is_door { &palette.door } else { &palette.pane };
    slab(set, [size.x, 0.02, size.z], &(back + Vector3::y() * 0.01), pane);
    let bar = 0.05;
    for side in [-0.5, 0.5] {
        let upright = back + Vector3::x() * side * (size.x - bar);
        slab(set, [bar, 0.06, size.z], &upright, &palette.frame);
        let level = back + Vector3::z() * side * (size.z - bar);
        slab(set, [size.x - 2.0 * bar, 0.06, bar], &level, &palette.frame);
    }
    let bars = if is_door { [1, 3] } else { [set.rng.random_range(0..3), set.rng.random_range(0..4)] };
    for (axis, count) in [(0, bars[0]), (2, bars[1])] {
        for index in 1..=count {
            let mut place = back;
            place[axis] += size[axis] * (index as f64 / (count + 1) as f64 - 0.5);
            let mut across = [0.035, 0.04, 0.035];
            across[2 - axis] = size[2 - axis] - 2.0 * bar;
            slab(set, across, &place, &palette.frame);
        }
    }
}

/// Places a box; physics does not know it, as nothing falls on façades.
fn slab(set: &mut Set, size: [f64; 3], centre: &Vector3<f64>, material: &Material) {
    place(set, cuboid(size.map(|side| side as f32)), centre, material);
}

fn place(set: &mut Set, mesh: Mesh, centre: &Vector3<f64>, material: &Material) {
    set.place(Arc::new(mesh), material, upright(centre, 0.0));
}
