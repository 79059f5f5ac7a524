//! Path-traced synthetic scenes with exact depth and visibility, to train and test multi-view stereo with
//! (section 4.1 of the paper).

pub mod assets;
mod colour;
mod denoise;
pub mod develop;
pub mod error;
mod geometry;
mod ground_truth;
pub mod job;
pub mod layout;
mod light;
pub mod material;
pub mod mesh;
mod noise;
mod overlap;
mod path;
pub mod pattern;
mod pixel;
pub mod primitive;
mod random;
pub mod recipe;
mod render;
pub mod rig;
mod sampler;
pub mod scene_folder;
mod sheet;
mod smoothing;
mod solid;
mod surface;
pub mod tracer;
mod visibility;
pub mod world;

pub use assets::{AssetError, AssetFilter, AssetFolders, Assets};
pub use develop::Effects;
pub use error::SynthError;
pub use job::{SynthEvent, SynthJob, SynthOptions, SynthSummary};
pub use layout::{Focus, Stage, Style, stage};
pub use material::Material;
pub use mesh::Mesh;
pub use recipe::Recipe;
pub use rig::{Rig, RigOptions, Station};
pub use scene_folder::SceneFolder;
pub use tracer::{GroundTruth, Hit, RenderOptions, Shot, Tracer};
pub use world::{Environment, Lamp, Object, World};
