//! Procedural textures: a pattern of two colours under strong multi-octave grain.

use nalgebra::Vector3;

use crate::noise::{fractal, lattice, lerp, value};

/// What is drawn beneath the grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Veins that wind through the solid, `vein` apart.
    Marble {
        /// Distance of the veins.
        vein: f64,
    },
    /// Bricks of differing shades in mortar of the second colour.
    Bricks {
        /// Width and height of a brick.
        size: [f64; 2],
    },
    /// Squares of both colours in turn.
    Checker {
        /// Side of a square.
        side: f64,
    },
    /// Stripes of both colours in turn, along the second surface coordinate.
    Stripes {
        /// Width of a stripe.
        width: f64,
    },
}

/// The colour of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texture {
    /// What is drawn.
    pub pattern: Pattern,
    /// The pattern's two colours: linear red, green, blue reflectance, about 0.05 to 0.8.
    pub colours: [Vector3<f64>; 2],
    /// The coarsest wavelength of the grain.
    pub grain: f64,
    /// Makes equal textures differ.
    pub seed: u32,
}

/// A place on a surface where its texture is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexturePoint {
    /// Position in the object's frame.
    pub x_in_object: Vector3<f64>,
    /// Coordinates along the surface, in units of length.
    pub uv: [f64; 2],
}

impl Texture {
    /// Linear reflectance at a place seen by a pixel that covers `footprint` units of length.
    #[must_use]
    pub fn albedo(&self, at: &TexturePoint, footprint: f64) -> Vector3<f64> {
        let blend = self.blend(at);
        let grain = 0.85 * fractal(&at.x_in_object, self.grain, footprint, self.seed);
        self.colours[0].lerp(&self.colours[1], blend) * grain.exp()
    }

    /// The pattern's share of the second colour, in [0, 1].
    fn blend(&self, at: &TexturePoint) -> f64 {
        let [u, v] = at.uv;
        match self.pattern {
            Pattern::Marble { vein } => self.marble(&(at.x_in_object / vein)),
            Pattern::Bricks { size: [w, h] } => self.bricks(u / w, v / h, 0.07 * h / w, 0.07),
            Pattern::Checker { side } => self.checker(u / side, v / side),
            Pattern::Stripes { width } => self.checker(0.0, v / width),
        }
    }

    fn marble(&self, x: &Vector3<f64>) -> f64 {
        let bend = 2.5 * value(&(x * 0.7), self.seed ^ 1) + 1.2 * value(&(x * 1.9), self.seed ^ 2);
        0.5 + 0.5 * (x.x + x.y + 0.6 * x.z + bend).sin()
    }

    /// Coordinates in bricks; `joint` is the mortar's half width in the same unit.
    fn bricks(&self, u: f64, v: f64, joint_u: f64, joint_v: f64) -> f64 {
        let u = u + 0.5 * v.floor().rem_euclid(2.0);
        let to_edge = |t: f64| (t - t.round()).abs();
        if to_edge(u) < joint_u || to_edge(v) < joint_v { 1.0 } else { 0.45 * self.shade(u, v) }
    }

    fn checker(&self, u: f64, v: f64) -> f64 {
        let parity = (u.floor() + v.floor()).rem_euclid(2.0);
        lerp(parity, self.shade(u, v), 0.2)
    }

    /// A random number in [0, 1) for the unit square at `(u, v)`.
    fn shade(&self, u: f64, v: f64) -> f64 {
        lattice([u.floor() as i32, v.floor() as i32, 0], self.seed ^ 3)
    }
}
