//! Validation: the paper's measures (section 4.1) on hold-out scenes, for each stage and by visibility in the source
//! views.

use serde::{Deserialize, Serialize};
use vamvs_core::{Grid, Photo, Planes, Visibility};
use vamvs_eval::reliability::RIGHT_WITHIN;
use vamvs_net::to_grid;
use vamvs_net::{Estimator, Profile};

use crate::dataset::Dataset;
use crate::sample::{Sample, centres, whole};
use crate::{TrainError, Validation};

/// The paper's threshold d for refined maps, in plane distances; for the coarse map it is 1.
const REFINED_D: f64 = 0.375;

/// The scores of all stages, coarse first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// The scores of each stage.
    pub stages: Vec<StageScores>,
}

/// The scores of one stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct StageScores {
    /// Over all pixels.
    pub overall: Region,
    /// Over pixels that at least one source view does not see, in scenes with visibility.
    pub invisible: Region,
    /// Over pixels that all source views see, in scenes with visibility.
    pub fully_visible: Region,
}

/// Counts over a region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Region {
    /// Pixels with a known ground truth.
    pub pixels: usize,
    /// Of these, pixels with an error < d.
    pub within_d: usize,
    /// Pixels with an error < 3d.
    pub within_3d: usize,
    /// Pixels with an error > 1 % of the depth.
    #[serde(alias = "failures")]
    pub outliers: usize,
}

impl Region {
    /// A count as a share of the pixels; NaN without pixels.
    #[must_use]
    pub fn share(&self, count: usize) -> f64 {
        count as f64 / self.pixels as f64
    }

    fn add(&mut self, planes_off: f64, d: f64, relative: f64) {
        self.pixels += 1;
        self.within_d += usize::from(planes_off < d);
        self.within_3d += usize::from(planes_off < 3.0 * d);
        // A depth that is NaN is an outlier.
        self.outliers += usize::from(relative.is_nan() || relative > RIGHT_WITHIN);
    }
}

impl Scores {
    /// The outlier rate of the last stage, by which the best network is chosen.
    #[must_use]
    pub fn outliers(&self) -> f64 {
        self.stages.last().map_or(f64::NAN, |stage| stage.overall.share(stage.overall.outliers))
    }
}

/// The name of a stage by its number; 0 is the coarse stage.
#[must_use]
pub fn stage_name(stage: usize) -> String {
    if stage == 0 { "coarse".to_owned() } else { format!("iteration {stage}") }
}

/// A reference view with its depth maps, for display.
pub struct Example {
    /// The reference photograph.
    pub photo: Photo,
    /// Ground-truth depth at the last stage's scale, 0 where unknown.
    pub ground_truth: Grid<f32>,
    /// Depth after each stage, coarse first.
    pub stages: Vec<Grid<f32>>,
}

/// Measures a network; `look` is called with every reference view.
///
/// # Errors
/// If a file is wrong, the module breaks its contract, or memory runs out.
pub fn validate(
    estimator: &Estimator,
    dataset: &Dataset,
    options: &Validation,
    mut look: impl FnMut(&Example),
) -> Result<Scores, TrainError> {
    let references = dataset.references();
    let count = options.references.clamp(1, references.len());
    let mut scores = Scores::default();
    for index in 0..count {
        let (scene, view) = references[index * references.len() / count];
        let sample =
            whole(&dataset.scenes[scene], view, (options, estimator.network().manifest().plane_step))?;
        let maps = tch::no_grad(|| stages(estimator, &sample))?;
        scores.stages.resize(maps.len(), StageScores::default());
        let scales = maps.iter().map(|map| scale_of(&sample, map)).collect::<Vec<_>>();
        for (index, (map, &scale)) in maps.iter().zip(&scales).enumerate() {
            let d = if index == 0 { 1.0 } else { REFINED_D };
            score(&mut scores.stages[index], &sample, map, scale, d);
        }
        look(&example(&sample, &maps, scales[scales.len() - 1]));
    }
    Ok(scores)
}

/// Plane coordinates after each stage.
fn stages(estimator: &Estimator, sample: &Sample) -> Result<Vec<Grid<f32>>, TrainError> {
    let views = sample.encode(estimator.network())?;
    let sources: Vec<_> = views[1..].iter().collect();
    let masks = sample.masks(estimator.network(), &views[0])?;
    let maps = estimator.stages(&views[0], &sources, &sample.planes, masks, &mut Profile::default())?;
    Ok(maps.iter().map(|map| to_grid(&map.u)).collect::<Result<_, _>>()?)
}

/// The ratio of the padded photograph's size to the map's.
fn scale_of(sample: &Sample, map: &Grid<f32>) -> usize {
    sample.photos[0].camera.size.width.next_multiple_of(8) / map.width()
}

fn score(scores: &mut StageScores, sample: &Sample, map: &Grid<f32>, scale: usize, d: f64) {
    let size = sample.photos[0].camera.size;
    let (xs, ys) = (centres(size.width, scale), centres(size.height, scale));
    let ground_truth = sample.ground_truth.coordinates(&xs, &ys, &sample.planes);
    let seen: Vec<_> = (0..sample.photos.len() - 1).map(|s| sample.ground_truth.seen(s, &xs, &ys)).collect();
    for (index, ground_truth) in
        ground_truth.into_iter().enumerate().filter(|(_, ground_truth)| !ground_truth.is_nan())
    {
        let found = map[(index % xs.len(), index / xs.len())];
        let [found, ground_truth] = [found, ground_truth].map(f64::from);
        let relative = (sample.planes.depth(found) / sample.planes.depth(ground_truth) - 1.0).abs();
        let mut regions = vec![&mut scores.overall];
        let known: Option<Vec<Visibility>> = seen.iter().map(|seen| Some(seen.as_ref()?[index])).collect();
        if let Some(known) = known {
            let all = known.iter().all(|seen| *seen == Visibility::Visible);
            regions.push(if all { &mut scores.fully_visible } else { &mut scores.invisible });
        }
        for region in regions {
            region.add((found - ground_truth).abs(), d, relative);
        }
    }
}

fn example(sample: &Sample, maps: &[Grid<f32>], scale: usize) -> Example {
    let photo = sample.photos[0].clone();
    let ground_truth = sample.true_depths(scale);
    let depth = |planes: &Planes, u: f32| planes.depth(f64::from(u)) as f32;
    Example {
        photo,
        ground_truth,
        stages: maps.iter().map(|map| map.map(|&u| depth(&sample.planes, u))).collect(),
    }
}
