//! The scene that is rendered: objects and lights. The world's z axis points up; lengths are in metres.

use std::sync::Arc;

use nalgebra::{Similarity3, Vector3};
use vamvs_core::Grid;

use crate::{Material, Mesh};

/// Objects and lights.
#[derive(Clone, Debug)]
pub struct World {
    /// Everything that has a surface.
    pub objects: Vec<Object>,
    /// Light from infinitely far away.
    pub environment: Environment,
    /// Area lights.
    pub lamps: Vec<Lamp>,
}

/// A mesh placed in the world. Its index in [`World::objects`], plus one, is its id; 0 is the background.
#[derive(Clone, Debug)]
pub struct Object {
    /// The shape.
    pub mesh: Arc<Mesh>,
    /// How its surface reflects light.
    pub material: Material,
    /// Its pose and scale.
    pub world_from_object: Similarity3<f64>,
}

/// Light from infinitely far away: an equirectangular map with rows from the zenith (+z) to the nadir.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Linear radiance; a map of one pixel is a uniform sky.
    pub map: Arc<Grid<[f32; 3]>>,
    /// Rotation of the map about z, radians.
    pub rotation: f64,
    /// Factor on the radiance.
    pub strength: f32,
}

/// A rectangle that emits light on one side, the one that its normal `half_u × half_v` points to. Cameras do
/// not see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Centre in the world.
    pub centre: Vector3<f64>,
    /// Vector from the centre to the middle of one side.
    pub half_u: Vector3<f64>,
    /// Vector from the centre to the middle of the next side, perpendicular to `half_u`.
    pub half_v: Vector3<f64>,
    /// Linear radiance.
    pub radiance: [f32; 3],
}
