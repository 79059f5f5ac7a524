//! The loss (equations 8 and 9).

use tch::{Kind, Reduction, TchError, Tensor};
use vamvs_net::cascade::Parents;

use crate::forward::{Learning, Output, PlaneCosts, StageOutput};
use crate::options::LossOptions;

/// With cross entropy, equation 8 applies to coarse depths with at most this error, in plane distances.
const NEAR: f64 = 2.0;

/// Weight of [`parents_loss`].
const PARENTS: f64 = 0.5;

/// A depth that is off by this many plane distances is of another surface; farther ones are no worse.
const ANOTHER_SURFACE: f64 = 4.0;

/// The losses of one sample.
pub struct Losses {
    /// The minimised loss, the weighted sum of all trained parts; `None` if there is no ground truth for any of them.
    pub total: Option<Tensor>,
    /// Mean |u − u_gt| / s of each stage, coarse first; NaN without ground truth.
    pub stages: Vec<f64>,
    /// Mean |V − V_gt|; NaN without ground truth.
    pub visibility: f64,
}

/// Compares a network's output with the ground truth; `hypotheses` is m, the number to each side of a point. Stages
/// that are not trained are compared, but are not part of the minimised loss.
///
/// # Errors
/// If memory runs out.
pub fn losses(
    output: &Output,
    hypotheses: usize,
    learning: Learning,
    options: &LossOptions,
) -> Result<Losses, TchError> {
    let coarse_learns = learning != Learning::Flow;
    let mut total = Sum::default();
    let mut stages = Vec::new();
    for stage in &output.stages {
        let reach = options.flow_reach * hypotheses.max(1) as f64 * stage.step;
        let loss = stage_loss(stage, reach)?;
        stages.push(loss.as_ref().map_or(f64::NAN, value));
        match &stage.costs {
            Some(_) if !coarse_learns => (),
            Some(PlaneCosts { costs, true_plane }) if options.cross_entropy > 0.0 => {
                total.add(cross_entropy(costs, true_plane)?, options.cross_entropy)?;
                total.add(near_loss(stage)?, 1.0)?;
            }
            _ => total.add(loss, 1.0)?,
        }
    }
    let mut masks = Sum::default();
    for (mask, ground_truth) in &output.visibility {
        masks.add(mean_difference(mask, ground_truth, None)?, 1.0 / output.visibility.len() as f64)?;
    }
    let visibility = masks.0.as_ref().map_or(f64::NAN, value);
    let surface = match &output.surface {
        Some((surface, ground_truth)) => surface_loss(surface, ground_truth)?,
        None => None,
    };
    let parents = match &output.parents {
        Some((parents, ground_truth)) => parents_loss(parents, ground_truth)?,
        None => None,
    };
    if coarse_learns {
        total.add(masks.0, options.visibility)?;
        total.add(surface, options.surface)?;
        total.add(parents, PARENTS)?;
    }
    Ok(Losses { total: total.0, stages, visibility })
}

/// Equation 8 for one stage: mean |u − u_gt| / s over pixels with known ground truth. If `reach` > 0, a flow iteration
/// counts only pixels where the error of the depth before it is at most `reach` plane distances.
fn stage_loss(stage: &StageOutput, reach: f64) -> Result<Option<Tensor>, TchError> {
    let within = match &stage.before {
        Some(before) if reach > 0.0 => Some(before.f_sub(&stage.ground_truth)?.f_abs()?.f_le(reach)?),
        _ => None,
    };
    let loss = mean_difference(&stage.u, &stage.ground_truth, within.as_ref())?;
    loss.map(|loss| loss.f_div_scalar(stage.step)).transpose()
}

/// Mean |u − u_gt| / s of a stage with planes over the pixels where it is at most `NEAR` distances of its planes.
fn near_loss(stage: &StageOutput) -> Result<Option<Tensor>, TchError> {
    let near = stage.u.f_detach()?.f_sub(&stage.ground_truth)?.f_abs()?.f_le(NEAR * stage.step)?;
    let loss = mean_difference(&stage.u, &stage.ground_truth, Some(&near))?;
    loss.map(|loss| loss.f_div_scalar(stage.step)).transpose()
}

/// The expected error of a coarse pixel's depth, drawn by its share, at most `ANOTHER_SURFACE`, over the pixels whose depth is known.
fn parents_loss(parents: &Parents, ground_truth: &Tensor) -> Result<Option<Tensor>, TchError> {
    let known = ground_truth.f_isnan()?.f_logical_not()?;
    if known.f_sum(Kind::Int64)?.int64_value(&[]) == 0 {
        return Ok(None);
    }
    let error = parents.depths.f_sub(ground_truth)?.f_abs()?.f_clamp_max(ANOTHER_SURFACE)?;
    let error = error.f_nan_to_num(0.0, None, None)?; // zero times NaN would be NaN
    let expected = parents.shares.f_mul(&error)?.f_sum_dim_intlist([0].as_slice(), false, Kind::Float)?;
    Ok(Some(expected.f_masked_select(&known)?.f_mean(Kind::Float)?))
}

/// The binary cross entropy of the probability of a surface where it is known whether there is one.
fn surface_loss(surface: &Tensor, ground_truth: &Tensor) -> Result<Option<Tensor>, TchError> {
    let known = ground_truth.f_isnan()?.f_logical_not()?;
    if known.f_sum(Kind::Int64)?.int64_value(&[]) == 0 {
        return Ok(None);
    }
    let (surface, ground_truth) = (surface.f_masked_select(&known)?, ground_truth.f_masked_select(&known)?);
    Ok(Some(surface.f_binary_cross_entropy::<Tensor>(&ground_truth, None, Reduction::Mean)?))
}

/// Mean of −Σ t log p over the pixels with known ground truth inside the range, where t divides a pixel linearly
/// between the two planes that enclose its ground truth. Costs (D, h, w); ground truth (h, w), NaN where unknown.
fn cross_entropy(costs: &Tensor, ground_truth: &Tensor) -> Result<Option<Tensor>, TchError> {
    let last = costs.size()[0] - 1;
    // Comparisons with NaN are false.
    let known = ground_truth.f_ge(0.0)?.f_logical_and(&ground_truth.f_le(last as f64)?)?;
    let count = known.f_sum(Kind::Int64)?.int64_value(&[]);
    if count == 0 {
        return Ok(None);
    }
    let logs = costs.f_neg()?.f_log_softmax(0, Kind::Float)?.f_flatten(1, -1)?; // (D, P)
    let index = known.f_flatten(0, -1)?.f_nonzero()?.f_squeeze_dim(1)?;
    let logs = logs.f_index_select(1, &index)?;
    let ground_truth = ground_truth.f_flatten(0, -1)?.f_index_select(0, &index)?.f_unsqueeze(0)?;
    let below = ground_truth.f_floor()?.f_clamp(0.0, (last - 1) as f64)?;
    let above_share = ground_truth.f_sub(&below)?;
    let below = below.f_to_kind(Kind::Int64)?;
    let (low, high) = (logs.f_gather(0, &below, false)?, logs.f_gather(0, &below.f_add_scalar(1)?, false)?);
    let mean = low.f_lerp_tensor(&high, &above_share)?;
    Ok(Some(mean.f_mean(Kind::Float)?.f_neg()?))
}

/// Mean |a − b| over the pixels where b is not NaN and `within`, if given, is true; `None` if there are none.
fn mean_difference(a: &Tensor, b: &Tensor, within: Option<&Tensor>) -> Result<Option<Tensor>, TchError> {
    let mut known = b.f_isnan()?.f_logical_not()?;
    if let Some(within) = within {
        known = known.f_logical_and(within)?;
    }
    let count = known.f_sum(Kind::Int64)?.int64_value(&[]);
    if count == 0 {
        return Ok(None);
    }
    let difference = a.f_masked_select(&known)?.f_sub(&b.f_masked_select(&known)?)?;
    Ok(Some(difference.f_abs()?.f_mean(Kind::Float)?))
}

fn value(loss: &Tensor) -> f64 {
    loss.double_value(&[])
}

/// A weighted sum that begins empty.
#[derive(Default)]
struct Sum(Option<Tensor>);

impl Sum {
    fn add(&mut self, term: Option<Tensor>, weight: f64) -> Result<(), TchError> {
        let Some(term) = term else { return Ok(()) };
        let term = term.f_mul_scalar(weight)?;
        self.0 = Some(match self.0.take() {
            Some(sum) => sum.f_add(&term)?,
            None => term,
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(u: &[f32], before: &[f32], ground_truth: &[f32], step: f64) -> StageOutput {
        let row = |values: &[f32]| Tensor::from_slice(values).view([1, -1]);
        let before = (!before.is_empty()).then(|| row(before));
        StageOutput { u: row(u), costs: None, before, ground_truth: row(ground_truth), step }
    }

    fn plane_costs(stage: &StageOutput, costs: Tensor) -> PlaneCosts {
        PlaneCosts { costs, true_plane: stage.ground_truth.shallow_clone() }
    }

    #[test]
    fn surfaces_are_learned_where_it_is_known_whether_there_is_one() {
        let nan = f32::NAN;
        let surface = Tensor::from_slice(&[0.9_f32, 0.2, 0.6]);
        let ground_truth = |values: [f32; 3]| Some((surface.shallow_clone(), Tensor::from_slice(&values)));
        let output = |surface| Output { stages: Vec::new(), visibility: Vec::new(), surface, parents: None };
        let options = LossOptions { surface: 0.5, ..LossOptions::default() };
        let total =
            |ground_truth, learning| losses(&output(ground_truth), 2, learning, &options).unwrap().total;
        let found = value(&total(ground_truth([1.0, 0.0, nan]), Learning::Coarse).unwrap());
        let expected = -0.5 * (0.9_f64.ln() + 0.8_f64.ln()) / 2.0;
        assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
        assert!(total(ground_truth([nan; 3]), Learning::Coarse).is_none());
        assert!(
            total(ground_truth([1.0, 0.0, nan]), Learning::Flow).is_none(),
            "the flow does not change it"
        );
    }

    #[test]
    fn of_the_pixels_around_those_of_the_same_surface_are_chosen() {
        let depths = Tensor::from_slice(&[1.0_f32, 1.0, 2.0, 2.0, 20.0, 20.0]).view([3, 1, 2]);
        let shares = Tensor::from_slice(&[0.5_f32, 0.5, 0.25, 0.25, 0.25, 0.25]).view([3, 1, 2]);
        let ground_truth = Tensor::from_slice(&[1.5_f32, f32::NAN]).view([1, 2]);
        let parents = Parents { depths, shares: shares.set_requires_grad(true) };
        let found = parents_loss(&parents, &ground_truth).unwrap().unwrap();
        assert!((value(&found) - (0.75 * 0.5 + 0.25 * 4.0)).abs() < 1e-6, "{}", value(&found));
        found.backward();
        let slopes: Vec<f32> = parents.shares.grad().flatten(0, -1).try_into().unwrap();
        assert_eq!(
            slopes,
            [0.5, 0.0, 0.5, 0.0, 4.0, 0.0],
            "the far one is pushed away, the unknown pixel is left"
        );
    }

    #[test]
    fn each_stage_is_in_units_of_its_hypotheses_and_unknown_pixels_do_not_count() {
        let nan = f32::NAN;
        let output = Output {
            stages: vec![
                stage(&[1.0, 2.0, 9.0], &[], &[2.0, 4.0, nan], 1.0),
                stage(&[1.0, 2.0, 9.0], &[1.0, 2.0, 0.0], &[1.5, 12.0, nan], 0.5),
            ],
            visibility: vec![
                (Tensor::from_slice(&[0.5_f32, 1.0]), Tensor::from_slice(&[1.0_f32, nan])),
                (Tensor::from_slice(&[0.0_f32, 0.9]), Tensor::from_slice(&[0.0_f32, 1.0])),
            ],
            surface: None,
            parents: None,
        };
        let options = LossOptions { visibility: 0.1, flow_reach: 2.0, cross_entropy: 0.0, surface: 0.0 };
        let losses = losses(&output, 2, Learning::All, &options).unwrap();
        assert!((losses.stages[0] - 1.5).abs() < 1e-6);
        assert!((losses.stages[1] - 1.0).abs() < 1e-6, "10 planes off is out of reach: {:?}", losses.stages);
        assert!((losses.visibility - (0.5 + 0.05) / 2.0).abs() < 1e-6);
        let total = value(&losses.total.unwrap());
        assert!((total - (1.5 + 1.0 + 0.0275)).abs() < 1e-5, "{total}");
    }

    #[test]
    fn where_the_flow_learns_alone_its_loss_alone_is_minimised() {
        let mut coarse = stage(&[1.0], &[], &[2.0], 1.0);
        coarse.costs = Some(plane_costs(&coarse, Tensor::zeros([8, 1, 1], (Kind::Float, tch::Device::Cpu))));
        let mask = (Tensor::from_slice(&[0.5_f32]), Tensor::from_slice(&[1.0_f32]));
        let output = Output {
            stages: vec![coarse, stage(&[1.5], &[1.0], &[2.0], 1.0)],
            visibility: vec![mask],
            surface: None,
            parents: None,
        };
        let losses = losses(&output, 2, Learning::Flow, &LossOptions::default()).unwrap();
        assert_eq!((losses.stages, losses.visibility), (vec![1.0, 0.5], 0.5));
        assert_eq!(value(&losses.total.unwrap()), 0.5);
    }

    #[test]
    fn without_truth_there_is_nothing_to_learn() {
        let output = Output {
            stages: vec![stage(&[1.0], &[], &[f32::NAN], 1.0)],
            visibility: Vec::new(),
            surface: None,
            parents: None,
        };
        let losses = losses(&output, 2, Learning::All, &LossOptions::default()).unwrap();
        assert!(losses.total.is_none() && losses.stages[0].is_nan());
    }

    #[test]
    fn cross_entropy_shares_a_pixel_between_the_planes_around_its_depth() {
        // (D, 1, 4): depths between two planes, on one, outside of the range, unknown.
        let probability = [[0.1_f32, 0.2, 0.5, 0.3], [0.3, 0.2, 0.3, 0.3], [0.6, 0.6, 0.2, 0.4]];
        let costs = Tensor::from_slice2(&probability).log().neg().view([3, 1, 4]);
        let ground_truth = Tensor::from_slice(&[1.25_f32, 2.0, 2.5, f32::NAN]).view([1, 4]);
        let loss = value(&cross_entropy(&costs, &ground_truth).unwrap().unwrap());
        let expected = -(0.75 * 0.3_f64.ln() + 0.25 * 0.6_f64.ln() + 0.6_f64.ln()) / 2.0;
        assert!((loss - expected).abs() < 1e-6, "{loss} is not {expected}");
        let unknown = Tensor::full([1, 4], f64::NAN, (Kind::Float, tch::Device::Cpu));
        assert!(cross_entropy(&costs, &unknown).unwrap().is_none());
    }

    #[test]
    fn with_cross_entropy_a_coarse_depth_far_off_pulls_on_probabilities_alone() {
        let costs = Tensor::zeros([8, 1, 2], (Kind::Float, tch::Device::Cpu));
        let mut coarse = stage(&[1.0, 6.5], &[], &[7.0, 6.0], 1.0);
        coarse.costs = Some(plane_costs(&coarse, costs));
        let output = Output { stages: vec![coarse], visibility: Vec::new(), surface: None, parents: None };
        let options = LossOptions { cross_entropy: 0.5, ..LossOptions::default() };
        let total = value(&losses(&output, 2, Learning::Coarse, &options).unwrap().total.unwrap());
        assert!((total - (0.5 * 8.0_f64.ln() + 0.5)).abs() < 1e-6, "{total}");
    }
}
