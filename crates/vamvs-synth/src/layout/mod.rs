//! Stages: random arrangements of objects and lights, one module per style.

mod clutter;
mod facade;
mod focus;
mod light;
mod physics;
mod room;
mod set;
mod street;
mod terrain;
mod turntable;

pub use focus::Focus;

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::assets::{AssetError, Assets};
use crate::{Object, World};
use set::Set;

/// A kind of scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Style {
    /// A pile of things on the ground, sometimes in a box or in front of walls (the paper's section 4.1).
    Clutter,
    /// One to three things on a table.
    Turntable,
    /// A wall with windows, ledges and columns.
    Facade,
    /// Bumpy ground seen from above.
    Terrain,
    /// A corner of a room with furniture, seen from inside.
    Room,
    /// Houses, trees, wires and monuments against the sky.
    Street,
}

impl Style {
    /// All styles.
    pub const ALL: [Self; 6] =
        [Self::Clutter, Self::Turntable, Self::Facade, Self::Terrain, Self::Room, Self::Street];

    /// The name that users write.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Clutter => "clutter",
            Self::Turntable => "turntable",
            Self::Facade => "facade",
            Self::Terrain => "terrain",
            Self::Room => "room",
            Self::Street => "street",
        }
    }
}

/// A world and the focus of its cameras.
#[derive(Clone, Debug)]
pub struct Stage {
    /// All objects and lights.
    pub world: World,
    /// What cameras should see, and from which directions.
    pub focus: Focus,
}

/// A stage without lights.
struct Layout {
    objects: Vec<Object>,
    focus: Focus,
}

/// Makes a stage. Equal assets and random numbers give bit-identical stages.
///
/// # Errors
/// If an asset file cannot be read. Files are read when they are needed.
pub fn stage(style: Style, assets: &Assets, rng: &mut Pcg64) -> Result<Stage, AssetError> {
    let environment = light::environment(style, assets, rng)?;
    let set = Set::new(assets, rng);
    let Layout { objects, focus } = match style {
        Style::Clutter => clutter::build(set),
        Style::Turntable => turntable::build(set),
        Style::Facade => facade::build(set),
        Style::Terrain => terrain::build(set),
        Style::Room => room::build(set),
        Style::Street => street::build(set),
    }?;
    let lamps = light::lamps(&focus, rng);
    Ok(Stage { world: World { objects, environment, lamps }, focus })
}

#[cfg(test)]
mod tests;
