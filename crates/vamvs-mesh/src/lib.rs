//! A triangle mesh of depth maps.
//!
//! A [`Mesher`] integrates views in a signed distance (Curless and Levoy, "A volumetric
//! method for building complex models from range images") at the corners of an octree's cells, each place as fine as the
//! finest pixel that sees it, and takes the surface where it is zero (dual contouring), without cracks between cells of
//! different sizes. What a view says counts by the inverse variance of its depth; what views see through is carved away;
//! what none sees stays open.
//!
//! The volume is laid out around what all views see in short ([`Outline`]), and worked on block by block, each with the views
//! that may see it, so memory does not grow with the number of views; processes can share the blocks. The mesh depends neither
//! on the number of threads nor on the memory, unless that is too little for cells of the size that was asked for.
//! This crate reads and writes no files.

mod assembly;
mod band;
mod bricks;
mod components;
mod field;
mod gaps;
mod holes;
mod manifold;
mod mesher;
mod opinion;
mod outline;
mod patches;
mod pixel;
mod rays;
mod sets;
mod sight;
mod simplify;
mod stock;
mod surface;
mod view;
mod volume;

use serde::{Deserialize, Serialize};
use vamvs_core::{Grid, Pinhole, Pose, Rgb, Size};

pub use assembly::{Assembly, BlockSurface};
pub use mesher::Mesher;
pub use outline::Outline;
pub use simplify::reduce_to_show;
pub use volume::{Block, Volume};

use volume::LARGEST_CELL;

/// The smallest cells, in sizes of a pixel.
const SMALLEST_CELL: f64 = 0.25;

/// The most edges of a hole that is closed: the time grows with their third power, the memory with their second.
const MOST_EDGES: usize = 1000;

/// How a mesh is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct MeshOptions {
    /// The width of a cell, in sizes of the finest pixel that sees a place.
    pub cell: f64,
    /// Pieces of fewer triangles are left out.
    pub min_triangles: usize,
    /// Holes with at most so many edges around are closed, unless a view sees through them.
    pub close_holes: usize,
    /// The mesh is reduced to this number of triangles or, below 1, this share of them.
    pub triangles: Option<f64>,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self { cell: 1.5, min_triangles: 100, close_holes: 30, triangles: None }
    }
}

impl MeshOptions {
    /// Checks the options.
    ///
    /// # Errors
    /// If one is out of its range.
    pub fn validate(&self) -> Result<(), MeshError> {
        if !(SMALLEST_CELL..=LARGEST_CELL).contains(&self.cell) {
            let expected = "0.25 to 64 sizes of a pixel";
            return Err(MeshError::Option { name: "cell", expected, found: self.cell });
        }
        if self.close_holes > MOST_EDGES {
            let expected = "at most 1000 edges";
            return Err(MeshError::Option { name: "close-holes", expected, found: self.close_holes as f64 });
        }
        if let Some(found) = self.triangles.filter(|triangles| *triangles <= 0.0 || triangles.is_nan()) {
            let expected = "a number of triangles, or a share of them below 1";
            return Err(MeshError::Option { name: "triangles", expected, found });
        }
        Ok(())
    }
}

/// A view to mesh. All rasters have the camera's size.
#[derive(Clone, Debug)]
pub struct MeshView {
    /// The camera.
    pub camera: Pinhole,
    /// The pose.
    pub cam_from_world: Pose,
    /// Depths, scene units; 0 where there is none.
    pub depth: Grid<f32>,
    /// Whether other views confirm a depth; `None` if all are confirmed. Other depths are not used: small gaps between
    /// confirmed ones of a surface are filled.
    pub confirmed: Option<Grid<bool>>,
    /// Standard deviations of the depths, scene units, 0 where they are not known; `None` if there are none.
    pub sigma: Option<Grid<f32>>,
    /// Unit normals in the world's frame, towards the camera, 0 where there is none; `None` to derive them from the depths.
    pub normals: Option<Grid<[f32; 3]>>,
    /// The photograph's colours.
    pub colour: Grid<Rgb>,
}

impl MeshView {
    fn check(&self, view: usize) -> Result<(), MeshError> {
        let expected = self.camera.size;
        let parts = [
            ("a depth map", Some(self.depth.size())),
            ("a map of confirmed pixels", self.confirmed.as_ref().map(Grid::size)),
            ("a map of standard deviations", self.sigma.as_ref().map(Grid::size)),
            ("a map of normals", self.normals.as_ref().map(Grid::size)),
            ("a colour image", Some(self.colour.size())),
        ];
        let wrong = parts
            .into_iter()
            .find_map(|(what, found)| Some((what, found.filter(|found| *found != expected)?)));
        wrong.map_or(Ok(()), |(what, found)| Err(MeshError::Size { view, what, expected, found }))
    }
}

/// Why there is no mesh.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// A raster has another size than its camera.
    #[error("view {view}: expected {what} of {expected} pixels, found {found}")]
    Size {
        /// The view's number.
        view: usize,
        /// The raster.
        what: &'static str,
        /// The camera's size.
        expected: Size,
        /// The raster's size.
        found: Size,
    },
    /// An option is out of its range.
    #[error("{name}: expected {expected}, found {found}")]
    Option {
        /// The option.
        name: &'static str,
        /// Its range.
        expected: &'static str,
        /// Its value.
        found: f64,
    },
}
