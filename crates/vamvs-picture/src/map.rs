//! Depth maps and errors as values to paint.

use vamvs_core::Grid;
use vamvs_core::depth_map::is_valid;

/// The valid depths.
#[must_use]
pub fn valid(depth: &Grid<f32>) -> Grid<Option<f32>> {
    depth.map(|&depth| is_valid(depth).then_some(depth))
}

/// |depth − true| / true where both are valid.
#[must_use]
pub fn relative_errors(depth: &Grid<f32>, ground_truth: &Grid<f32>) -> Grid<Option<f32>> {
    let mut ground_truth = ground_truth.data().iter();
    depth.map(|&depth| {
        let ground_truth = *ground_truth.next()?;
        (is_valid(depth) && is_valid(ground_truth)).then(|| (depth - ground_truth).abs() / ground_truth)
    })
}

/// The 1st and 99th percentile of the values, `(low, high)`.
#[must_use]
pub fn spread(values: &Grid<Option<f32>>) -> (f32, f32) {
    let mut values: Vec<f32> = values.data().iter().copied().flatten().collect();
    values.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| values.get((share * values.len().saturating_sub(1) as f64) as usize).copied();
    match (at(0.01), at(0.99)) {
        (Some(low), Some(high)) if low < high => (low, high),
        (Some(low), _) => (low, low + 1.0),
        _ => (0.0, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::Size;

    #[test]
    fn errors_are_where_both_depths_are() {
        let grid = |values: &[f32]| Grid::from_vec(Size::new(values.len(), 1), values.to_vec());
        let errors = relative_errors(&grid(&[1.5, 0.0, 2.0, 2.0]), &grid(&[2.0, 2.0, 0.0, 2.0]));
        assert_eq!(errors.data(), [Some(0.25), None, None, Some(0.0)]);
    }

    #[test]
    fn spread_leaves_out_the_extremes() {
        let values = Grid::from_fn(Size::new(1001, 1), |x, _| (x != 500).then_some(x as f32));
        assert_eq!(spread(&values), (9.0, 990.0));
        assert_eq!(spread(&Grid::filled(Size::new(2, 2), None)), (0.0, 1.0));
    }
}
