//! Pure multi-view geometry: cameras, scenes, view selection, depth, neighbours, clouds.
//!
//! This crate reads no files and holds no tensors. Its conventions are those of `CONVENTIONS.md`:
//! transforms are named `dst_from_src` and points `x_in_frame`; a camera looks along +z with x to
//! the right and y down; depth is z in the camera's frame; an image spans `[0, W] × [0, H]` and the
//! centre of pixel `(i, j)` is `(i + 0.5, j + 0.5)`.

pub mod camera;
pub mod cloud;
pub mod depth_map;
pub mod depth_range;
pub mod face;
pub mod grid;
pub mod homography;
pub mod intrinsics;
pub mod lens;
pub mod lift;
pub mod mesh;
pub mod monotone;
pub mod occlusion;
pub mod part;
pub mod photo;
pub mod planes;
pub mod pose;
pub mod roi;
pub mod scene;
pub mod seen_points;
pub mod similarity;
pub mod undistort;
pub mod view_selection;
pub mod visibility;
mod wide;
pub mod window_knn;

pub use camera::{Camera, Pinhole};
pub use cloud::{Cloud, CloudPoint};
pub use depth_map::DepthMap;
pub use depth_range::DepthRange;
pub use grid::{Grid, Size};
pub use intrinsics::Intrinsics;
pub use lens::Lens;
pub use mesh::Mesh;
pub use monotone::MonotoneMap;
pub use part::Part;
pub use photo::{Photo, Rgb};
pub use planes::{Planes, Spacing};
pub use pose::Pose;
pub use roi::Roi;
pub use scene::{Scene, SceneError, Source, SparsePoint, View};
pub use seen_points::SeenPoints;
pub use similarity::Similarity;
pub use visibility::Visibility;
