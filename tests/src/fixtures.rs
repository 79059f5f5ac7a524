//! Ready-made rendered scenes.

use nalgebra::Vector3;
use vamvs_core::Size;

use crate::render::{Rendered, render};
use crate::rig::{self, Station, TARGET};
use crate::scene::{Surface, World, place};
use crate::shape::Shape;
use crate::texture::{Pattern, Texture};

/// Rays across a pixel.
const SAMPLES: usize = 3;

/// A textured plane through the cameras' target, tilted against all of them; it fills every view.
#[must_use]
pub fn tilted_plane(size: Size, views: usize) -> Vec<Rendered> {
    render_all(&plane_world(), &rig::arc(views, size))
}

/// Objects on a tiled floor before a brick wall, photographed along an arc; every pixel has a
/// surface.
#[must_use]
pub fn still_life(size: Size, views: usize) -> Vec<Rendered> {
    render_all(&still_life_world(), &rig::arc(views, size))
}

/// One picture for each station.
#[must_use]
pub fn render_all(world: &World, stations: &[Station]) -> Vec<Rendered> {
    stations.iter().map(|(camera, pose)| render(world, camera, pose, SAMPLES)).collect()
}

/// The world of [`tilted_plane`].
#[must_use]
pub fn plane_world() -> World {
    let marble = texture(Pattern::Marble { vein: 0.15 }, [[0.75, 0.62, 0.4], [0.16, 0.3, 0.42]], 0.48, 1);
    let plane = Surface {
        shape: Shape::Rectangle { half: [50.0, 50.0] },
        object_from_world: place(TARGET.into(), 0.15, 0.75),
        texture: marble,
    };
    World { surfaces: vec![plane], to_sun: sun() }
}

/// The world of [`still_life`].
#[must_use]
pub fn still_life_world() -> World {
    let mut surfaces = room();
    surfaces.extend(round_things());
    surfaces.extend(square_things());
    World { surfaces, to_sun: sun() }
}

fn room() -> Vec<Surface> {
    let tiles = texture(Pattern::Checker { side: 0.4 }, [[0.62, 0.52, 0.4], [0.34, 0.22, 0.14]], 0.56, 11);
    let bricks =
        texture(Pattern::Bricks { size: [0.42, 0.15] }, [[0.52, 0.2, 0.12], [0.7, 0.66, 0.58]], 0.56, 12);
    let wide = Shape::Rectangle { half: [30.0, 30.0] };
    vec![
        Surface { shape: wide, object_from_world: place([0.0, 0.0, 0.0], 0.3, 0.0), texture: tiles },
        Surface { shape: wide, object_from_world: place([0.0, 1.5, 0.0], 0.0, QUARTER), texture: bricks },
    ]
}

fn round_things() -> Vec<Surface> {
    let blue = texture(Pattern::Marble { vein: 0.07 }, [[0.7, 0.75, 0.8], [0.06, 0.22, 0.5]], 0.4, 21);
    let orange = texture(Pattern::Stripes { width: 0.06 }, [[0.8, 0.38, 0.08], [0.75, 0.66, 0.45]], 0.4, 22);
    let green = texture(Pattern::Marble { vein: 0.05 }, [[0.3, 0.5, 0.16], [0.62, 0.66, 0.3]], 0.32, 23);
    let jar = texture(Pattern::Checker { side: 0.09 }, [[0.1, 0.42, 0.42], [0.78, 0.72, 0.55]], 0.4, 24);
    let ball = |radius| Shape::Sphere { radius };
    let column = Shape::Cylinder { radius: 0.26, half_height: 0.5 };
    vec![
        Surface {
            shape: ball(0.42),
            object_from_world: place([-0.52, -0.25, 0.42], 0.0, 0.3),
            texture: blue,
        },
        Surface {
            shape: ball(0.22),
            object_from_world: place([0.12, -0.85, 0.22], 0.4, 0.5),
            texture: orange,
        },
        Surface { shape: ball(0.2), object_from_world: place([0.72, 0.1, 0.9], 0.0, 0.0), texture: green },
        Surface { shape: column, object_from_world: place([-0.02, 0.55, 0.5], 0.0, 0.0), texture: jar },
    ]
}

fn square_things() -> Vec<Surface> {
    let crate_wood =
        texture(Pattern::Stripes { width: 0.14 }, [[0.66, 0.44, 0.22], [0.34, 0.19, 0.08]], 0.48, 31);
    let brick = texture(Pattern::Checker { side: 0.12 }, [[0.62, 0.1, 0.14], [0.8, 0.7, 0.5]], 0.4, 32);
    let board = texture(Pattern::Marble { vein: 0.1 }, [[0.75, 0.6, 0.2], [0.42, 0.12, 0.36]], 0.4, 33);
    let cube = |x, y, z| Shape::Cuboid { half: Vector3::new(x, y, z) };
    let panel = Shape::Rectangle { half: [0.42, 0.56] };
    vec![
        Surface {
            shape: cube(0.32, 0.3, 0.35),
            object_from_world: place([0.72, 0.1, 0.35], 0.45, 0.0),
            texture: crate_wood,
        },
        Surface {
            shape: cube(0.2, 0.12, 0.1),
            object_from_world: place([-0.35, -0.98, 0.1], -0.5, 0.0),
            texture: brick,
        },
        Surface {
            shape: panel,
            object_from_world: place([-1.05, 0.75, 0.52], 0.35, QUARTER - 0.2),
            texture: board,
        },
    ]
}

const QUARTER: f64 = std::f64::consts::FRAC_PI_2;

fn sun() -> Vector3<f64> {
    Vector3::new(-0.45, -0.62, 0.78).normalize()
}

fn texture(pattern: Pattern, colours: [[f64; 3]; 2], grain: f64, seed: u32) -> Texture {
    Texture { pattern, colours: colours.map(Vector3::from), grain, seed }
}
