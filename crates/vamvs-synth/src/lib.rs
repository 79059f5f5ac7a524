//! Path-traced synthetic scenes with exact depth and visibility, to train and test multi-view stereo with
//! (section 4.1 of the paper).
//!
//! The renderer is always there; whole scenes (things that fall onto each other, rooms, streets, camera rigs, assets in
//! files) are the feature `scenes`, which brings a physics engine.

#[cfg(feature = "scenes")]
pub mod assets;
mod colour;
mod denoise;
pub mod develop;
#[cfg(feature = "scenes")]
pub mod error;
mod geometry;
mod ground_truth;
#[cfg(feature = "scenes")]
pub mod job;
#[cfg(feature = "scenes")]
pub mod layout;
mod light;
pub mod material;
pub mod mesh;
mod noise;
#[cfg(feature = "scenes")]
mod overlap;
mod path;
pub mod pattern;
mod pixel;
pub mod primitive;
mod random;
#[cfg(feature = "scenes")]
pub mod recipe;
mod render;
#[cfg(feature = "scenes")]
pub mod rig;
mod sampler;
#[cfg(feature = "scenes")]
pub mod scene_folder;
#[cfg(feature = "scenes")]
mod sheet;
mod smoothing;
#[cfg(feature = "scenes")]
mod solid;
mod surface;
pub mod tracer;
mod visibility;
pub mod world;

#[cfg(feature = "scenes")]
pub use assets::{AssetError, AssetFilter, AssetFolders, Assets};
pub use develop::Effects;
#[cfg(feature = "scenes")]
pub use error::SynthError;
#[cfg(feature = "scenes")]
pub use job::{SynthEvent, SynthJob, SynthOptions, SynthSummary};
#[cfg(feature = "scenes")]
pub use layout::{Focus, Stage, Style, stage};
pub use material::Material;
pub use mesh::Mesh;
#[cfg(feature = "scenes")]
pub use recipe::Recipe;
#[cfg(feature = "scenes")]
pub use rig::{Rig, RigOptions, Station};
#[cfg(feature = "scenes")]
pub use scene_folder::SceneFolder;
pub use tracer::{GroundTruth, Hit, RenderOptions, Shot, Tracer};
pub use world::{Environment, Lamp, Object, World};
