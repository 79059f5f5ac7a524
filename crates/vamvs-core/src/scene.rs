//! A set of photographs with known cameras, as a reader finds it.

use nalgebra::Vector3;

use crate::{Camera, DepthRange, Pose};

/// One photograph's name, camera and pose.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The number by which the scene's files know the view (COLMAP image id, MVSNet view number).
    pub id: u32,
    /// The image file's path relative to the image folder, with `/` between folders.
    pub name: String,
    /// The camera as calibrated.
    pub camera: Camera,
    /// The pose.
    pub cam_from_world: Pose,
    /// The depth range that the scene's files give for this view.
    pub depth_range: Option<DepthRange>,
}

/// A triangulated point and the views that saw it.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsePoint {
    /// Position.
    pub x_in_world: Vector3<f64>,
    /// Indices into [`Scene::views`], each once.
    pub views: Vec<usize>,
}

/// Another view that shows a view's surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Index into [`Scene::views`].
    pub view: usize,
    /// How much it helps; only the ratios to the scores of the same view's other sources mean something.
    pub score: f64,
}

/// Photographs with known cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The views.
    pub views: Vec<View>,
    /// Triangulated points; empty if the scene's files have none.
    pub points: Vec<SparsePoint>,
    /// For each view, its source views, best first, if the scene's files say.
    pub pairs: Option<Vec<Vec<Source>>>,
}
