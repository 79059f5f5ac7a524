//! A triangle mesh of depth maps.
//!
//! Views are given to a [`Mesher`] one by one. It integrates them in a signed distance (Curless and Levoy, "A volumetric
//! method for building complex models from range images") at the corners of an octree's cells, each place as fine as the
//! finest pixel that sees it, and takes the surface where it is zero (dual contouring), without cracks between cells of
//! different sizes. What a view says counts by the inverse variance of its depth; what views see through is carved away;
//! what none sees stays open.
//!
//! The mesh does not depend on the number of threads. This crate reads and writes no files.

mod bricks;
mod components;
mod field;
mod gaps;
mod manifold;
mod patches;
mod pixel;
mod rays;
mod sets;
mod simplify;
mod surface;
mod view;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vamvs_core::{Grid, Mesh, Pinhole, Pose, Rgb, Size};

use bricks::Bricks;
use field::Field;
use view::SeenView;

/// A surface is near within this distance, in cells of the width that is asked for: they are up to √2 times as wide.
const NEAR: f32 = 1.5;

/// Bytes that a brick takes on average: distances, vertices, triangles, and what makes them a manifold.
const BRICK_BYTES: u64 = 8000;

/// By how much cells are larger where the volume takes too much memory...
const LARGER: f64 = 1.25;

/// ... but not larger than this, in sizes of a pixel.
const LARGEST_CELL: f64 = 64.0;

/// The smallest cells, in sizes of a pixel.
const SMALLEST_CELL: f64 = 0.25;

/// How a mesh is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct MeshOptions {
    /// The width of a cell, in sizes of the finest pixel that sees a place.
    pub cell: f64,
    /// Pieces of fewer triangles are left out.
    pub min_triangles: usize,
    /// The mesh is reduced to this number of triangles or, below 1, this share of them.
    pub triangles: Option<f64>,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self { cell: 1.5, min_triangles: 100, triangles: None }
    }
}

/// Makes a mesh of views.
pub struct Mesher {
    options: MeshOptions,
    views: Vec<SeenView>,
}

impl Mesher {
    /// A mesher without views.
    ///
    /// # Errors
    /// If an option is out of its range.
    pub fn new(options: MeshOptions) -> Result<Self, MeshError> {
        if !(SMALLEST_CELL..=LARGEST_CELL).contains(&options.cell) {
            return Err(MeshError::Option {
                name: "cell",
                expected: "0.25 to 64 sizes of a pixel",
                found: options.cell,
            });
        }
        if let Some(found) = options.triangles.filter(|triangles| *triangles <= 0.0 || triangles.is_nan()) {
            let expected = "a number of triangles, or a share of them below 1";
            return Err(MeshError::Option { name: "triangles", expected, found });
        }
        Ok(Self { options, views: Vec::new() })
    }

    /// Adds a view: takes eleven bytes for each of its pixels.
    ///
    /// # Errors
    /// If a raster has another size than the camera.
    pub fn add(&mut self, view: MeshView) -> Result<(), MeshError> {
        self.views.push(SeenView::new(self.views.len(), view)?);
        Ok(())
    }

    /// The volume around all that the views see, with cells as the options say or, where it would then take more than `memory`
    /// bytes with the views, with larger ones.
    #[must_use]
    pub fn volume(&self, memory: u64) -> Volume<'_> {
        let views: usize = self.views.iter().map(SeenView::bytes).sum();
        let left = memory.saturating_sub(views as u64);
        let mut cell = self.options.cell;
        let points = bricks::points(&self.views, cell);
        loop {
            let bricks = Bricks::around(&points, cell);
            if bricks.all.len() as u64 * BRICK_BYTES <= left || cell >= LARGEST_CELL {
                return Volume { mesher: self, bricks, cell };
            }
            cell *= LARGER;
        }
    }

    /// The colour of a place on the surface: the mean over the views, mostly of those that see it with the most pixels.
    fn colour(&self, x_in_world: &Vector3<f64>) -> Rgb {
        let mut sum = (Vector3::zeros(), f32::MIN_POSITIVE);
        for view in &self.views {
            if let Some((colour, weight)) = view.colour(&view.cam_from_world.transform(x_in_world)) {
                sum = (sum.0 + colour * weight, sum.1 + weight);
            }
        }
        (sum.0 / sum.1).map(|value| value.round() as u8).into()
    }
}

/// The volume that a surface is looked for in.
pub struct Volume<'a> {
    mesher: &'a Mesher,
    bricks: Bricks,
    cell: f64,
}

impl Volume<'_> {
    /// The width of its cells, in sizes of the finest pixel that sees a place.
    #[must_use]
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// The mesh of all views. It has no triangles if none of them sees anything.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        let Self { mesher, bricks, cell } = self;
        let surface = surface::extract(&Field::of(bricks, &mesher.views, NEAR * *cell as f32));
        let origin = bricks.x_in_world(&surface.positions.first().copied().unwrap_or_default());
        let relative = |position: &Vector3<f64>| (bricks.x_in_world(position) - origin).cast::<f32>().into();
        let mut mesh = Mesh {
            origin: origin.into(),
            positions: surface.positions.par_iter().map(relative).collect(),
            triangles: surface.triangles,
            ..Mesh::default()
        };
        manifold::separate(&mut mesh);
        components::remove_small(&mut mesh, mesher.options.min_triangles);
        if let Some(triangles) = mesher.options.triangles {
            let all = mesh.triangles.len();
            let wanted = if triangles < 1.0 { triangles * all as f64 } else { triangles };
            simplify::reduce(&mut mesh, wanted as usize);
            manifold::separate(&mut mesh);
        }
        mesh.set_normals();
        let vertices = 0..mesh.positions.len() as u32;
        mesh.colours =
            vertices.into_par_iter().map(|vertex| mesher.colour(&mesh.x_in_world(vertex))).collect();
        mesh
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
