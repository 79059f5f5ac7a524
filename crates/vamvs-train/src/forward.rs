//! The forward pass: runs the network on a sample, stage by stage, with gradients.
//!
//! Of the maps finer than the coarse one, only one dilation phase is computed (see [`vamvs_net::point_flow`]). A
//! pixel's depth depends on its own phase alone, and a phase at 1/2 depends on one phase at 1/4 and on the whole map
//! at 1/8. So an iteration at any scale costs as much as one at 1/8, and its results are exactly those that the whole
//! map would have at these pixels.

use tch::Tensor;
use vamvs_net::cascade::Parents;
use vamvs_net::{Estimator, Iteration, Profile};

use crate::TrainError;
use crate::sample::Sample;

/// The output of a stage, with the ground truth at the same pixels. Depths are in plane coordinates.
pub struct StageOutput {
    /// The depth, (h, w).
    pub u: Tensor,
    /// The costs of the planes; `None` for flow iterations.
    pub costs: Option<PlaneCosts>,
    /// The depth that the stage refines, (h, w); `None` for the coarse stage.
    pub before: Option<Tensor>,
    /// The ground truth, (h, w), NaN where unknown.
    pub ground_truth: Tensor,
    /// Distance s between the stage's hypotheses, in plane distances; 1 for the coarse stage.
    pub step: f64,
}

/// The costs of the planes of a stage, and where among them the ground truth lies.
pub struct PlaneCosts {
    /// (D, h, w); a low cost is likely.
    pub costs: Tensor,
    /// The number of the plane at the ground truth, with fractions, (h, w); NaN where unknown. It may be outside of the planes.
    pub true_plane: Tensor,
}

/// The output of all stages.
pub struct Output {
    /// The stages, coarse first.
    pub stages: Vec<StageOutput>,
    /// vis-var and vis-corr: the visibility masks (h, w) in [0, 1], each with its ground truth (NaN where unknown), of
    /// the source views for which the scene has visibility.
    pub visibility: Vec<(Tensor, Tensor)>,
    /// Of a cascade: the probability that a pixel shows a surface inside the depth range, (h, w), and whether it does: 1, 0,
    /// or NaN where that is unknown.
    pub surface: Option<(Tensor, Tensor)>,
    /// Of a cascade: the coarse pixels from which the second stage's middle depths were enlarged, with the ground truth,
    /// (h, w), NaN where unknown.
    pub parents: Option<(Parents, Tensor)>,
}

/// Which stages are run, and which of them are trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Learning {
    /// Only the coarse stage is run and trained.
    Coarse,
    /// Both are run, only the flow is trained.
    Flow,
    /// Both are run and trained.
    All,
}

/// Runs the coarse stage and, unless only that one is trained, the flow iterations: the given ones, or else the
/// estimator's.
///
/// # Errors
/// If the module breaks its contract, the scene lacks the visibility that is asked for, or memory runs out.
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
    let feature_stride = network.manifest().feature_stride;
    let cascade = network.manifest().cascade;
    let stride = if cascade.is_some() { 2 * feature_stride } else { feature_stride };
    let all = DilationPhase { enlarge, stride, scale: stride, first: (0, 0) };
    let fine = match cascade {
        Some(cascade) => {
            let fine = estimator.fine(reference, &sources, &sample.planes, &coarse, profile)?;
            Some((cascade, fine))
        }
        None => None,
    };
    let mut u = coarse.map.u.shallow_clone();
    let ground_truth = all.ground_truth(sample, &u)?;
    let mut stages = vec![StageOutput {
        u: coarse.map.u,
        costs: Some(PlaneCosts {
            costs: coarse.costs.f_squeeze_dim(0)?,
            true_plane: ground_truth.shallow_clone(),
        }),
        ground_truth,
        before: None,
        step: 1.0,
    }];
    let (mut surface, mut parents) = (None, None);
    if let Some((cascade, fine)) = fine {
        let all = DilationPhase { stride: feature_stride, scale: feature_stride, ..all };
        let ground_truth = all.ground_truth(sample, &fine.map.u)?;
        let from_middle = ground_truth.f_sub(&fine.around)?.f_div_scalar(cascade.step)?;
        let true_plane = from_middle.f_add_scalar(0.5 * (cascade.planes - 1) as f64)?;
        surface = Some((fine.surface.shallow_clone(), all.is_surface(sample, &fine.surface)?));
        parents = Some((fine.parents, ground_truth.shallow_clone()));
        stages.push(StageOutput {
            u: fine.map.u,
            costs: Some(PlaneCosts { costs: fine.costs.f_squeeze_dim(0)?, true_plane }),
            before: None,
            ground_truth,
            step: cascade.step,
        });
    }
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
    Ok(Output { visibility, stages, surface, parents })
}

/// Iterations with scales relative to the enlarged photograph that the network sees, without those coarser than the
/// coarse depth map.
fn as_seen(iterations: &[Iteration], enlarge: usize, stride: usize) -> Vec<Iteration> {
    let seen = iterations.iter().map(|i| Iteration { scale: i.scale * enlarge, ..*i });
    seen.filter(|iteration| iteration.scale <= stride).collect()
}

/// The pixels of a map at 1/scale whose coordinates are ≡ `first` modulo stride / scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DilationPhase {
    /// The factor by which the photograph is enlarged for the network.
    enlarge: usize,
    /// The stride of the coarse features.
    stride: usize,
    scale: usize,
    first: (usize, usize),
}

impl DilationPhase {
    /// The phase at `scale` that contains the parents of a phase at the finest scale, which `choice`, two numbers in
    /// [0, 1), selects.
    fn of(stride: usize, [scale, finest]: [usize; 2], choice: [f64; 2]) -> Self {
        let chosen = choice.map(|share| (share * (stride / finest) as f64) as usize);
        let [x, y] = chosen.map(|first| first * finest / scale);
        Self { enlarge: 1, stride, scale, first: (x, y) }
    }

    /// Coordinates in the photograph, along one axis, of the centres of the phase's first `count` pixels.
    fn centres(self, first: usize, count: i64) -> Vec<f64> {
        let (step, pixel) = (self.stride / self.scale, self.scale as f64 / self.enlarge as f64);
        (0..count as usize).map(|k| ((first + k * step) as f64 + 0.5) * pixel).collect()
    }

    fn places(self, like: &Tensor) -> Result<[Vec<f64>; 2], TrainError> {
        let (height, width) = like.size2()?;
        Ok([self.centres(self.first.0, width), self.centres(self.first.1, height)])
    }

    /// Whether the phase's pixels show a surface inside the range of the planes, in the shape of `like`: 1, 0, or NaN where
    /// that is unknown.
    fn is_surface(self, sample: &Sample, like: &Tensor) -> Result<Tensor, TrainError> {
        let [xs, ys] = self.places(like)?;
        let surface = sample.ground_truth.surfaces(&xs, &ys, &sample.planes);
        Ok(Tensor::f_from_slice(&surface)?.f_view_as(like)?.f_to_device(like.device())?)
    }

    /// The ground truth at the phase's pixels, in plane coordinates, in the shape of `like`; NaN where unknown.
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
