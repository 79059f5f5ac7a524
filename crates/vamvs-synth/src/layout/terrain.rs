//! Terrain: bumpy ground with rocks, houses and trees, seen from above.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use nalgebra::{Isometry3, Similarity3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;

use super::set::{Set, upright};
use super::{Focus, Layout};
use crate::Mesh;
use crate::assets::{AssetError, Look};
use crate::noise::Octaves;
use crate::primitive::{blob, cuboid, extrusion, heightfield, lathe};

/// Side of the ground, metres.
const SIDE: f32 = 9.0;

/// Grid cells along a side of the ground.
const CELLS: usize = 220;

/// Shape of the ground: fractal noise with this amplitude and wavelength (metres). Roughness is the factor from
/// one octave's amplitude to the next.
struct Relief {
    amplitude: f32,
    wavelength: f32,
    roughness: f32,
    seed: u32,
}

impl Relief {
    fn random(set: &mut Set) -> Self {
        Self {
            amplitude: set.rng.random_range(0.3..1.1),
            wavelength: set.rng.random_range(1.5..3.5),
            roughness: set.rng.random_range(0.25..0.45),
            seed: set.rng.random(),
        }
    }

    fn height(&self, x: f32, y: f32) -> f32 {
        // The offset keeps away from the origin of the noise, whose grid lines would show as symmetry.
        let place = [x / self.wavelength + 31.4, y / self.wavelength + 27.2, 0.5];
        self.amplitude * Octaves { count: 6, gain: self.roughness }.space(place, self.seed)
    }

    fn at(&self, [x, y]: [f64; 2]) -> Vector3<f64> {
        Vector3::new(x, y, self.height(x as f32, y as f32).into())
    }
}

/// Builds the ground with rocks and, at random, houses and trees.
pub(super) fn build(mut set: Set) -> Result<Layout, AssetError> {
    let relief = Relief::random(&mut set);
    let ground = heightfield([SIDE; 2], [CELLS; 2], |x, y| relief.height(x, y));
    let material = set.material(Look::Earth, 3.0)?;
    set.place(Arc::new(ground), &material, Isometry3::identity());
    add_rocks(&mut set, &relief)?;
    if set.rng.random_bool(0.6) {
        add_houses(&mut set, &relief)?;
    }
    if set.rng.random_bool(0.6) {
        add_trees(&mut set, &relief)?;
    }
    let place = [0, 1].map(|_| set.rng.random_range(-1.0..1.0));
    let focus = Focus {
        centre: relief.at(place),
        radius: set.rng.random_range(1.2..2.2),
        axis: Vector3::z(),
        spread: 50_f64.to_radians(),
        lowest: 30_f64.to_radians(),
    };
    Ok(Layout { objects: set.finish(0.0).objects, focus })
}

/// A random place (x, y) on the ground.
fn anywhere(set: &mut Set) -> [f64; 2] {
    [0, 1].map(|_| 0.45 * f64::from(SIDE) * set.rng.random_range(-1.0..1.0))
}

/// Rocks of a few shapes, most of them small.
fn add_rocks(set: &mut Set, relief: &Relief) -> Result<(), AssetError> {
    let shapes: [Arc<Mesh>; 9] = std::array::from_fn(|_| Arc::new(blob(1.0, 16, 0.4, 3.5, set.rng.random())));
    let materials =
        [set.material(Look::Earth, 2.0)?, set.material(Look::Earth, 2.0)?, set.material(Look::Any, 2.0)?];
    for _ in 0..set.rng.random_range(40..160) {
        let radius = 0.03 + 0.3 * set.rng.random::<f64>().powi(4);
        let centre = relief.at(anywhere(set)) + Vector3::z() * radius * 0.3;
        let place = upright(&centre, set.rng.random_range(0.0..TAU));
        let kind = set.rng.random_range(0..9);
        let place = Similarity3::from_isometry(place, radius);
        set.place_scaled(shapes[kind].clone(), &materials[kind % 3], place);
    }
    Ok(())
}

/// Boxes under gabled roofs.
fn add_houses(set: &mut Set, relief: &Relief) -> Result<(), AssetError> {
    let (walls, roofs) = (set.material(Look::Rich, 0.8)?, set.material(Look::Rich, 0.6)?);
    for _ in 0..set.rng.random_range(3..10) {
        let place = anywhere(set);
        let size =
            [set.rng.random_range(0.5..1.1), set.rng.random_range(0.4..0.7), set.rng.random_range(0.4..0.9)];
        let yaw = set.rng.random_range(0.0..TAU);
        // The lower half is below ground, which may be steep.
        let base = relief.at(place);
        let body = cuboid([size[0], size[1], 2.0 * size[2]].map(|side| side as f32));
        set.place(Arc::new(body), &walls, upright(&base, yaw));
        let (half, eaves) = (0.6 * size[1] as f32, -0.05);
        let rise = half * set.rng.random_range(0.5..1.1);
        let roof = extrusion(&[[0.0, rise], [-half, eaves], [half, eaves]], 1.1 * size[0] as f32);
        set.place(Arc::new(roof), &roofs, upright(&(base + Vector3::z() * size[2]), yaw));
    }
    Ok(())
}

/// Trees: crowns on stems.
fn add_trees(set: &mut Set, relief: &Relief) -> Result<(), AssetError> {
    let (bark, leaves) = (set.material(Look::Any, 0.3)?, set.material(Look::Rich, 0.5)?);
    for _ in 0..set.rng.random_range(4..14) {
        let height = set.rng.random_range(0.4..0.9_f64);
        let (h, r) = (height as f32, 0.05 * height as f32);
        let stem = lathe(&[[0.0, -0.2], [1.3 * r, -0.2], [0.8 * r, h], [0.0, h]], 16);
        let place = anywhere(set);
        let base = relief.at(place);
        set.place(Arc::new(stem), &bark, upright(&base, 0.0));
        let crown = blob(0.4 * h, 20, 0.45, 7.0, set.rng.random());
        let lean = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), set.rng.random_range(0.0..FRAC_PI_2));
        let centre = Translation3::from(base + Vector3::z() * height);
        set.place(Arc::new(crown), &leaves, Isometry3::from_parts(centre, lean));
    }
    Ok(())
}
