//! How a network is trained.

use serde::{Deserialize, Serialize};
use vamvs_net::Iteration;

use crate::TrainError;

/// How a network is trained. What is written beside the checkpoints, and what a resumed run must share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TrainOptions {
    /// Seed of all that is random.
    pub seed: u64,
    /// Steps of the optimiser.
    pub steps: usize,
    /// Of these, steps at the beginning that train the coarse part alone (section 4.2.2).
    pub coarse_steps: usize,
    /// Whether the flow alone learns, on coarse maps as the network makes them: `coarse_steps` and
    /// `freeze_norm_after` are 0 then.
    pub flow_alone: bool,
    /// Steps after which normalisation layers keep their running statistics, as when the network is used.
    pub freeze_norm_after: usize,
    /// Samples a step, their gradients accumulated.
    pub batch: usize,
    /// The flow iterations that learn; absent: the network's own, which are measured in any case.
    pub iterations: Option<Vec<Iteration>>,
    /// What is drawn from the scenes.
    pub sample: SampleOptions,
    /// What is minimised.
    pub loss: LossOptions,
    /// How the weights follow the gradient.
    pub optimizer: OptimizerOptions,
}

/// What is drawn from the scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct SampleOptions {
    /// Width and height of the cut-out of the reference view, pixels, multiples of 8.
    pub crop: [usize; 2],
    /// Fewest and most views, the reference included.
    pub views: [usize; 2],
    /// Most planes.
    pub max_planes: usize,
    /// Smallest scale to which photographs are reduced; the largest is 1.
    pub min_scale: f64,
    /// Largest change of either end of the depth range, as a logarithm.
    pub range_jitter: f64,
    /// Deviation of the errors of the sources' cameras, pixels of the sample, in the middle of a wide spread
    /// of samples (log-normal, σ = 1): estimated cameras are never exactly the true ones.
    pub camera_noise: f64,
    /// Whether views are weighted by the true visibility instead of the network's (vis-var, table 2).
    pub true_visibility: bool,
    /// Whether colours, exposure, noise and sharpness vary between views.
    pub augment: bool,
}

/// What is minimised (equations 8 and 9).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct LossOptions {
    /// Weight of the supervised visibility (λ_vis).
    pub visibility: f64,
    /// A flow iteration does not learn where the depth before is wrong by more than this many times the
    /// reach of its hypotheses; 0: it learns everywhere.
    pub flow_reach: f64,
    /// Weight of the cross entropy of the coarse stage's planes; with it, coarse depths are corrected by
    /// equation 8 only where the error is less than two planes. 0: equation 8 alone, everywhere.
    pub cross_entropy: f64,
}

/// How the weights follow the gradient.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OptimizerOptions {
    /// The rule.
    pub rule: Rule,
    /// The learning rate, after the warm-up.
    pub learning_rate: f64,
    /// How it changes.
    pub decay: Decay,
    /// Steps over which it grows from nothing.
    pub warm_up: usize,
    /// Weight decay.
    pub weight_decay: f64,
    /// Largest norm of the gradient; 0: any.
    pub clip: f64,
}

/// How weights follow the gradient.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Rule {
    /// RMSProp with α = 0.9; weight decay is part of the gradient.
    RmsProp,
    /// Adam with β = 0.9, 0.999 and weight decay beside the gradient.
    AdamW,
}

/// How the learning rate changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Decay {
    /// Half a cosine down to a hundredth at the last step.
    Cosine,
    /// Times 0.9 after each twelfth of the steps (every second of 24 epochs, section 4.2.2).
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
            camera_noise: 0.3,
            true_visibility: false,
            augment: true,
        }
    }
}

impl Default for LossOptions {
    fn default() -> Self {
        Self { visibility: 0.01, flow_reach: 2.0, cross_entropy: 1.0 }
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
    /// Small cut-outs and AdamW, for `steps` steps: a tenth of them for the coarse part alone, the second
    /// half with the normalisation's statistics as they are.
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

    /// The paper's training (section 4.2.2), for `steps` steps: RMSProp, batches of 4 samples of 3 views
    /// of 640 × 512 pixels and 48 planes, a sixth of the steps (4 of 24 epochs) for the coarse part alone, then two flow
    /// iterations at 1/8 and 1/4 with s = 0.75 and 0.375; depth ranges and photographs as they are.
    ///
    /// Three things are not as in the paper. The samples of a batch are shown one after the other, so batch
    /// normalisation sees the views of one sample at a time. Larger photographs are cut, not resized. The planes
    /// span each view's own depth range, not one of the whole set.
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

    /// Checks that the options make sense.
    ///
    /// # Errors
    /// With the first that does not.
    pub fn check(&self) -> Result<(), TrainError> {
        let SampleOptions { crop, views, max_planes, min_scale, range_jitter, camera_noise, .. } =
            &self.sample;
        let at_least = |name, value: usize, least: usize| {
            let wrong = || TrainError::option(name, &format!("{least} at least"), &value);
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
                return Err(TrainError::option(name, "0 where the flow learns alone", &steps));
            }
        }
        for side in crop {
            if *side < 32 || !side.is_multiple_of(8) {
                return Err(TrainError::option("crop", "two multiples of 8 from 32 on", &side));
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
        between("learning-rate", self.optimizer.learning_rate, 1e-8, 1.0)?;
        between("weight-decay", self.optimizer.weight_decay, 0.0, 1.0)?;
        between("clip", self.optimizer.clip, 0.0, 1e6)
    }
}

/// What is measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Validation {
    /// Views compared, the reference included; beyond five only those that share enough with it.
    pub views: usize,
    /// Longer side to which photographs are reduced, pixels.
    pub max_size: usize,
    /// Most planes.
    pub max_planes: usize,
    /// Reference views, spread evenly over the set.
    pub references: usize,
    /// Whether views are weighted by the true visibility instead of the network's (vis-var).
    pub true_visibility: bool,
}

impl Default for Validation {
    fn default() -> Self {
        Self { views: 5, max_size: 512, max_planes: 96, references: 16, true_visibility: false }
    }
}
