//! The part of a stage that cameras should see, and the directions they may see it from.

use nalgebra::Vector3;

/// A ball that cameras should see, and a cone of directions that they may see it from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// Centre of the ball in the world, metres.
    pub centre: Vector3<f64>,
    /// Radius of the ball, metres.
    pub radius: f64,
    /// Axis of the cone: the unit vector from the centre towards the best place for a camera.
    pub axis: Vector3<f64>,
    /// Largest angle between the axis and the direction to a camera, radians.
    pub spread: f64,
    /// Least elevation of the direction to a camera above the horizon, radians; may be negative.
    pub lowest: f64,
}

impl Focus {
    /// Whether a camera may stand in this direction from the centre (a unit vector in the world).
    #[must_use]
    pub fn admits(&self, direction: &Vector3<f64>) -> bool {
        direction.dot(&self.axis) >= self.spread.cos() && direction.z >= self.lowest.sin()
    }
}
