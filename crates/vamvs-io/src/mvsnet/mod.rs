//! MVSNet's layout: `cams/STEM_cam.txt`, an image folder, and `pair.txt`.

pub mod cam;
pub mod pair;
mod scene;

pub use cam::{Cam, DepthLine, Options, PixelCentre, read_cam, write_cam};
pub use pair::{Pairs, read_pairs, write_pairs};
pub use scene::{read_scene, view_ids};
