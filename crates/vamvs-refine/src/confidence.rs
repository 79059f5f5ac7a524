//! How likely a refined depth is right.

use crate::Features;

/// The likelihood that a depth is right to 1 %: a logistic function of the features, fitted to rendered scenes.
pub(crate) fn of(features: &Features) -> f32 {
    let Features { correlation, agreement, moved, seed, geometric, .. } = *features;
    let near = if moved < 0.0 { 0.0 } else { 1.0 / (1.0 + moved * moved / 4.0) };
    let known = if geometric < 0.0 { 0.0 } else { 3.0 * (geometric - 0.5) };
    let sum = -3.0 + 3.0 * correlation.max(0.0) + 1.5 * agreement + 1.5 * near + 1.5 * seed + known;
    1.0 / (1.0 + (-sum).exp())
}
