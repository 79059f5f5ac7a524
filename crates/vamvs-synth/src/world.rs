//! What is rendered: objects and lights. The world's z axis points up; lengths are in metres.

use std::sync::Arc;

use nalgebra::{Similarity3, Vector3};
use vamvs_core::Grid;

use crate::{Material, Mesh};

/// Objects and lights.
#[derive(Clone, Debug)]
pub struct World {
    /// Everything that has a surface.
    pub objects: Vec<Object>,
    /// Light from infinitely far.
    pub environment: Environment,
    /// Area lights.
    pub lamps: Vec<Lamp>,
}

/// A mesh in its place. Its index in [`World::objects`], plus one, is its id; 0 is the background.
#[derive(Clone, Debug)]
pub struct Object {
    /// The shape.
    pub mesh: Arc<Mesh>,
    /// What it looks like.
    pub material: Material,
    /// Where it is.
    pub world_from_object: Similarity3<f64>,
}

/// Light from infinitely far: an equirectangular map, its rows from the zenith (+z) to the nadir.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Linear radiance; one pixel makes a uniform sky.
    pub map: Arc<Grid<[f32; 3]>>,
    /// Turns the map about z, radians.
    pub rotation: f64,
    /// Factor on the radiance.
    pub strength: f32,
}

/// A rectangle that emits light on the side its normal `half_u × half_v` points to. Cameras do not see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Centre in the world.
    pub centre: Vector3<f64>,
    /// From the centre to the middle of one side.
    pub half_u: Vector3<f64>,
    /// From the centre to the middle of the next side; at a right angle to `half_u`.
    pub half_v: Vector3<f64>,
    /// Linear radiance.
    pub radiance: [f32; 3],
}
