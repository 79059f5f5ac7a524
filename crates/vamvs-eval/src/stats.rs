//! Mean and median of many values.

use std::cmp::Ordering;

use serde::Serialize;

/// Number, mean and median of values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// How many there are.
    pub count: usize,
    /// Their mean; NaN if there are none.
    pub mean: f64,
    /// Their median (the mean of the middle two, if their number is even); NaN if there are none.
    pub median: f64,
}

impl Spread {
    /// The spread of values, which may be in any order.
    #[must_use]
    pub fn of(values: Vec<f64>) -> Self {
        Self::in_order(values, f64::total_cmp)
    }

    /// As [`Spread::of`], of values in single precision, which take half the memory; sums are in double precision.
    pub(crate) fn of_singles(values: Vec<f32>) -> Self {
        Self::in_order(values, f32::total_cmp)
    }

    fn in_order<T: Copy + Into<f64>>(mut values: Vec<T>, compare: fn(&T, &T) -> Ordering) -> Self {
        let mean = values.iter().copied().map(Into::into).sum::<f64>() / values.len() as f64;
        Self { count: values.len(), mean, median: median(&mut values, compare) }
    }
}

fn median<T: Copy + Into<f64>>(values: &mut [T], compare: fn(&T, &T) -> Ordering) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return f64::NAN;
    }
    let odd = values.len() % 2 == 1;
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, compare);
    let upper: f64 = upper.into();
    let lower = below.iter().copied().map(Into::into).fold(f64::NEG_INFINITY, f64::max);
    if odd { upper } else { 0.5 * (upper + lower) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_odd_and_even_numbers_of_values() {
        assert_eq!(Spread::of(vec![5.0, 1.0, 3.0]), Spread { count: 3, mean: 3.0, median: 3.0 });
        assert_eq!(Spread::of(vec![9.0, 1.0, 3.0, 5.0]), Spread { count: 4, mean: 4.5, median: 4.0 });
        assert_eq!(Spread::of_singles(vec![9.0, 1.0, 3.0, 5.0]), Spread { count: 4, mean: 4.5, median: 4.0 });
        let none = Spread::of(Vec::new());
        assert!(none.count == 0 && none.mean.is_nan() && none.median.is_nan());
    }
}
