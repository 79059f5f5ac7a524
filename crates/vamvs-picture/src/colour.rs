//! Colour scales: numbers as colours, and the same scales as legends of a page.

use vamvs_core::{Grid, Rgb};

/// The colour of what has no value: grey.
const NOTHING: Rgb = [150, 150, 155];

/// A scale from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Depth: blue, green, yellow, red (Google's Turbo).
    Turbo,
    /// Errors: white is right, dark red is wrong.
    Error,
    /// Confidence: dark is none, yellow is full (Viridis).
    Confidence,
}

impl Scale {
    /// The colour of `value`; values beyond 0 to 1 take the colour of the nearer end.
    #[must_use]
    pub fn at(self, value: f32) -> Rgb {
        let value = value.clamp(0.0, 1.0);
        match self {
            Self::Turbo => turbo(value),
            Self::Error => between(&[[255, 255, 255], [253, 200, 120], [227, 74, 51], [110, 0, 10]], value),
            Self::Confidence => {
                between(&[[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], value)
            }
        }
    }

    /// The picture of values from `low` to `high`; `None` is grey.
    #[must_use]
    pub fn paint(self, values: &Grid<Option<f32>>, low: f32, high: f32) -> Grid<Rgb> {
        values.map(|value| value.map_or(NOTHING, |value| self.at((value - low) / (high - low))))
    }

    /// The scale from left to right, as CSS.
    #[must_use]
    pub fn css(self) -> String {
        let stops: Vec<_> = (0..=16).map(|i| css(self.at(i as f32 / 16.0))).collect();
        format!("linear-gradient(to right, {})", stops.join(", "))
    }
}

/// A colour as CSS.
fn css([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Polynomials fitted to the Turbo colour map, 0 to 1 (A. Mikhailov 2019).
fn turbo(x: f32) -> Rgb {
    let channel = |coefficients: [f32; 6]| {
        let value = coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c);
        (255.0 * value.clamp(0.0, 1.0)).round() as u8
    };
    [
        channel([0.135_721_38, 4.615_392_6, -42.660_32, 132.131_08, -152.942_4, 59.286_38]),
        channel([0.091_402_61, 2.194_188_4, 4.842_966_6, -14.185_033, 4.277_298_6, 2.829_566]),
        channel([0.106_673_3, 12.641_946, -60.582_05, 110.362_77, -89.903_11, 27.348_25]),
    ]
}

/// The colour at `value`, 0 to 1, on the way through `stops` at equal distances.
fn between(stops: &[Rgb], value: f32) -> Rgb {
    let place = value * (stops.len() - 1) as f32;
    let first = (place as usize).min(stops.len() - 2);
    let part = place - first as f32;
    let mix = |i: usize| f32::from(stops[first][i]) * (1.0 - part) + f32::from(stops[first + 1][i]) * part;
    [0, 1, 2].map(|i| mix(i).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_reach_their_ends_and_stay_there() {
        for scale in [Scale::Turbo, Scale::Error, Scale::Confidence] {
            assert_eq!(scale.at(-1.0), scale.at(0.0));
            assert_eq!(scale.at(2.0), scale.at(1.0));
            assert_ne!(scale.at(0.0), scale.at(1.0));
        }
        assert_eq!(Scale::Error.at(0.0), [255; 3]);
        assert_eq!(Scale::Error.at(1.0), [110, 0, 10]);
        assert_eq!(between(&[[0; 3], [100; 3], [200; 3]], 0.75), [150; 3]);
    }

    #[test]
    fn turbo_goes_from_blue_over_green_to_red() {
        let [r, g, b] = Scale::Turbo.at(0.15);
        assert!(b > r && b > g);
        let [r, g, b] = Scale::Turbo.at(0.5);
        assert!(g > r && g > b);
        let [r, g, b] = Scale::Turbo.at(0.9);
        assert!(r > g && r > b);
    }
}
