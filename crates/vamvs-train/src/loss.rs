//! What is minimised: equations 8 and 9.

use tch::{Kind, TchError, Tensor};

use crate::forward::{Output, StageOutput};
use crate::options::LossOptions;

/// The losses of one sample.
pub struct Losses {
    /// What is minimised: the sum of all, weighted; `None` if nothing is known of the sample.
    pub total: Option<Tensor>,
    /// Mean |u − u_gt| / s for each stage, coarse first; NaN where nothing is known.
    pub stages: Vec<f64>,
    /// Mean |V − V_gt|; NaN without masks.
    pub visibility: f64,
}

/// Compares a network's output with the truth; `hypotheses` to each side of a point (m).
///
/// # Errors
/// If memory runs out.
pub fn losses(output: &Output, hypotheses: usize, options: &LossOptions) -> Result<Losses, TchError> {
    let mut total = Sum::default();
    let mut stages = Vec::new();
    for stage in &output.stages {
        let reach = options.flow_reach * hypotheses.max(1) as f64 * stage.step;
        let loss = stage_loss(stage, reach)?;
        stages.push(loss.as_ref().map_or(f64::NAN, value));
        total.add(loss, 1.0)?;
    }
    let mut masks = Sum::default();
    for (mask, truth) in &output.visibility {
        masks.add(mean_difference(mask, truth, None)?, 1.0 / output.visibility.len() as f64)?;
    }
    let visibility = masks.0.as_ref().map_or(f64::NAN, value);
    total.add(masks.0, options.visibility)?;
    Ok(Losses { total: total.0, stages, visibility })
}

/// Equation 8 for one stage: mean |u − u_gt| / s over pixels with a known truth; with `reach` > 0 those
/// only where the depth before is within it.
fn stage_loss(stage: &StageOutput, reach: f64) -> Result<Option<Tensor>, TchError> {
    let within = match &stage.before {
        Some(before) if reach > 0.0 => Some(before.f_sub(&stage.truth)?.f_abs()?.f_le(reach)?),
        _ => None,
    };
    let loss = mean_difference(&stage.u, &stage.truth, within.as_ref())?;
    loss.map(|loss| loss.f_div_scalar(stage.step)).transpose()
}

/// Mean |a − b| where b is a number (and `within` holds); `None` if that is nowhere.
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

    fn stage(u: &[f32], before: &[f32], truth: &[f32], step: f64) -> StageOutput {
        let row = |values: &[f32]| Tensor::from_slice(values).view([1, -1]);
        let before = (!before.is_empty()).then(|| row(before));
        StageOutput { u: row(u), before, truth: row(truth), step }
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
        };
        let options = LossOptions { visibility: 0.1, flow_reach: 2.0 };
        let losses = losses(&output, 2, &options).unwrap();
        assert!((losses.stages[0] - 1.5).abs() < 1e-6);
        assert!((losses.stages[1] - 1.0).abs() < 1e-6, "10 planes off is out of reach: {:?}", losses.stages);
        assert!((losses.visibility - (0.5 + 0.05) / 2.0).abs() < 1e-6);
        let total = value(&losses.total.unwrap());
        assert!((total - (1.5 + 1.0 + 0.0275)).abs() < 1e-5, "{total}");
    }

    #[test]
    fn without_truth_there_is_nothing_to_learn() {
        let output = Output { stages: vec![stage(&[1.0], &[], &[f32::NAN], 1.0)], visibility: Vec::new() };
        let losses = losses(&output, 2, &LossOptions::default()).unwrap();
        assert!(losses.total.is_none() && losses.stages[0].is_nan());
    }
}
