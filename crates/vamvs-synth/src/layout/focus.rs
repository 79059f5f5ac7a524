//! Where cameras should look, and from where.

use nalgebra::Vector3;

/// Where cameras should look, and from where: a ball and a cone of directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// Centre of what is to be seen, in the world, metres.
    pub centre: Vector3<f64>,
    /// Radius of the ball around the centre that holds what is to be seen, metres.
    pub radius: f64,
    /// Unit vector from the centre to where a camera sees it best.
    pub axis: Vector3<f64>,
    /// Largest angle between the axis and the direction to a camera, radians.
    pub spread: f64,
    /// Least angle of the direction to a camera above the horizon, radians; may be negative.
    pub lowest: f64,
}

impl Focus {
    /// Whether a camera may stand in this direction (a unit vector) from the centre.
    #[must_use]
    pub fn admits(&self, direction: &Vector3<f64>) -> bool {
        direction.dot(&self.axis) >= self.spread.cos() && direction.z >= self.lowest.sin()
    }
}
