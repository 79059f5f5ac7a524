//! Physics: rigid bodies that fall onto fixed things and come to rest.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::dynamics::{RigidBodyBuilder, RigidBodyHandle};
use rapier3d::geometry::{Collider, ColliderBuilder, SharedShape};
use rapier3d::math::{Pose, Rotation, Vector};
use rapier3d::pipeline::PhysicsWorld;

use crate::solid::Solid;

/// Units of the physics engine per metre. Its collision detection is inexact for things much smaller than 1.
const UNITS: f32 = 10.0;

/// Time steps per second. Short steps keep small things from sinking into each other.
const STEPS_PER_SECOND: usize = 240;

/// Steps from one dropped thing to the next.
const STEPS_PER_DROP: usize = 60;

/// Largest number of steps after the last drop, for all things to come to rest.
const STEPS_TO_REST: usize = 3 * STEPS_PER_SECOND;

/// How many of the last [`STEPS_TO_REST`] are strongly damped.
const DAMPED_STEPS: usize = STEPS_PER_SECOND;

/// Frequency of the springs that push overlapping things apart, hertz.
const HARDNESS: f32 = 100.0;

/// Height from which things are dropped, above the bounding boxes beneath them, metres.
const DROP_HEIGHT: f32 = 0.02;

/// Things below this height (metres) have fallen off the ground.
const ABYSS: f32 = -0.2;

/// A world of fixed and falling things; z is up.
pub(super) struct Physics {
    world: PhysicsWorld,
    bodies: Vec<RigidBodyHandle>,
}

impl Physics {
    /// An empty world.
    pub fn new() -> Self {
        let mut world = PhysicsWorld { gravity: Vector::Z * (-9.81 * UNITS), ..Default::default() };
        let parameters = &mut world.integration_parameters;
        parameters.dt = 1.0 / STEPS_PER_SECOND as f32;
        // Things may overlap by a tenth of a millimetre.
        parameters.normalized_allowed_linear_error = 1e-4 * UNITS;
        parameters.contact_softness.natural_frequency = HARDNESS;
        parameters.static_contact_softness.natural_frequency = HARDNESS;
        parameters.num_solver_iterations = 8;
        // Contacts are always recomputed: those kept for things that hardly moved can be off by millimetres,
        // and then things sink into each other.
        parameters.contact_recycling = false;
        Self { world, bodies: Vec::new() }
    }

    /// Adds an immovable box with sides of `size` (metres) around `centre`, turned about z by `yaw` (radians).
    pub fn fix(&mut self, size: [f64; 3], centre: &Vector3<f64>, yaw: f64) {
        let half = size.map(|side| 0.5 * side as f32 * UNITS);
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let pose = pose(&Isometry3::from_parts(Translation3::from(*centre), rotation));
        let collider = ColliderBuilder::cuboid(half[0], half[1], half[2]).position(pose).friction(0.8);
        self.world.insert_collider(collider, None);
    }

    /// Drops `solid`, scaled by `scale` and turned by `rotation`, onto whatever lies at `place` (x, y), and
    /// simulates [`STEPS_PER_DROP`] steps.
    pub fn drop(&mut self, solid: &Solid, scale: f64, rotation: &UnitQuaternion<f64>, place: [f64; 2]) {
        let colliders = colliders(solid, scale as f32 * UNITS);
        let mut start = pose(&Isometry3::from_parts(Translation3::new(place[0], place[1], 0.0), *rotation));
        start.translation.z = self.clear_height(&colliders, &start) + DROP_HEIGHT * UNITS;
        let body = RigidBodyBuilder::dynamic()
            .pose(start)
            .linear_damping(0.5)
            .angular_damping(1.5)
            .ccd_enabled(true);
        let body = self.world.insert_body(body);
        for collider in colliders {
            self.world.insert_collider(collider, Some(body));
        }
        self.bodies.push(body);
        self.run(STEPS_PER_DROP);
    }

    /// The lowest z, in engine units, at which the bounding boxes of `colliders` at `pose` are above all others
    /// that they overlap in x and y; 0 if there are none.
    fn clear_height(&self, colliders: &[Collider], pose: &Pose) -> f32 {
        let falling: Vec<_> = colliders.iter().map(|c| c.shape().compute_aabb(pose)).collect();
        let mut height = f32::NEG_INFINITY;
        for (_, fixed) in self.world.colliders.iter() {
            let beneath = fixed.compute_aabb();
            for own in &falling {
                let apart =
                    |axis: usize| own.maxs[axis] < beneath.mins[axis] || own.mins[axis] > beneath.maxs[axis];
                if !apart(0) && !apart(1) {
                    height = height.max(beneath.maxs.z - own.mins.z);
                }
            }
        }
        if height.is_finite() { height } else { 0.0 }
    }

    /// Simulates until all things are at rest, or for [`STEPS_TO_REST`] steps. Returns `world_from_solid` of each
    /// thing in the order of dropping, in metres and without its scale; `None` for those that fell off the ground.
    pub fn settle(mut self) -> Vec<Option<Isometry3<f64>>> {
        self.rest();
        self.places()
    }

    fn rest(&mut self) {
        for step in 0..STEPS_TO_REST {
            if self.is_at_rest() {
                return;
            }
            if step + DAMPED_STEPS == STEPS_TO_REST {
                self.damp();
            }
            self.world.step();
        }
    }

    fn places(&self) -> Vec<Option<Isometry3<f64>>> {
        self.bodies.iter().map(|&body| resting_place(self.world.bodies[body].position())).collect()
    }

    fn run(&mut self, steps: usize) {
        for _ in 0..steps {
            self.world.step();
        }
    }

    fn is_at_rest(&self) -> bool {
        self.bodies.iter().all(|&body| {
            let body = &self.world.bodies[body];
            body.is_sleeping() || body.translation().z < ABYSS * UNITS
        })
    }

    /// Damps all motion strongly, so that things that still roll or rock stop.
    fn damp(&mut self) {
        for &body in &self.bodies {
            let body = &mut self.world.bodies[body];
            body.set_linear_damping(20.0);
            body.set_angular_damping(40.0);
        }
    }
}

/// One collider per piece. Pieces without volume are left out.
fn colliders(solid: &Solid, scale: f32) -> Vec<Collider> {
    let collider = |piece: &Vec<[f32; 3]>| {
        let points: Vec<Vector> = piece.iter().map(|&point| Vector::from(point) * scale).collect();
        let shape = SharedShape::convex_hull(&points)?;
        Some(ColliderBuilder::new(shape).friction(0.8).build())
    };
    solid.pieces.iter().filter_map(collider).collect()
}

fn resting_place(pose: &Pose) -> Option<Isometry3<f64>> {
    if pose.translation.z < ABYSS * UNITS {
        return None;
    }
    let (t, q) = (pose.translation.as_dvec3() / f64::from(UNITS), pose.rotation.as_dquat());
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z));
    Some(Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), rotation))
}

fn pose(isometry: &Isometry3<f64>) -> Pose {
    let (t, q) = (isometry.translation.cast::<f32>(), isometry.rotation.cast::<f32>());
    Pose::from_parts(UNITS * Vector::new(t.x, t.y, t.z), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{cuboid, sphere};

    fn on_ground() -> Physics {
        let mut physics = Physics::new();
        physics.fix([2.0, 2.0, 1.0], &Vector3::new(0.0, 0.0, -0.5), 0.0);
        physics
    }

    #[test]
    fn boxes_come_to_lie_on_a_face_and_stack() {
        let mut physics = on_ground();
        let slab = Solid::of(&[&cuboid([0.1, 0.12, 0.04])]);
        let tilt = UnitQuaternion::from_euler_angles(0.2, 0.1, 1.0);
        physics.drop(&slab, 1.0, &tilt, [0.1, 0.0]);
        physics.drop(&slab, 0.5, &UnitQuaternion::identity(), [0.1, 0.0]);
        let places = physics.settle();
        let heights = [0, 1].map(|i| places[i].unwrap().translation.z);
        assert!((heights[0] - 0.02).abs() < 5e-4, "{heights:?}");
        assert!((heights[1] - 0.05).abs() < 5e-4, "{heights:?}");
        let up = places[0].unwrap() * Vector3::z();
        assert!(up.z.abs() > 0.9999, "{up:?}");
    }

    #[test]
    fn what_has_settled_stays() {
        let mut physics = on_ground();
        let box_of = |size| Solid::of(&[&cuboid(size)]);
        let solids = [box_of([0.1, 0.05, 0.03]), Solid::of(&[&sphere(0.03, 24)]), box_of([0.04, 0.04, 0.15])];
        for index in 0..9 {
            let turn = UnitQuaternion::from_euler_angles(0.7 * f64::from(index), 0.3, 0.0);
            physics.drop(&solids[index as usize % 3], 1.0, &turn, [0.01 * f64::from(index), 0.0]);
        }
        physics.rest();
        let before = physics.places();
        physics.run(STEPS_PER_SECOND / 2);
        for (before, after) in before.iter().zip(physics.places()) {
            let moved = (before.unwrap().translation.vector - after.unwrap().translation.vector).norm();
            assert!(moved < 2e-4, "{moved} m in half a second");
        }
    }

    #[test]
    fn balls_stop_rolling() {
        let mut physics = on_ground();
        let ball = Solid::of(&[&sphere(0.05, 32)]);
        for place in [[0.0, 0.0], [0.02, 0.01], [0.01, -0.02]] {
            physics.drop(&ball, 1.0, &UnitQuaternion::identity(), place);
        }
        for place in physics.settle() {
            let centre = place.unwrap().translation.vector;
            assert!((centre.z - 0.05).abs() < 1e-3 && centre.xy().norm() < 0.5, "{centre:?}");
        }
    }

    #[test]
    fn what_falls_off_the_ground_is_gone() {
        let mut physics = on_ground();
        let ball = Solid::of(&[&sphere(0.05, 8)]);
        physics.drop(&ball, 1.0, &UnitQuaternion::identity(), [3.0, 0.0]);
        physics.drop(&ball, 1.0, &UnitQuaternion::identity(), [0.0, 0.0]);
        let places = physics.settle();
        assert!(places[0].is_none() && places[1].is_some());
    }
}
