//! Compares the depth maps and the cloud of a scene with its true depth maps.

use std::path::Path;

use serde::Serialize;
use vamvs_core::{Cloud, DepthMap};
use vamvs_eval::surface::{TrueMap, seen_twice};
use vamvs_eval::{CloudDistances, CloudErrors, Threshold, thin};
use vamvs_fusion::MapSource;
use vamvs_io::ply;

use super::depth::{DepthScene, SceneErrors, median_depth};
use crate::VamvsError;

/// Default distance thresholds for the cloud.
const DEFAULT: [CloudThreshold; 2] =
    [CloudThreshold::ShareOfMedianDepth(0.005), CloudThreshold::ShareOfMedianDepth(0.01)];

/// A distance up to which points of the cloud and of the true surface agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CloudThreshold {
    /// In scene units.
    Distance(f64),
    /// As a share of the median of the views' median true depths.
    ShareOfMedianDepth(f64),
}

/// The scores of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneScores {
    /// Of the depth maps.
    pub depth: SceneErrors,
    /// Of the cloud, if there is one.
    pub cloud: Option<CloudErrors>,
}

/// A scene with all that its page shows.
#[derive(Debug)]
pub struct SceneEvaluation {
    /// The depth maps.
    pub maps: DepthScene,
    /// The scores.
    pub scores: SceneScores,
    /// The cloud, if there is one.
    pub cloud: Option<ComparedCloud>,
}

/// A cloud and the true surface.
#[derive(Clone, Debug)]
pub struct ComparedCloud {
    /// The cloud.
    pub cloud: Cloud,
    /// Points of the true surface where at least two views see it: no two within half the least threshold, so
    /// that every place of the surface is well within each threshold of one.
    pub ground_truth: Vec<[f64; 3]>,
    /// The distances between them.
    pub distances: CloudDistances,
    /// Distance thresholds of precision and recall, ascending, scene units.
    pub thresholds: Vec<f64>,
}

impl SceneEvaluation {
    /// Compares depth maps, and the PLY file `cloud` if it is given, a cloud or a mesh. Without `cloud_thresholds` those are 0.5 and 1 % of the
    /// true depths' median.
    ///
    /// # Errors
    /// If a file cannot be read, maps differ in camera or size, or thresholds need plane distances
    /// that are not known.
    pub fn new(
        maps: DepthScene,
        cloud: Option<&Path>,
        depth_thresholds: &[Threshold],
        cloud_thresholds: Option<&[CloudThreshold]>,
    ) -> Result<Self, VamvsError> {
        let depth = maps.errors(depth_thresholds)?;
        let thresholds = cloud_thresholds.unwrap_or(&DEFAULT);
        let compare = |cloud| ComparedCloud::new(cloud, &maps, thresholds);
        let cloud = cloud.map(compare).transpose()?;
        let errors = cloud.as_ref().map(|cloud| cloud.distances.errors(&cloud.thresholds));
        Ok(Self { scores: SceneScores { depth, cloud: errors }, maps, cloud })
    }
}

impl ComparedCloud {
    fn new(cloud: &Path, maps: &DepthScene, thresholds: &[CloudThreshold]) -> Result<Self, VamvsError> {
        let ground_truth = maps.ground_truth();
        let ground_truth: Vec<DepthMap> =
            (0..ground_truth.len()).map(|view| ground_truth.depth_map(view)).collect::<Result<_, _>>()?;
        let thresholds = distances(thresholds, &ground_truth);
        let least = thresholds.first().copied().unwrap_or(0.0);
        let ground_truth = surface(&ground_truth, 0.5 * least)?;
        let cloud = match ply::is_mesh(cloud)? {
            true => super::cloud::on_mesh(cloud, Some(least))?,
            false => ply::read(cloud)?,
        };
        let places: Vec<[f64; 3]> = cloud.iter().map(|point| point.x_in_world).collect();
        let distances = CloudDistances::between(&places, &ground_truth);
        Ok(Self { cloud, ground_truth, distances, thresholds })
    }
}

/// Thresholds in scene units, ascending.
fn distances(thresholds: &[CloudThreshold], ground_truth: &[DepthMap]) -> Vec<f64> {
    let mut medians: Vec<f64> = ground_truth.iter().map(|map| median_depth(&map.depth)).collect();
    medians.sort_by(f64::total_cmp);
    let median = medians[medians.len() / 2];
    let distance = |&threshold: &CloudThreshold| match threshold {
        CloudThreshold::Distance(distance) => distance,
        CloudThreshold::ShareOfMedianDepth(share) => share * median,
    };
    let mut distances: Vec<f64> = thresholds.iter().map(distance).collect();
    distances.sort_by(f64::total_cmp);
    distances
}

/// Points of the surface seen by at least two maps, no two of them within `spacing`.
fn surface(maps: &[DepthMap], spacing: f64) -> Result<Vec<[f64; 3]>, VamvsError> {
    let maps: Vec<TrueMap> = maps
        .iter()
        .map(|map| TrueMap { camera: &map.camera, cam_from_world: &map.cam_from_world, depth: &map.depth })
        .collect();
    thin(&seen_twice(&maps, 1), spacing, 0).map_err(|error| VamvsError::Request(error.to_string()))
}
