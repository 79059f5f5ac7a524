//! Calibration: maps a network's confidence to the fraction of inliers among pixels of that confidence.

use serde::Serialize;
use vamvs_core::{DepthMap, Grid, MonotoneMap};
use vamvs_eval::Reliability;
use vamvs_eval::reliability::outcomes;
use vamvs_net::{Estimator, Profile};

use crate::sample::{Sample, whole};
use crate::{Dataset, TrainError, Validation};

/// The number of groups of pixels with similar confidence to which the map is fitted.
const GROUPS: usize = 64;

/// Of a view with more pixels only every second, third, … is used, to limit memory.
const PIXELS_OF_VIEW: usize = 200_000;

/// The reliability of the confidence before and after calibration, on views to which it was not fitted.
#[derive(Clone, Debug, Serialize)]
pub struct Calibration {
    /// Reliability of the confidence as it was.
    pub before: Reliability,
    /// Reliability of the calibrated confidence.
    pub after: Reliability,
}

/// The confidence of pixels and whether their depth is right, for views to fit to and views to measure on.
#[derive(Clone, Debug, Default)]
pub struct Outcomes {
    fitted: Vec<(f32, bool)>,
    measured: Vec<(f32, bool)>,
    views: usize,
}

impl Outcomes {
    /// Adds the pixels of a view, of a large one not all. Every second view is measured on, beginning with the second.
    pub fn add(&mut self, map: &DepthMap, ground_truth: &Grid<f32>) {
        let set = if self.views.is_multiple_of(2) { &mut self.fitted } else { &mut self.measured };
        let step = map.depth.size().area().div_ceil(PIXELS_OF_VIEW).max(1);
        set.extend(outcomes(&map.depth, &map.confidence, ground_truth).step_by(step));
        self.views += 1;
    }

    /// The map from confidence to the fraction of inliers, and what comes of it.
    ///
    /// # Errors
    /// If no pixel of the views to fit to has ground-truth depth.
    pub fn calibration(self) -> Result<(MonotoneMap, Calibration), TrainError> {
        let map = MonotoneMap::fit(self.fitted, GROUPS).ok_or(TrainError::NothingToCalibrate)?;
        let (mut before, mut after) = (Reliability::default(), Reliability::default());
        for (confidence, right) in self.measured {
            before.add(confidence, right);
            after.add(map.at(f64::from(confidence)) as f32, right);
        }
        Ok((map, Calibration { before, after }))
    }
}

/// Fits the map from the network's confidence to the fraction of inliers (error at most
/// [`RIGHT_WITHIN`](vamvs_eval::reliability::RIGHT_WITHIN)) and writes it into the network's manifest. The map is
/// fitted to every second reference view and measured on the others. A calibration of refined depth maps, which start from this
/// confidence, is dropped.
///
/// # Errors
/// If there are fewer than two reference views, a file is wrong, the module breaks its contract or has no
/// `set_manifest`, memory runs out, or no pixel has ground-truth depth.
pub fn calibrate(
    estimator: &mut Estimator,
    dataset: &Dataset,
    options: &Validation,
) -> Result<Calibration, TrainError> {
    let mut manifest = estimator.network().manifest().clone();
    manifest.calibration = None;
    manifest.refined_calibration = None;
    estimator.network_mut().set_manifest(manifest.clone())?;
    let references = dataset.references();
    if references.len() < 2 {
        return Err(TrainError::NothingToCalibrate);
    }
    let count = options.references.clamp(2, references.len());
    let mut outcomes = Outcomes::default();
    for index in 0..count {
        let (scene, view) = references[index * references.len() / count];
        let sample =
            whole(&dataset.scenes[scene], view, (options, estimator.network().manifest().plane_step))?;
        let map = estimate(estimator, &sample)?;
        let ground_truth = sample.true_depths(map.scale_in(&sample.photos[0].camera));
        outcomes.add(&map, &ground_truth);
    }
    let (map, calibration) = outcomes.calibration()?;
    manifest.calibration = Some(map);
    estimator.network_mut().set_manifest(manifest)?;
    Ok(calibration)
}

fn estimate(estimator: &Estimator, sample: &Sample) -> Result<DepthMap, TrainError> {
    let views = tch::no_grad(|| sample.encode(estimator.network()))?;
    let sources: Vec<_> = views[1..].iter().collect();
    Ok(estimator.estimate(&views[0], &sources, &sample.planes, &mut Profile::default())?)
}
