//! The options of training and validation.

use serde::{Deserialize, Serialize};
use vamvs_net::Iteration;

use crate::TrainError;

/// The options of a training run. They are stored in its checkpoints, and a resumed run must have the same ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TrainOptions {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Number of optimiser steps.
    pub steps: usize,
    /// The first steps, which train the coarse stage alone (section 4.2.2).
    pub coarse_steps: usize,
    /// Whether only the flow is trained, on the coarse maps of the network as it is; `coarse_steps` and
    /// `freeze_norm_after` must then be 0.
    pub flow_alone: bool,
    /// After this many steps normalisation layers use their running statistics, as in inference, and no longer update
    /// them.
    pub freeze_norm_after: usize,
    /// Samples in a step; their gradients are accumulated.
    pub batch: usize,
    /// The flow iterations that are trained; absent: the network's own. Validation always uses the network's own.
    pub iterations: Option<Vec<Iteration>>,
    /// How samples are drawn.
    pub sample: SampleOptions,
    /// The loss.
    pub loss: LossOptions,
    /// The optimiser.
    pub optimizer: OptimizerOptions,
}

/// How samples are drawn from the scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct SampleOptions {
    /// Width and height of the crop of the reference view, pixels, multiples of 8.
    pub crop: [usize; 2],
    /// The fewest and the most views, reference view included.
    pub views: [usize; 2],
    /// The most planes.
    pub max_planes: usize,
    /// The smallest scale to which photographs are reduced; the largest is 1.
    pub min_scale: f64,
    /// The largest random change of either end of the depth range, as a natural logarithm.
    pub range_jitter: f64,
    /// The share of samples whose depth range ends before the farthest surfaces, so that the network learns that what lies
    /// beyond is no surface to be measured.
    pub beyond: f64,
    /// Simulated error of the source views' cameras: standard deviation of a shift of the principal point, pixels of
    /// the sample. This is its median over the samples, among which it varies log-normally with σ = 1.
    pub camera_noise: f64,
    /// Whether views are weighted by the ground-truth visibility instead of the network's (vis-var and vis-corr;
    /// table 2).
    pub true_visibility: bool,
    /// Whether exposure, colours, contrast, sharpness and noise are varied between views.
    pub augment: bool,
}

/// The loss (equations 8 and 9).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct LossOptions {
    /// Weight λ_vis of the supervision of visibility.
    pub visibility: f64,
    /// A flow iteration is not trained at pixels where the error of the depth before it is greater than this many times
    /// the reach m · s of its hypotheses. 0: it is trained at all pixels.
    pub flow_reach: f64,
    /// Weight of the cross entropy over the planes of the coarse stage. With it, equation 8 applies to the coarse depth
    /// only where its error is at most two plane distances. 0: equation 8 alone, at all pixels.
    pub cross_entropy: f64,
    /// Weight of the cross entropy of the probability that a pixel shows a surface, for a cascade.
    pub surface: f64,
}

/// The options of the optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OptimizerOptions {
    /// The update rule.
    pub rule: Rule,
    /// The learning rate after the warm-up.
    pub learning_rate: f64,
    /// How the learning rate decreases.
    pub decay: Decay,
    /// Steps over which the learning rate increases linearly to that value.
    pub warm_up: usize,
    /// Weight decay.
    pub weight_decay: f64,
    /// The largest norm of the gradient, to which it is clipped; 0: no clipping.
    pub clip: f64,
}

/// The rule that updates the weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Rule {
    /// RMSProp with α = 0.9; weight decay is added to the gradient.
    RmsProp,
    /// Adam with β = 0.9, 0.999 and decoupled weight decay.
    AdamW,
}

/// How the learning rate decreases.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Decay {
    /// Along half a cosine, to a hundredth at the last step.
    Cosine,
    /// By a factor of 0.9 after each twelfth of the steps (every second of 24 epochs, section 4.2.2).
    Steps,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self::compact(40_000)
    }
}

impl Default for SampleOptions {
    fn default() -> Self {
        Self {
            crop: [256, 192],
            views: [2, 5],
            max_planes: 64,
            min_scale: 0.5,
            range_jitter: 0.25,
            beyond: 0.0,
            camera_noise: 0.3,
            true_visibility: false,
            augment: true,
        }
    }
}

impl Default for LossOptions {
    fn default() -> Self {
        Self { visibility: 0.01, flow_reach: 2.0, cross_entropy: 1.0, surface: 1.0 }
    }
}

impl Default for OptimizerOptions {
    fn default() -> Self {
        Self {
            rule: Rule::AdamW,
            learning_rate: 1e-3,
            decay: Decay::Cosine,
            warm_up: 500,
            weight_decay: 1e-2,
            clip: 1.0,
        }
    }
}

impl TrainOptions {
    /// Small crops and AdamW, for `steps` steps. The first tenth trains the coarse stage alone; in the second half
    /// normalisation layers use their running statistics.
    #[must_use]
    pub fn compact(steps: usize) -> Self {
        Self {
            seed: 0,
            steps,
            coarse_steps: steps / 10,
            flow_alone: false,
            freeze_norm_after: steps / 2,
            batch: 2,
            iterations: None,
            sample: SampleOptions::default(),
            loss: LossOptions::default(),
            optimizer: OptimizerOptions::default(),
        }
    }

    /// The paper's training (section 4.2.2), for `steps` steps: RMSProp and batches of 4 samples of 3 views of
    /// 640×512 pixels and 48 planes. A sixth of the steps (4 of 24 epochs) trains the coarse stage alone; then there
    /// are two flow iterations, at 1/8 and 1/4, with s = 0.75 and 0.375. Depth ranges are not jittered and photographs
    /// are not augmented.
    ///
    /// Three things differ from the paper. The samples of a batch are processed one after the other, so batch
    /// normalisation sees the views of one sample at a time. Larger photographs are cropped, not resized. The planes
    /// span the depth range of each view, not one range for the whole training set.
    #[must_use]
    pub fn paper(steps: usize) -> Self {
        Self {
            steps,
            coarse_steps: steps / 6,
            freeze_norm_after: steps,
            batch: 4,
            iterations: Some(vec![Iteration { scale: 8, step: 0.75 }, Iteration { scale: 4, step: 0.375 }]),
            sample: SampleOptions {
                crop: [640, 512],
                views: [3, 3],
                max_planes: 48,
                min_scale: 1.0,
                range_jitter: 0.0,
                camera_noise: 0.0,
                augment: false,
                ..SampleOptions::default()
            },
            loss: LossOptions { flow_reach: 0.0, cross_entropy: 0.0, ..LossOptions::default() },
            optimizer: OptimizerOptions {
                rule: Rule::RmsProp,
                learning_rate: 5e-4,
                decay: Decay::Steps,
                warm_up: 0,
                weight_decay: 1e-3,
                clip: 0.0,
            },
            ..Self::default()
        }
    }

    /// Checks the options.
    ///
    /// # Errors
    /// Names the first option that is out of range.
    pub fn check(&self) -> Result<(), TrainError> {
        let SampleOptions { crop, views, max_planes, min_scale, range_jitter, camera_noise, .. } =
            &self.sample;
        let at_least = |name, value: usize, least: usize| {
            let wrong = || TrainError::option(name, &format!("at least {least}"), &value);
            if value < least { Err(wrong()) } else { Ok(()) }
        };
        let between = |name, value: f64, low: f64, high: f64| {
            let wrong = || TrainError::option(name, &format!("from {low} to {high}"), &value);
            if (low..=high).contains(&value) { Ok(()) } else { Err(wrong()) }
        };
        at_least("steps", self.steps, 1)?;
        at_least("batch", self.batch, 1)?;
        for (name, steps) in
            [("coarse-steps", self.coarse_steps), ("freeze-norm-after", self.freeze_norm_after)]
        {
            if self.flow_alone && steps > 0 {
                return Err(TrainError::option(name, "0 if only the flow is trained", &steps));
            }
        }
        for side in crop {
            if *side < 32 || !side.is_multiple_of(8) {
                return Err(TrainError::option("crop", "two multiples of 8, at least 32", &side));
            }
        }
        at_least("the fewest views", views[0], 2)?;
        at_least("the most views", views[1], views[0])?;
        at_least("max-planes", *max_planes, 8)?;
        between("min-scale", *min_scale, 0.1, 1.0)?;
        between("range-jitter", *range_jitter, 0.0, 1.0)?;
        between("camera-noise", *camera_noise, 0.0, 10.0)?;
        between("the weight of visibility", self.loss.visibility, 0.0, 1e3)?;
        between("flow-reach", self.loss.flow_reach, 0.0, 1e3)?;
        between("cross-entropy", self.loss.cross_entropy, 0.0, 1e3)?;
        between("the weight of surfaces", self.loss.surface, 0.0, 1e3)?;
        between("beyond", self.sample.beyond, 0.0, 1.0)?;
        between("learning-rate", self.optimizer.learning_rate, 1e-8, 1.0)?;
        between("weight-decay", self.optimizer.weight_decay, 0.0, 1.0)?;
        between("clip", self.optimizer.clip, 0.0, 1e6)
    }
}

/// The options of validation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Validation {
    /// The most views, reference view included. Beyond five, only those with a good view-selection score are used.
    pub views: usize,
    /// The longer side to which larger photographs are reduced, pixels.
    pub max_size: usize,
    /// The most planes.
    pub max_planes: usize,
    /// The number of reference views, spread evenly over the set.
    pub references: usize,
    /// Whether views are weighted by the ground-truth visibility instead of the network's (vis-var and vis-corr).
    pub true_visibility: bool,
}

impl Default for Validation {
    fn default() -> Self {
        Self { views: 5, max_size: 512, max_planes: 96, references: 16, true_visibility: false }
    }
}
