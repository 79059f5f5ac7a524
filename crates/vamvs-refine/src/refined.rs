//! The result of a refinement.

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Pinhole, Pose};

use crate::confidence::{self, Features};
use crate::field::{Field, State};
use crate::matcher::Matcher;
use crate::plane::Plane;
use crate::segments::variance_of;

/// A depth that is surely wrong has a standard deviation of this share of it, one that is surely right that of its matching.
/// Fitted to rendered scenes.
const DOUBT: f32 = 0.015;

/// A refined depth map.
#[derive(Clone, Debug)]
pub struct Refined {
    /// Depth, and confidence in [0, 1].
    pub map: DepthMap,
    /// Unit normals in the reference camera's frame, towards the camera; zero where there is no depth.
    pub normals: Grid<[f32; 3]>,
    /// Standard deviation of the depth, at most the depth itself, scene units; 0 where there is no depth.
    pub sigma: Grid<f32>,
}

impl Refined {
    /// A map without depth.
    pub(crate) fn empty((camera, cam_from_world): (Pinhole, Pose)) -> Self {
        let nothing = || Grid::filled(camera.size, 0.0);
        let map = DepthMap {
            camera,
            cam_from_world,
            depth: nothing(),
            confidence: nothing(),
            coarse_confidence: None,
        };
        Self { map, normals: Grid::filled(camera.size, [0.0; 3]), sigma: nothing() }
    }

    /// Takes over the part `core` of a tile that covers `outer`.
    pub(crate) fn paste(&mut self, tile: &Self, core: PixelBox, outer: PixelBox) {
        for y in core.y0..core.y1 {
            let (to, from) = (core.x0..core.x1, core.x0 - outer.x0..core.x1 - outer.x0);
            let row = y - outer.y0;
            self.map.depth.row_mut(y)[to.clone()].copy_from_slice(&tile.map.depth.row(row)[from.clone()]);
            self.map.confidence.row_mut(y)[to.clone()]
                .copy_from_slice(&tile.map.confidence.row(row)[from.clone()]);
            self.sigma.row_mut(y)[to.clone()].copy_from_slice(&tile.sigma.row(row)[from.clone()]);
            self.normals.row_mut(y)[to].copy_from_slice(&tile.normals.row(row)[from]);
        }
    }

    /// The same with unit normals in the world, as `normals/NAME.pfm` holds them; zero where there is no depth.
    #[must_use]
    pub fn in_world(mut self) -> Self {
        let world_from_cam = self.map.cam_from_world.rotation.transpose().cast::<f32>();
        self.normals.data_mut().par_iter_mut().for_each(|normal| {
            *normal = (world_from_cam * Vector3::from(*normal)).into();
        });
        self
    }

    /// The depth map and normals, as input of [`crate::refine_geometric`].
    #[must_use]
    pub fn surface(&self) -> Surface<'_> {
        Surface { map: &self.map, normals: &self.normals }
    }
}

/// A depth map with normals.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// Depth, and confidence in [0, 1].
    pub map: &'a DepthMap,
    /// Unit normals in the camera's frame, towards the camera; zero where there is no depth.
    pub normals: &'a Grid<[f32; 3]>,
}

impl Surface<'_> {
    /// The plane of a pixel; w = 0 if it has no depth.
    pub(crate) fn plane(&self, x: usize, y: usize) -> Plane {
        let depth = self.map.depth[(x, y)];
        if depth <= 0.0 {
            return Plane::default();
        }
        let normal = Vector3::from(self.normals[(x, y)]).cast::<f64>();
        let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
        Plane::from_normal(&normal, f64::from(depth), &self.map.camera.intrinsics, px, py)
    }
}

/// A pixel of the result.
struct Outcome {
    depth: f32,
    confidence: f32,
    sigma: f32,
    normal: [f32; 3],
}

/// The result of a field. `seed(x, y)` gives the seed's plane and confidence at a pixel; w = 0 and 0 where it has
/// none.
pub(crate) fn refined(
    (camera, cam_from_world): (Pinhole, Pose),
    field: &Field,
    matcher: &Matcher,
    seed: impl Fn(usize, usize) -> (Plane, f32) + Sync,
) -> Refined {
    let width = field.size().width.max(1);
    let mut refined = Refined::empty((camera, cam_from_world));
    let depths = refined.map.depth.data_mut().par_chunks_exact_mut(width);
    let confidences = refined.map.confidence.data_mut().par_chunks_exact_mut(width);
    let sigmas = refined.sigma.data_mut().par_chunks_exact_mut(width);
    let normals = refined.normals.data_mut().par_chunks_exact_mut(width);
    (depths, confidences, sigmas, normals).into_par_iter().enumerate().for_each(
        |(y, (depths, confidences, sigmas, normals))| {
            for x in 0..width {
                if let Some(found) = pixel(&camera, field.at(x, y), matcher, (x, y), seed(x, y)) {
                    (depths[x], confidences[x]) = (found.depth, found.confidence);
                    (sigmas[x], normals[x]) = (found.sigma, found.normal);
                }
            }
        },
    );
    refined
}

fn pixel(
    camera: &Pinhole,
    state: &State,
    matcher: &Matcher,
    (x, y): (usize, usize),
    (seed, seed_confidence): (Plane, f32),
) -> Option<Outcome> {
    let plane = state.plane;
    if plane.w <= 0.0 {
        return None;
    }
    let pixel = matcher.pixel(x, y, plane.w, 0.0)?;
    let share = |count: f32| count / matcher.sources.len() as f32;
    let moved = if seed.w > 0.0 { (plane.w - seed.w).abs() / pixel.step } else { -1.0 };
    let features = Features {
        correlation: state.correlation,
        texture: pixel.window.variance.sqrt(),
        moved,
        seed: seed_confidence,
        geometric: matcher.confirming(x, y, &plane).map_or(-1.0, |count| share(count as f32)),
    };
    let intrinsics = &camera.intrinsics;
    let normal = plane.normal(intrinsics, x as f64 + 0.5, y as f64 + 0.5);
    let confidence = confidence::of(&features);
    let matched = variance_of(state.variance, pixel.step).sqrt() as f32 / (plane.w * plane.w);
    let depth = 1.0 / plane.w;
    let doubtful = DOUBT * (1.0 - confidence) * depth;
    let sigma = (matched * matched + doubtful * doubtful).sqrt().min(depth);
    Some(Outcome { depth, confidence, sigma, normal: normal.cast::<f32>().into() })
}
