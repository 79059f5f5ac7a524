//! Calibration: maps a network's confidence to the fraction of inliers among pixels of that confidence.

use vamvs_core::{DepthMap, MonotoneMap};
use vamvs_eval::Reliability;
use vamvs_eval::reliability::outcomes;
use vamvs_net::{Estimator, Profile};

use crate::sample::{Sample, whole};
use crate::{Dataset, TrainError, Validation};

/// The number of groups of pixels with similar confidence to which the map is fitted.
const GROUPS: usize = 64;

/// The reliability of the confidence before and after calibration, on views to which it was not fitted.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// Reliability of the network's own confidence.
    pub before: Reliability,
    /// Reliability of the calibrated confidence.
    pub after: Reliability,
}

/// Fits the map from the network's confidence to the fraction of inliers (error at most
/// [`RIGHT_WITHIN`](vamvs_eval::reliability::RIGHT_WITHIN)) and writes it into the network's manifest. The map is
/// fitted to every second reference view and measured on the others.
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
    estimator.network_mut().set_manifest(manifest.clone())?;
    let references = dataset.references();
    if references.len() < 2 {
        return Err(TrainError::NothingToCalibrate);
    }
    let count = options.references.clamp(2, references.len());
    let (mut fitted, mut measured) = (Vec::new(), Vec::new());
    for index in 0..count {
        let (scene, view) = references[index * references.len() / count];
        let sample =
            whole(&dataset.scenes[scene], view, (options, estimator.network().manifest().plane_step))?;
        let map = estimate(estimator, &sample)?;
        let ground_truth = sample.true_depths(map.scale_in(&sample.photos[0].camera));
        let of_view = outcomes(&map.depth, &map.confidence, &ground_truth);
        let set = if index % 2 == 0 { &mut fitted } else { &mut measured };
        set.extend(of_view);
    }
    let map = MonotoneMap::fit(fitted, GROUPS).ok_or(TrainError::NothingToCalibrate)?;
    let (mut before, mut after) = (Reliability::default(), Reliability::default());
    for (confidence, right) in measured {
        before.add(confidence, right);
        after.add(map.at(f64::from(confidence)) as f32, right);
    }
    manifest.calibration = Some(map);
    estimator.network_mut().set_manifest(manifest)?;
    Ok(Calibration { before, after })
}

fn estimate(estimator: &Estimator, sample: &Sample) -> Result<DepthMap, TrainError> {
    let views = tch::no_grad(|| sample.encode(estimator.network()))?;
    let sources: Vec<_> = views[1..].iter().collect();
    Ok(estimator.estimate(&views[0], &sources, &sample.planes, &mut Profile::default())?)
}
