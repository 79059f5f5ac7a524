//! The network on a sample, stage by stage, with gradients.
//!
//! Fine maps are learnt from one dilation phase of pixels (see [`vamvs_net::point_flow`]): a pixel's depth
//! depends on its own dilation phase alone, and the pixel of one dilation phase at 1/2 on one dilation phase at 1/4 and the
//! whole map at 1/8. So all iterations cost as much as one at 1/8, and their results are exactly those of
//! the whole maps at these pixels.

use tch::Tensor;
use vamvs_net::{Estimator, Iteration, Profile};

use crate::TrainError;
use crate::sample::Sample;

/// What a stage gives, with the ground truth at the same pixels.
pub struct StageOutput {
    /// (h, w), plane coordinates.
    pub u: Tensor,
    /// (D, h, w), what each plane costs; `None` for flow iterations.
    pub costs: Option<Tensor>,
    /// (h, w), the depth that the stage was given; `None` for the coarse stage.
    pub before: Option<Tensor>,
    /// (h, w), NaN where unknown.
    pub ground_truth: Tensor,
    /// The distance between its hypotheses, in plane distances (s).
    pub step: f64,
}

/// What all stages give.
pub struct Output {
    /// Coarse first.
    pub stages: Vec<StageOutput>,
    /// vis-var: each source view's mask (h, w) in [0, 1] with its ground truth, where that is known.
    pub visibility: Vec<(Tensor, Tensor)>,
}

/// Which stages are run, and which of them learn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Learning {
    /// The coarse stage, without the flow.
    Coarse,
    /// The flow, on coarse maps as they are.
    Flow,
    /// Both.
    All,
}

/// Runs the coarse stage, and unless it learns alone the flow iterations too: those given, or else the estimator's.
///
/// # Errors
/// If the module breaks its contract, a file is wrong, or memory runs out.
pub fn forward(
    estimator: &Estimator,
    sample: &Sample,
    (learning, iterations): (Learning, Option<&[Iteration]>),
    profile: &mut Profile,
) -> Result<Output, TrainError> {
    let network = estimator.network();
    let views = sample.encode(network)?;
    let (reference, sources) = (&views[0], views[1..].iter().collect::<Vec<_>>());
    let seen = sample.masks(network, reference)?;
    let coarse = || estimator.coarse(reference, &sources, &sample.planes, seen, profile);
    let coarse = if learning == Learning::Flow { tch::no_grad(coarse)? } else { coarse()? };
    let enlarge = network.enlarge();
    let stride = network.manifest().feature_stride;
    let all = DilationPhase { enlarge, stride, scale: stride, first: (0, 0) };
    let mut u = coarse.map.u.shallow_clone();
    let mut stages = vec![StageOutput {
        ground_truth: all.ground_truth(sample, &u)?,
        u: coarse.map.u,
        costs: Some(coarse.costs.f_squeeze_dim(0)?),
        before: None,
        step: 1.0,
    }];
    let iterations = match iterations {
        _ if learning == Learning::Coarse => Vec::new(),
        None => estimator.iterations(),
        Some(given) => as_seen(given, enlarge, stride),
    };
    let finest = iterations.last().map_or(stride, |iteration| iteration.scale);
    for &iteration in &iterations {
        let phase =
            DilationPhase { enlarge, ..DilationPhase::of(stride, [iteration.scale, finest], sample.phase) };
        let stage = estimator.flow_stage(reference, &sources, &sample.planes, &coarse.visibility, iteration);
        let refined = stage.refine_phase(phase.first, &u, profile)?.u;
        stages.push(StageOutput {
            ground_truth: phase.ground_truth(sample, &refined)?,
            u: refined.shallow_clone(),
            costs: None,
            before: Some(u.detach()),
            step: iteration.step,
        });
        u = refined;
    }
    let mut visibility = Vec::new();
    for (source, mask) in coarse.visibility.iter().enumerate() {
        let mask = mask.f_squeeze()?;
        if let Some(ground_truth) = sample.seen(source, &all.places(&mask)?, &mask)? {
            visibility.push((mask, ground_truth));
        }
    }
    Ok(Output { visibility, stages })
}

/// Iterations with the scales of the photograph as the network sees it, without those coarser than the coarse map.
fn as_seen(iterations: &[Iteration], enlarge: usize, stride: usize) -> Vec<Iteration> {
    let seen = iterations.iter().map(|i| Iteration { scale: i.scale * enlarge, ..*i });
    seen.filter(|iteration| iteration.scale <= stride).collect()
}

/// Pixels of a map at 1/scale whose coordinates are ≡ `first` modulo stride / scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DilationPhase {
    /// How many times larger the network sees the photograph.
    enlarge: usize,
    /// The stride of the coarse features.
    stride: usize,
    scale: usize,
    first: (usize, usize),
}

impl DilationPhase {
    /// The dilation phase at `scale` that contains the parents of one dilation phase at the finest scale, which two
    /// numbers in [0, 1) choose.
    fn of(stride: usize, [scale, finest]: [usize; 2], choice: [f64; 2]) -> Self {
        let chosen = choice.map(|share| (share * (stride / finest) as f64) as usize);
        let [x, y] = chosen.map(|first| first * finest / scale);
        Self { enlarge: 1, stride, scale, first: (x, y) }
    }

    /// Coordinates in the photograph of the centres of `count` of the dilation phase's pixels along an axis.
    fn centres(self, first: usize, count: i64) -> Vec<f64> {
        let (step, pixel) = (self.stride / self.scale, self.scale as f64 / self.enlarge as f64);
        (0..count as usize).map(|k| ((first + k * step) as f64 + 0.5) * pixel).collect()
    }

    fn places(self, like: &Tensor) -> Result<[Vec<f64>; 2], TrainError> {
        let (height, width) = like.size2()?;
        Ok([self.centres(self.first.0, width), self.centres(self.first.1, height)])
    }

    /// The true plane coordinates at the pixels of a map.
    fn ground_truth(self, sample: &Sample, like: &Tensor) -> Result<Tensor, TrainError> {
        let [xs, ys] = self.places(like)?;
        let ground_truth = sample.ground_truth.coordinates(&xs, &ys, &sample.planes);
        Ok(Tensor::f_from_slice(&ground_truth)?.f_view_as(like)?.f_to_device(like.device())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattices_of_all_scales_hold_the_parents_of_the_finest_pixels() {
        for choice in [[0.0, 0.0], [0.3, 0.6], [0.99, 0.5]] {
            for stride in [8, 4] {
                let fine = DilationPhase::of(stride, [2, 2], choice);
                for scale in [8, 4, 2].into_iter().filter(|scale| *scale <= stride) {
                    let phase = DilationPhase::of(stride, [scale, 2], choice);
                    let step = stride / scale;
                    for k in 0..3 {
                        let parent = (fine.first.0 + stride / 2 * k) * 2 / scale;
                        assert_eq!(parent, phase.first.0 + k * step, "column {k} at 1/{scale}");
                    }
                }
            }
        }
    }

    #[test]
    fn iterations_are_those_of_the_photograph_as_the_network_sees_it() {
        let [eighth, quarter] = [(8, 0.75), (4, 0.375)].map(|(scale, step)| Iteration { scale, step });
        assert_eq!(as_seen(&[eighth, quarter], 1, 8), [eighth, quarter]);
        assert_eq!(as_seen(&[eighth, quarter], 2, 8), [Iteration { scale: 8, ..quarter }]);
    }

    #[test]
    fn centres_are_in_the_photographs_coordinates() {
        let phase = DilationPhase { enlarge: 1, stride: 8, scale: 2, first: (3, 0) };
        assert_eq!(phase.centres(3, 2), [7.0, 15.0]);
        assert_eq!(
            DilationPhase { enlarge: 1, stride: 8, scale: 8, first: (0, 0) }.centres(0, 2),
            [4.0, 12.0]
        );
        assert_eq!(
            DilationPhase { enlarge: 2, stride: 8, scale: 8, first: (0, 0) }.centres(0, 2),
            [2.0, 6.0]
        );
    }
}
