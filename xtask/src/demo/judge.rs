//! The demo's result against the truth.

use std::path::Path;

use anyhow::Result;
use vamvs_core::{Cloud, CloudPoint, Grid, Size};
use vamvs_eval::cloud::nearest_distances;
use vamvs_eval::{Agreement, DepthErrors, compare_clouds, compare_depths};
use vamvs_io::ply;
use vamvs_tests::{Rendered, truth_cloud};

use super::scene::DemoScene;
use crate::colour::Scale;
use crate::maps::{Map, stacked};

/// How near to the truth a point must be, as a share of the scene's median depth.
const THRESHOLD: f64 = 0.01;

/// Relative depth errors of interest.
pub const THRESHOLDS: [f64; 4] = [0.002, 0.005, 0.01, 0.02];

/// Every so many-th true pixel, in both directions, is a true point.
const STEP: usize = 2;

/// What the demo came to.
pub struct Verdict {
    /// The cloud.
    pub cloud: Cloud,
    /// How near to the truth a point must be, scene units.
    pub threshold: f64,
    /// The cloud against the true one.
    pub agreement: Agreement,
    /// All depths against the true ones.
    pub depth: DepthErrors,
    /// The confident ones of them.
    pub confident: DepthErrors,
    /// The truth at the size of the depth maps, view by view.
    pub truth: Vec<Rendered>,
    /// The estimates, view by view.
    pub maps: Vec<Map>,
    /// The cloud, coloured by distance to the truth.
    pub wrong: Cloud,
    /// The truth, coloured by distance to the cloud.
    pub missing: Cloud,
}

/// Compares what is in `out` with the scene.
pub fn judge(scene: &DemoScene, out: &Path) -> Result<Verdict> {
    let maps: Vec<Map> =
        (0..scene.views.len()).map(|view| Map::read(out, &DemoScene::name(view))).collect::<Result<_>>()?;
    let truth = scene.views_at(maps.first().map_or(Size::new(1, 1), |map| map.depth.size()));
    let true_depth = stacked(truth.iter().map(|view| &view.depth));
    let depth = stacked(maps.iter().map(|map| &map.depth));
    let confident = stacked(&maps.iter().map(Map::confident).collect::<Vec<Grid<f32>>>());
    let cloud = ply::read(&out.join("fused.ply"))?;
    let (found, exact) = (places(&cloud), truth_cloud(&scene.views, STEP));
    let threshold = THRESHOLD * scene.median_depth();
    Ok(Verdict {
        agreement: compare_clouds(&found, &exact, threshold),
        depth: compare_depths(&depth, &true_depth, &THRESHOLDS)?,
        confident: compare_depths(&confident, &true_depth, &THRESHOLDS)?,
        wrong: coloured(cloud.iter().copied(), &nearest_distances(&found, &exact), threshold),
        missing: coloured(exact.iter().map(bare), &nearest_distances(&exact, &found), threshold),
        cloud,
        threshold,
        truth,
        maps,
    })
}

fn places(cloud: &[CloudPoint]) -> Vec<[f64; 3]> {
    cloud.iter().map(|point| point.x_in_world).collect()
}

/// A point of which nothing but the place is known.
fn bare(x_in_world: &[f64; 3]) -> CloudPoint {
    CloudPoint { x_in_world: *x_in_world, normal: [0.0; 3], colour: [0; 3], confidence: 1.0, views: 0 }
}

/// Points in the colours of their distances: white at 0, dark red at twice the threshold.
fn coloured(cloud: impl Iterator<Item = CloudPoint>, distances: &[f64], threshold: f64) -> Cloud {
    let colour = |distance: f64| Scale::Error.at((0.5 * distance / threshold) as f32);
    cloud.zip(distances).map(|(point, &distance)| CloudPoint { colour: colour(distance), ..point }).collect()
}
