//! Small worlds and cameras.

use std::sync::Arc;

use nalgebra::{Similarity3, UnitQuaternion, Vector3};
use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Rgb, Size};
use vamvs_synth::{Environment, Lamp, Material, Mesh, Object, World, primitive};

/// A perfectly matt material of one colour.
pub fn matt(colour: Rgb) -> Material {
    Material {
        albedo: Arc::new(Grid::filled(Size::new(1, 1), colour)),
        tiling: [1.0; 2],
        tint: [1.0; 3],
        specular: 0.0,
        roughness: 0.5,
    }
}

/// An object at `place`, rotated by the axis-angle vector `turn` (radians) and scaled.
pub fn object(mesh: Mesh, material: Material, place: [f64; 3], turn: [f64; 3], scale: f64) -> Object {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
    let world_from_object = Similarity3::from_parts(Vector3::from(place).into(), rotation, scale);
    Object { mesh: Arc::new(mesh), material, world_from_object }
}

/// A sky with the same radiance in all directions.
pub fn uniform_sky(radiance: f32) -> Environment {
    let map = Arc::new(Grid::filled(Size::new(1, 1), [1.0; 3]));
    Environment { map, rotation: 0.0, strength: radiance }
}

/// A square lamp of side 2 · `half` that shines downwards.
pub fn lamp(centre: [f64; 3], half: f64, radiance: f32) -> Lamp {
    Lamp {
        centre: centre.into(),
        half_u: Vector3::y() * half,
        half_v: Vector3::x() * half,
        radiance: [radiance; 3],
    }
}

pub fn world(objects: Vec<Object>, environment: Environment, lamps: Vec<Lamp>) -> World {
    World { objects, environment, lamps }
}

/// A few objects of few triangles on a floor, some in front of others. The floor is object 0.
pub fn still_life() -> Vec<Object> {
    let grey = || matt([188; 3]);
    vec![
        object(primitive::rectangle([8.0, 8.0]), grey(), [0.0; 3], [0.0; 3], 1.0),
        object(primitive::sphere(0.5, 6), grey(), [0.3, 0.2, 0.5], [0.1, 0.2, 0.3], 1.0),
        object(primitive::cuboid([0.4, 0.6, 1.0]), grey(), [-0.6, -0.3, 0.5], [0.0, 0.0, 0.7], 1.0),
        object(primitive::torus(0.4, 0.12, 12), grey(), [0.1, -0.9, 0.3], [1.2, 0.3, 0.0], 0.9),
    ]
}

/// A camera with a horizontal field of view of 60 degrees that looks from `eye` at `target`.
pub fn view(size: Size, eye: [f64; 3], target: [f64; 3]) -> (Pinhole, Pose) {
    let focal = 0.87 * size.width as f64;
    let (cx, cy) = (0.5 * size.width as f64, 0.5 * size.height as f64);
    let intrinsics = Intrinsics::try_new(focal, focal, cx, cy).unwrap();
    (Pinhole { size, intrinsics }, Pose::look_at(&eye.into(), &target.into(), &Vector3::z()))
}

/// All pixels (x, y) of an image, row by row.
pub fn pixels(size: Size) -> impl Iterator<Item = (usize, usize)> {
    (0..size.height).flat_map(move |y| (0..size.width).map(move |x| (x, y)))
}
