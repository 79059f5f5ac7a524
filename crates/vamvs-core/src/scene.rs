//! A set of photographs with known cameras, as read from a scene's files.

use nalgebra::Vector3;

use crate::{Camera, DepthRange, Pose};

/// One photograph's name, camera and pose.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The view's number in the scene's files (COLMAP image id, MVSNet view number).
    pub id: u32,
    /// The image file's path relative to the image folder, with `/` between folders.
    pub name: String,
    /// The camera as calibrated, lens distortion included.
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

/// A source view of some reference view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Index into [`Scene::views`].
    pub view: usize,
    /// How much the source view helps, higher is better. Only the ratios of scores of the same reference
    /// view have a meaning.
    pub score: f64,
}

/// Photographs with known cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The views.
    pub views: Vec<View>,
    /// Triangulated points; empty if the scene's files have none.
    pub points: Vec<SparsePoint>,
    /// For each view, its source views, best first; `None` if the scene's files do not list them.
    pub pairs: Option<Vec<Vec<Source>>>,
}
