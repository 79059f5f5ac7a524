//! A stage under construction: fixed objects, and things that fall onto them.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Isometry3, Similarity3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::physics::Physics;
use crate::assets::{AssetError, Assets, Look, Thing};
use crate::primitive::{cuboid, rectangle};
use crate::{Material, Mesh, Object};

/// A stage under construction. Lengths are in metres, z is up.
pub(super) struct Set<'a> {
    pub assets: &'a Assets,
    pub rng: &'a mut Pcg64,
    objects: Vec<Object>,
    physics: Physics,
    falling: Vec<(Thing, f64)>,
}

/// The objects of a finished set.
pub(super) struct Finished {
    pub objects: Vec<Object>,
    /// Middle and radius of each thing that was dropped and has stayed on the set.
    pub things: Vec<(Vector3<f64>, f64)>,
}

impl<'a> Set<'a> {
    /// An empty set.
    pub fn new(assets: &'a Assets, rng: &'a mut Pcg64) -> Self {
        Self { assets, rng, objects: Vec::new(), physics: Physics::new(), falling: Vec::new() }
    }

    /// A random material for an object about `extent` metres large whose texture coordinates are in metres.
    pub fn material(&mut self, look: Look, extent: f64) -> Result<Material, AssetError> {
        self.assets.material(look, extent as f32, self.rng)
    }

    /// Places an object that things do not collide with.
    pub fn place(&mut self, mesh: Arc<Mesh>, material: &Material, world_from_object: Isometry3<f64>) {
        self.place_scaled(mesh, material, Similarity3::from_isometry(world_from_object, 1.0));
    }

    /// Adds an object that is already placed.
    pub fn add(&mut self, object: Object) {
        self.objects.push(object);
    }

    /// As [`Self::place`], with a scale.
    pub fn place_scaled(
        &mut self,
        mesh: Arc<Mesh>,
        material: &Material,
        world_from_object: Similarity3<f64>,
    ) {
        self.objects.push(Object { mesh, material: material.clone(), world_from_object });
    }

    /// Places a box with sides of `size`, turned about z by `yaw`, that things can fall onto.
    pub fn block(&mut self, size: [f64; 3], centre: &Vector3<f64>, yaw: f64, material: &Material) {
        self.support(size, centre, yaw);
        self.place(Arc::new(cuboid(size.map(|side| side as f32))), material, upright(centre, yaw));
    }

    /// Adds an invisible box that things can fall onto.
    pub fn support(&mut self, size: [f64; 3], centre: &Vector3<f64>, yaw: f64) {
        self.physics.fix(size, centre, yaw);
    }

    /// Places a level square of `side` metres around (0, 0) at height 0 that things can fall onto.
    pub fn ground(&mut self, side: f64, material: &Material) {
        self.physics.fix([side, side, 1.0], &Vector3::new(0.0, 0.0, -0.5), 0.0);
        self.place(Arc::new(rectangle([side as f32; 2])), material, Isometry3::identity());
    }

    /// Random things, made in parallel.
    pub fn things(&mut self, count: usize) -> Result<Vec<Thing>, AssetError> {
        let seeds: Vec<u64> = (0..count).map(|_| self.rng.random()).collect();
        seeds.par_iter().map(|&seed| self.assets.thing(&mut Pcg64::seed_from_u64(seed))).collect()
    }

    /// Drops a thing, turned at random and enlarged by the factor `enlarged`, with its middle above `place`
    /// (x, y).
    pub fn drop(&mut self, thing: Thing, enlarged: f64, place: [f64; 2]) {
        let rotation = random_rotation(self.rng);
        let scale = thing.scale * enlarged;
        let off = rotation * thing.middle() * scale;
        self.physics.drop(&thing.solid, scale, &rotation, [place[0] - off.x, place[1] - off.y]);
        self.falling.push((thing, scale));
    }

    /// Lets everything come to rest. Things that fell off the ground, or lie farther than `reach` (metres) from
    /// the z axis, are removed.
    pub fn finish(self, reach: f64) -> Finished {
        let mut finished = Finished { objects: self.objects, things: Vec::new() };
        for ((thing, scale), place) in self.falling.into_iter().zip(self.physics.settle()) {
            let Some(place) = place else { continue };
            let world_from_thing = Similarity3::from_isometry(place, scale);
            let middle = world_from_thing * nalgebra::Point3::from(thing.middle());
            if middle.coords.xy().norm() < reach {
                finished.things.push((middle.coords, f64::from(thing.solid.radius()) * scale));
                finished.objects.extend(thing.objects(world_from_thing));
            }
        }
        finished
    }
}

/// The pose of an object at `centre` that is turned about z by `yaw` (radians).
pub(super) fn upright(centre: &Vector3<f64>, yaw: f64) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Translation3::from(*centre), rotation)
}

/// A uniformly distributed point in the disc of `radius` around (0, 0).
pub(super) fn in_disc(radius: f64, rng: &mut Pcg64) -> [f64; 2] {
    let (distance, angle) = (radius * rng.random::<f64>().sqrt(), TAU * rng.random::<f64>());
    [distance * angle.cos(), distance * angle.sin()]
}

/// A uniformly distributed rotation (Shoemake 1992).
fn random_rotation(rng: &mut Pcg64) -> UnitQuaternion<f64> {
    let [u, a, b]: [f64; 3] = rng.random();
    let (near, far) = ((1.0 - u).sqrt(), u.sqrt());
    let (a, b) = (TAU * a, TAU * b);
    let quaternion = nalgebra::Quaternion::new(near * a.sin(), near * a.cos(), far * b.sin(), far * b.cos());
    UnitQuaternion::from_quaternion(quaternion)
}
