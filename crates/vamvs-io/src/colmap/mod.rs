//! COLMAP's sparse models, text and binary, including those of COLMAP 4, and its dense workspaces.
//!
//! A model is a folder of `cameras`, `images` and `points3D` files, `.bin` or `.txt`; if it has both, the
//! binary files are read. The `rigs` and `frames` files of COLMAP 4 are not read: the images have the poses
//! too.

mod binary;
mod camera;
pub mod dense;
mod files;
pub mod model;
mod scene;
mod seen_by;
mod text;
pub mod workspace;

pub use model::{Image, Model, Observation, Point};
pub use scene::read_scene;
pub use seen_by::SeenByWriter;
