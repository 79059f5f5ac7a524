//! Compares the demo's result with the ground truth.

use std::path::Path;

use anyhow::Result;
use vamvs_core::{Cloud, CloudPoint, Grid, Size};
use vamvs_eval::surface::{TrueMap, seen_twice};
use vamvs_eval::{CloudDistances, CloudErrors, DepthErrors};
use vamvs_io::ply;
use vamvs_picture::Scale;
use vamvs_tests::Rendered;

use super::scene::DemoScene;
use crate::maps::{Map, relative_errors};

/// Distance threshold of precision and recall, as a share of the scene's median depth.
const THRESHOLD: f64 = 0.01;

/// Thresholds of the relative depth error.
pub const THRESHOLDS: [f64; 4] = [0.002, 0.005, 0.01, 0.02];

/// One pixel in this many, in x and in y, of the true depth maps gives a point of the true surface.
const STEP: usize = 2;

/// The result of the comparison.
pub struct Verdict {
    /// The reconstructed cloud.
    pub cloud: Cloud,
    /// Distance threshold of precision and recall, scene units.
    pub threshold: f64,
    /// Precision, recall and distances of the cloud against the true surface.
    pub agreement: CloudErrors,
    /// Errors of all depths.
    pub depth: DepthErrors,
    /// Errors of the depths that pass the photometric filter of fusion.
    pub confident: DepthErrors,
    /// The true depth of each view, at the size of the depth maps.
    pub ground_truth: Vec<Grid<f32>>,
    /// The estimated map of each view.
    pub maps: Vec<Map>,
    /// The cloud, coloured by distance to the true surface.
    pub wrong: Cloud,
    /// Points of the true surface, coloured by distance to the cloud.
    pub missing: Cloud,
}

/// Compares the results in the output folder `out` with the scene's ground truth.
pub fn judge(scene: &DemoScene, out: &Path) -> Result<Verdict> {
    let maps: Vec<Map> =
        (0..scene.views.len()).map(|view| Map::read(out, &DemoScene::name(view))).collect::<Result<_>>()?;
    let ground_truth = scene.depth_at(maps.first().map_or(Size::new(1, 1), |map| map.depth.size()));
    let depth: Vec<_> = maps.iter().map(|map| map.depth.clone()).collect();
    let confident: Vec<_> = maps.iter().map(Map::confident).collect();
    let cloud = ply::read(&out.join("fused.ply"))?;
    let exact = true_surface(&scene.views);
    let distances = CloudDistances::between(&places(&cloud), &exact);
    let threshold = THRESHOLD * scene.median_depth();
    Ok(Verdict {
        agreement: distances.errors(&[threshold]),
        depth: relative_errors(&depth, &ground_truth, &THRESHOLDS)?,
        confident: relative_errors(&confident, &ground_truth, &THRESHOLDS)?,
        wrong: coloured(cloud.iter().copied(), &distances.to_ground_truth, threshold),
        missing: coloured(exact.iter().map(bare), &distances.to_cloud, threshold),
        cloud,
        threshold,
        ground_truth,
        maps,
    })
}

fn true_surface(views: &[Rendered]) -> Vec<[f64; 3]> {
    let maps = views.iter().map(|view| TrueMap {
        camera: &view.photo.camera,
        cam_from_world: &view.photo.cam_from_world,
        depth: &view.depth,
    });
    seen_twice(&maps.collect::<Vec<_>>(), STEP)
}

fn places(cloud: &[CloudPoint]) -> Vec<[f64; 3]> {
    cloud.iter().map(|point| point.x_in_world).collect()
}

/// A point with a position and nothing else.
fn bare(x_in_world: &[f64; 3]) -> CloudPoint {
    CloudPoint {
        x_in_world: *x_in_world,
        normal: [0.0; 3],
        colour: [0; 3],
        confidence: 1.0,
        sigma: 0.0,
        views: 0,
    }
}

/// Points coloured by their distances: white at 0, dark red from twice the threshold.
fn coloured(cloud: impl Iterator<Item = CloudPoint>, distances: &[f64], threshold: f64) -> Cloud {
    let colour = |distance: f64| Scale::Error.at((0.5 * distance / threshold) as f32);
    cloud.zip(distances).map(|(point, &distance)| CloudPoint { colour: colour(distance), ..point }).collect()
}
