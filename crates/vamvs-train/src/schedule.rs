//! The schedule of the learning rate.

use crate::options::{Decay, OptimizerOptions};

/// [`Decay::Cosine`]: the final learning rate as a fraction of the initial one.
const FLOOR: f64 = 0.01;
/// [`Decay::Steps`]: the number of intervals, and the factor between consecutive ones.
const DROPS: usize = 12;
const DROP: f64 = 0.9;

/// The learning rate at step `step` (from 0) of `steps`.
#[must_use]
pub fn learning_rate(options: &OptimizerOptions, step: usize, steps: usize) -> f64 {
    let warm = ((step + 1) as f64 / (options.warm_up + 1) as f64).min(1.0);
    let done = step as f64 / steps as f64;
    let share = match options.decay {
        Decay::Cosine => FLOOR + (1.0 - FLOOR) * 0.5 * (1.0 + (std::f64::consts::PI * done).cos()),
        Decay::Steps => DROP.powf((done * DROPS as f64).floor()),
    };
    options.learning_rate * warm * share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_warms_up_and_falls() {
        let options = OptimizerOptions { learning_rate: 1.0, warm_up: 9, ..OptimizerOptions::default() };
        let rate = |step| learning_rate(&options, step, 1000);
        assert!((rate(0) - 0.1).abs() < 1e-4 && (rate(9) - 1.0).abs() < 1e-3);
        assert!((rate(500) - 0.505).abs() < 1e-9 && rate(999) < 0.011);
        let options = OptimizerOptions { decay: Decay::Steps, warm_up: 0, ..options };
        assert!((learning_rate(&options, 250, 1200) - 0.81).abs() < 1e-12);
    }
}
