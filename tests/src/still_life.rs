//! The world of the still life: objects on a tiled floor in front of a brick wall.

use std::sync::Arc;

use nalgebra::{Similarity3, UnitQuaternion, Vector3};
use vamvs_synth::pattern::Motif;
use vamvs_synth::{Lamp, Mesh, Object, World, primitive};

use crate::sky;
use crate::texture::Look;

/// The objects with their materials, the sky and one lamp.
#[must_use]
pub fn world() -> World {
    let objects = [room(), round_things(), square_things()].into_iter().flatten();
    let objects = (0..).zip(objects).map(|(seed, thing)| thing.object(seed)).collect();
    World { objects, environment: sky::dim(), lamps: vec![window()] }
}

/// An object whose material has not been generated yet.
struct Thing {
    mesh: Mesh,
    look: Look,
    place: [f64; 3],
    /// Rotation from object to world, as a rotation vector (axis times angle in radians).
    turn: [f64; 3],
}

impl Thing {
    fn object(self, seed: u32) -> Object {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(self.turn));
        let place = Vector3::from(self.place).into();
        Object {
            mesh: Arc::new(self.mesh),
            material: self.look.material(seed),
            world_from_object: Similarity3::from_parts(place, rotation, 1.0),
        }
    }
}

/// A large soft light from the upper left.
fn window() -> Lamp {
    let centre = Vector3::new(-2.2, -2.6, 3.4);
    let out = (Vector3::new(0.0, 0.0, 0.4) - centre).normalize();
    let half_u = Vector3::z().cross(&out).normalize();
    Lamp { centre, half_u: 0.7 * half_u, half_v: 0.7 * out.cross(&half_u), radiance: [34.0, 31.0, 26.0] }
}

const QUARTER: f64 = std::f64::consts::FRAC_PI_2;

const MATT: [f32; 2] = [0.02, 0.7];
const VARNISH: [f32; 2] = [0.04, 0.3];

fn room() -> Vec<Thing> {
    let tiles = Look {
        motif: Motif::Tiles,
        count: 5,
        colours: [[120.0, 110.0, 100.0], [178.0, 150.0, 120.0], [225.0, 205.0, 180.0]],
        metres: 2.0,
        coat: [0.03, 0.45],
    };
    let bricks = Look {
        motif: Motif::Bricks,
        count: 5,
        colours: [[150.0, 70.0, 50.0], [190.0, 105.0, 80.0], [215.0, 208.0, 195.0]],
        metres: 1.8,
        coat: MATT,
    };
    let plane = || primitive::rectangle([60.0, 60.0]);
    vec![
        Thing { mesh: plane(), look: tiles, place: [0.0; 3], turn: [0.0, 0.0, 0.3] },
        Thing { mesh: plane(), look: bricks, place: [0.0, 1.5, 0.0], turn: [QUARTER, 0.0, 0.0] },
    ]
}

fn round_things() -> Vec<Thing> {
    let blue = Look {
        motif: Motif::Marble,
        count: 6,
        colours: [[40.0, 80.0, 140.0], [110.0, 150.0, 190.0], [225.0, 230.0, 235.0]],
        metres: 1.0,
        coat: VARNISH,
    };
    let orange = Look {
        motif: Motif::Stripes,
        count: 8,
        colours: [[235.0, 215.0, 170.0], [225.0, 150.0, 60.0], [190.0, 80.0, 40.0]],
        metres: 0.7,
        coat: VARNISH,
    };
    let stone = Look {
        motif: Motif::Speckles,
        count: 6,
        colours: [[70.0, 90.0, 60.0], [140.0, 155.0, 110.0], [215.0, 215.0, 180.0]],
        metres: 0.6,
        coat: MATT,
    };
    let glaze = Look {
        motif: Motif::Discs,
        count: 6,
        colours: [[30.0, 110.0, 110.0], [205.0, 180.0, 130.0], [240.0, 232.0, 210.0]],
        metres: 0.9,
        coat: VARNISH,
    };
    vec![
        Thing {
            mesh: primitive::sphere(0.42, 48),
            look: blue,
            place: [-0.52, -0.25, 0.42],
            turn: [0.3, 0.0, 0.0],
        },
        Thing {
            mesh: primitive::sphere(0.22, 32),
            look: orange,
            place: [0.12, -0.85, 0.22],
            turn: [0.5, 0.0, 0.4],
        },
        Thing { mesh: primitive::sphere(0.2, 32), look: stone, place: [0.72, 0.1, 0.9], turn: [0.0; 3] },
        Thing { mesh: jar(), look: glaze, place: [-0.02, 0.55, 0.0], turn: [0.0; 3] },
    ]
}

/// A jar 1 metre high, with a foot, a belly and a neck: a surface of revolution about z.
fn jar() -> Mesh {
    let profile = [
        [0.0, 0.0],
        [0.17, 0.0],
        [0.18, 0.03],
        [0.24, 0.18],
        [0.29, 0.36],
        [0.3, 0.5],
        [0.27, 0.66],
        [0.2, 0.8],
        [0.15, 0.88],
        [0.16, 0.96],
        [0.2, 1.0],
        [0.0, 1.0],
    ];
    primitive::lathe(&profile, 64)
}

fn square_things() -> Vec<Thing> {
    let wood = Look {
        motif: Motif::Wood,
        count: 8,
        colours: [[92.0, 58.0, 32.0], [160.0, 112.0, 66.0], [205.0, 165.0, 115.0]],
        metres: 0.8,
        coat: MATT,
    };
    let print = Look {
        motif: Motif::Glyphs,
        count: 4,
        colours: [[50.0, 20.0, 30.0], [190.0, 60.0, 60.0], [240.0, 225.0, 195.0]],
        metres: 0.6,
        coat: MATT,
    };
    let painting = Look {
        motif: Motif::Clouds,
        count: 4,
        colours: [[90.0, 40.0, 100.0], [215.0, 150.0, 60.0], [245.0, 225.0, 160.0]],
        metres: 1.2,
        coat: MATT,
    };
    let tilt = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.35)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), QUARTER - 0.2);
    let block = |[x, y, z]: [f32; 3]| primitive::rounded_cuboid([x, y, z], 0.012, 3);
    vec![
        Thing { mesh: block([0.64, 0.6, 0.7]), look: wood, place: [0.72, 0.1, 0.35], turn: [0.0, 0.0, 0.45] },
        Thing {
            mesh: block([0.4, 0.24, 0.2]),
            look: print,
            place: [-0.35, -0.98, 0.1],
            turn: [0.0, 0.0, -0.5],
        },
        Thing {
            mesh: block([0.84, 1.12, 0.04]),
            look: painting,
            place: [-1.05, 0.75, 0.56],
            turn: tilt.scaled_axis().into(),
        },
    ]
}
