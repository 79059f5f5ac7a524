//! The coarse depth map and its confidence, from regularised costs (section 3.2).

use tch::{Kind, TchError, Tensor};

/// A depth map in plane coordinates, with confidence.
#[derive(Debug)]
pub struct PlaneMap {
    /// Depth, (h, w), in plane coordinates.
    pub u: Tensor,
    /// Confidence, (h, w) in [0, 1].
    pub confidence: Tensor,
}

/// The soft-argmin of costs (1, D, h, w); the confidence is the probability of the two planes that enclose it.
///
/// The soft-argmin is taken over all planes, as in the paper, or over those within `window` of the most probable one.
/// The window keeps it from averaging two surfaces at a depth discontinuity.
///
/// # Errors
/// If memory runs out.
pub fn soft_argmin(costs: &Tensor, window: Option<usize>) -> Result<PlaneMap, TchError> {
    let probability = costs.f_select(0, 0)?.f_neg()?.f_softmax(0, Kind::Float)?; // (D, h, w)
    match window {
        None => expectation_and_confidence(&probability),
        Some(window) => {
            let u = windowed_expectation(&probability, window as i64)?;
            Ok(PlaneMap { confidence: probability_near(&probability, &u)?, u })
        }
    }
}

/// Blends costs at a fine stride, (1, D, h, w), with costs at twice that stride, (1, D, h/2, w/2):
/// p · fine + (1 − p) · wide, where p is the confidence of the fine costs.
///
/// # Errors
/// If memory runs out.
pub(crate) fn where_unsure(fine: &Tensor, wide: &Tensor, window: Option<usize>) -> Result<Tensor, TchError> {
    let (_, _, h, w) = fine.size4()?;
    let unsure = soft_argmin(fine, window)?.confidence.f_rsub_scalar(1.0)?;
    fine.f_lerp_tensor(&wide.f_upsample_bilinear2d([h, w], false, None, None)?, &unsure)
}

/// The expected index along dimension 0, and as confidence the probability of the two entries that enclose it:
/// (D, …) → (…).
///
/// # Errors
/// If memory runs out.
pub fn expectation_and_confidence(probability: &Tensor) -> Result<PlaneMap, TchError> {
    let count = probability.size()[0];
    let mut shape = vec![1; probability.dim()];
    shape[0] = -1;
    let index = Tensor::f_arange(count, (Kind::Float, probability.device()))?.f_view(shape.as_slice())?;
    let u = probability.f_mul(&index)?.f_sum_dim_intlist([0].as_slice(), false, Kind::Float)?;
    Ok(PlaneMap { confidence: probability_near(probability, &u)?, u })
}

/// The expected index over the entries of dimension 0 within `window` of the most probable entry: (D, …) → (…).
fn windowed_expectation(probability: &Tensor, window: i64) -> Result<Tensor, TchError> {
    let last = probability.size()[0] - 1;
    let likeliest = probability.f_detach()?.f_argmax(0, true)?;
    let mut mass = likeliest.f_zeros_like()?.f_to_kind(Kind::Float)?;
    let mut moment = mass.shallow_clone();
    for offset in -window..=window {
        let entry = likeliest.f_add_scalar(offset)?;
        let inside = entry.f_ge(0)?.f_logical_and(&entry.f_le(last)?)?.f_to_kind(Kind::Float)?;
        let weight = probability.f_gather(0, &entry.f_clamp(0, last)?, false)?.f_mul(&inside)?;
        mass = mass.f_add(&weight)?;
        moment = moment.f_add(&weight.f_mul_scalar(offset as f64)?)?;
    }
    moment.f_div(&mass)?.f_add(&likeliest)?.f_squeeze_dim(0)
}

/// The probability of the two entries of dimension 0 that enclose `u`: (D, …), (…) → (…).
fn probability_near(probability: &Tensor, u: &Tensor) -> Result<Tensor, TchError> {
    let count = probability.size()[0];
    let below = u.f_detach()?.f_floor()?.f_clamp(0.0, (count - 2).max(0) as f64)?.f_to_kind(Kind::Int64)?;
    let below = below.f_unsqueeze(0)?;
    let above = below.f_add_scalar(1)?.f_clamp_max(count - 1)?;
    let pair = probability.f_gather(0, &below, false)?.f_add(&probability.f_gather(0, &above, false)?)?;
    pair.f_squeeze_dim(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confident_fine_costs_decide_and_others_leave_it_to_wide_ones() {
        let options = (Kind::Float, tch::Device::Cpu);
        // In the left column the fine costs are certain of plane 3. In the right column all ten planes have the same
        // fine cost, so the two that enclose the depth have a fifth of the probability.
        let fine = Tensor::zeros([1, 10, 4, 2], options);
        let _ = fine.narrow(3, 0, 1).fill_(40.0);
        let _ = fine.narrow(3, 0, 1).narrow(1, 3, 1).fill_(0.0);
        let wide = Tensor::full([1, 10, 2, 1], 40.0, options);
        let _ = wide.narrow(1, 7, 1).fill_(0.0);
        let costs = where_unsure(&fine, &wide, Some(2)).unwrap();
        assert!(costs.narrow(3, 0, 1).allclose(&fine.narrow(3, 0, 1), 1e-5, 1e-4, false));
        let right = costs.narrow(3, 1, 1);
        assert!((right.narrow(1, 7, 1).max().double_value(&[])).abs() < 1e-5);
        assert!((right.narrow(1, 2, 1) - 0.8 * 40.0).abs().max().double_value(&[]) < 1e-4);
    }

    #[test]
    fn a_sharp_cost_gives_its_plane_with_full_confidence() {
        let costs = Tensor::full([1, 5, 1, 1], 50.0, (Kind::Float, tch::Device::Cpu));
        let _ = costs.narrow(1, 3, 1).fill_(0.0);
        let map = soft_argmin(&costs, None).unwrap();
        assert!((map.u.double_value(&[0, 0]) - 3.0).abs() < 1e-5);
        assert!((map.confidence.double_value(&[0, 0]) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn two_equal_planes_give_the_middle_and_two_far_ones_no_confidence() {
        let costs = |low: [i64; 2]| {
            let costs = Tensor::full([1, 7, 1, 1], 50.0, (Kind::Float, tch::Device::Cpu));
            for plane in low {
                let _ = costs.narrow(1, plane, 1).fill_(0.0);
            }
            soft_argmin(&costs, None).unwrap()
        };
        let (near, far) = (costs([2, 3]), costs([0, 6]));
        assert!((near.u.double_value(&[0, 0]) - 2.5).abs() < 1e-5);
        assert!((near.confidence.double_value(&[0, 0]) - 1.0).abs() < 1e-5);
        assert!((far.u.double_value(&[0, 0]) - 3.0).abs() < 1e-5);
        assert!(far.confidence.double_value(&[0, 0]) < 1e-5);
    }

    #[test]
    fn near_the_likeliest_plane_another_surface_does_not_count() {
        // Two thirds on planes 5 and 6, a third on plane 1.
        let probability = [0.0_f32, 1.0 / 3.0, 0.0, 0.0, 0.0, 0.4, 4.0 / 15.0];
        let costs = Tensor::from_slice(&probability).log().neg().view([1, 7, 1, 1]);
        let (all, near) = (soft_argmin(&costs, None).unwrap(), soft_argmin(&costs, Some(2)).unwrap());
        assert!((all.u.double_value(&[0, 0]) - (1.0 / 3.0 + 2.0 + 1.6)).abs() < 1e-5);
        assert!((near.u.double_value(&[0, 0]) - 5.4).abs() < 1e-5);
        assert!((near.confidence.double_value(&[0, 0]) - 2.0 / 3.0).abs() < 1e-5);
    }
}
