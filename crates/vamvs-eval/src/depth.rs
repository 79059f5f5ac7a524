//! How well a depth map agrees with the true one.

use serde::Serialize;
use vamvs_core::{Grid, Size, depth_map::is_valid};

/// Errors of a depth map over the pixels that have a true depth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DepthErrors {
    /// Pixels with a true depth.
    pub true_pixels: usize,
    /// The share of them that has a depth, 0 to 1.
    pub coverage: f64,
    /// The median of |depth − true| / true over the pixels that have both; NaN if there are none.
    pub median_relative: f64,
    /// The mean of the same.
    pub mean_relative: f64,
    /// For each threshold, the share of the pixels that have both within it.
    pub within: Vec<WithinThreshold>,
}

/// How many pixels are within a relative error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WithinThreshold {
    /// The relative error, as a share of the true depth.
    pub relative: f64,
    /// The share of pixels with an error of at most that, 0 to 1; 0 if there are no pixels.
    pub share: f64,
}

/// Depth maps that cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("a depth map of {depth} pixels cannot be compared with a true one of {truth}; resize one of them")]
pub struct SizeMismatch {
    /// Size of the depth map.
    pub depth: Size,
    /// Size of the true one.
    pub truth: Size,
}

/// Compares a depth map with the true one of the same size. Depths that are not finite and positive
/// count as none. `thresholds` are relative errors.
///
/// # Errors
/// If the sizes differ.
pub fn compare_depths(
    depth: &Grid<f32>,
    truth: &Grid<f32>,
    thresholds: &[f64],
) -> Result<DepthErrors, SizeMismatch> {
    if depth.size() != truth.size() {
        return Err(SizeMismatch { depth: depth.size(), truth: truth.size() });
    }
    let with_truth = depth.data().iter().zip(truth.data()).filter(|(_, truth)| is_valid(**truth));
    let true_pixels = with_truth.clone().count();
    let relative = |(depth, truth): (&f32, &f32)| {
        is_valid(*depth).then(|| (f64::from(*depth) - f64::from(*truth)).abs() / f64::from(*truth))
    };
    let mut errors: Vec<f64> = with_truth.filter_map(relative).collect();
    errors.sort_unstable_by(f64::total_cmp);
    Ok(summary(true_pixels, &errors, thresholds))
}

/// Of errors in ascending order.
fn summary(true_pixels: usize, errors: &[f64], thresholds: &[f64]) -> DepthErrors {
    let count = errors.len();
    let share = |part: usize, of: usize| if of == 0 { 0.0 } else { part as f64 / of as f64 };
    let within = |&relative: &f64| {
        let near = errors.partition_point(|&error| error <= relative);
        WithinThreshold { relative, share: share(near, count) }
    };
    DepthErrors {
        true_pixels,
        coverage: share(count, true_pixels),
        median_relative: median(errors),
        mean_relative: errors.iter().sum::<f64>() / count as f64,
        within: thresholds.iter().map(within).collect(),
    }
}

/// Of values in ascending order.
fn median(sorted: &[f64]) -> f64 {
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => f64::NAN,
        len if len % 2 == 1 => sorted[middle],
        _ => 0.5 * (sorted[middle - 1] + sorted[middle]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(values: &[f32]) -> Grid<f32> {
        Grid::from_vec(Size::new(values.len(), 1), values.to_vec())
    }

    #[test]
    fn shares_count_pixels_with_both_depths_and_coverage_those_with_truth() {
        let truth = grid(&[2.0, 2.0, 2.0, 2.0, 2.0, 0.0, f32::NAN, 2.0]);
        let depth = grid(&[2.0, 2.25, 1.5, 4.0, 0.0, 9.0, 9.0, f32::INFINITY]);
        let errors = compare_depths(&depth, &truth, &[0.0, 0.125, 0.2, 0.25, 1.0]).unwrap();
        assert_eq!(errors.true_pixels, 6);
        assert!((errors.coverage - 4.0 / 6.0).abs() < 1e-12);
        assert_eq!(errors.median_relative, 0.5 * (0.125 + 0.25));
        assert_eq!(errors.mean_relative, (0.0 + 0.125 + 0.25 + 1.0) / 4.0);
        let shares: Vec<f64> = errors.within.iter().map(|w| w.share).collect();
        assert_eq!(shares, [0.25, 0.5, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn nothing_in_common_has_no_median() {
        let errors = compare_depths(&grid(&[0.0, 1.0]), &grid(&[1.0, 0.0]), &[0.1]).unwrap();
        assert_eq!(errors.coverage, 0.0);
        assert!(errors.median_relative.is_nan() && errors.mean_relative.is_nan());
        assert_eq!(errors.within, [WithinThreshold { relative: 0.1, share: 0.0 }]);
    }

    #[test]
    fn sizes_must_match() {
        let error = compare_depths(&grid(&[1.0]), &grid(&[1.0, 1.0]), &[]).unwrap_err();
        assert!(error.to_string().contains("1×1") && error.to_string().contains("2×1"));
    }
}
