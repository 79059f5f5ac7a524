//! Calibration of confidence: of the pixels with a confidence of 0.8, 80 % should be right.

use serde::Serialize;
use vamvs_core::{Grid, depth_map::is_valid};

/// A depth is right if its error is at most this, as a share of the true depth.
pub const RIGHT_WITHIN: f64 = 0.01;

/// Number of bins of confidence, of equal width.
pub const BINS: usize = 20;

/// How many pixels of each confidence are right.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reliability {
    /// The bins, by increasing confidence from 0 to 1.
    pub bins: Vec<Bin>,
}

/// Pixels of about the same confidence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bin {
    /// Number of pixels.
    pub pixels: usize,
    /// Number of them that are right.
    pub right: usize,
    /// The sum of their confidences.
    pub confidence: f64,
}

/// What remains with a minimum confidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AboveConfidence {
    /// The minimum confidence.
    pub confidence: f64,
    /// The share of all pixels that have it.
    pub share: f64,
    /// The share of these that are right; NaN if there are none.
    pub right: f64,
}

impl Default for Reliability {
    fn default() -> Self {
        Self { bins: vec![Bin::default(); BINS] }
    }
}

/// For each pixel with an estimated and a true depth, its confidence and whether the depth is right, to
/// [`RIGHT_WITHIN`]. Pixels without a finite confidence are left out.
pub fn outcomes<'a>(
    depth: &'a Grid<f32>,
    confidence: &'a Grid<f32>,
    ground_truth: &'a Grid<f32>,
) -> impl Iterator<Item = (f32, bool)> + 'a {
    let pixels = depth.data().iter().zip(confidence.data()).zip(ground_truth.data());
    let known = pixels.filter(|((depth, confidence), ground_truth)| {
        is_valid(**depth) && is_valid(**ground_truth) && confidence.is_finite()
    });
    known.map(move |((depth, confidence), ground_truth)| {
        let (depth, ground_truth) = (f64::from(*depth), f64::from(*ground_truth));
        (*confidence, (depth - ground_truth).abs() <= RIGHT_WITHIN * ground_truth)
    })
}

impl Reliability {
    /// Adds a pixel.
    pub fn add(&mut self, confidence: f32, right: bool) {
        let bin = (f64::from(confidence) * BINS as f64).clamp(0.0, (BINS - 1) as f64) as usize;
        let bin = &mut self.bins[bin];
        bin.pixels += 1;
        bin.right += usize::from(right);
        bin.confidence += f64::from(confidence);
    }

    /// The mean confidence and the share of right pixels, for each bin that is not empty.
    #[must_use]
    pub fn curve(&self) -> Vec<[f64; 2]> {
        let bins = self.bins.iter().filter(|bin| bin.pixels > 0);
        bins.map(|bin| [bin.confidence, bin.right as f64].map(|sum| sum / bin.pixels as f64)).collect()
    }

    /// Adds the pixels of another [`Reliability`].
    pub fn append(&mut self, other: &Self) {
        for (bin, other) in self.bins.iter_mut().zip(&other.bins) {
            bin.pixels += other.pixels;
            bin.right += other.right;
            bin.confidence += other.confidence;
        }
    }

    /// Number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.bins.iter().map(|bin| bin.pixels).sum()
    }

    /// The expected calibration error: the mean over pixels of the difference, in their bin, between mean
    /// confidence and share of right pixels; NaN without pixels.
    #[must_use]
    pub fn error(&self) -> f64 {
        let off = self.bins.iter().map(|bin| (bin.confidence - bin.right as f64).abs());
        off.sum::<f64>() / self.pixels() as f64
    }

    /// The pixels that remain with a minimum confidence, for the lower end of each bin.
    #[must_use]
    pub fn above_confidences(&self) -> Vec<AboveConfidence> {
        let all = self.pixels() as f64;
        let of = |first: usize| {
            let [pixels, right] = self.bins[first..]
                .iter()
                .fold([0, 0], |[pixels, right], bin| [pixels + bin.pixels, right + bin.right])
                .map(|count| count as f64);
            AboveConfidence {
                confidence: first as f64 / BINS as f64,
                share: pixels / all,
                right: right / pixels,
            }
        };
        (0..BINS).map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::Size;

    #[test]
    fn confidence_that_is_a_probability_has_no_error() {
        let mut honest = Reliability::default();
        let mut boastful = Reliability::default();
        for i in 0..10 {
            honest.add(0.7, i < 7);
            honest.add(0.3, i < 3);
            boastful.add(1.0, i < 7);
        }
        assert!(honest.error() < 1e-7);
        assert!((boastful.error() - 0.3).abs() < 1e-7);
        let kept = honest.above_confidences();
        assert_eq!((kept[0].share, kept[0].right), (1.0, 0.5));
        assert_eq!((kept[10].confidence, kept[10].share, kept[10].right), (0.5, 0.5, 0.7));
        assert!(kept[19].right.is_nan() && kept[19].share == 0.0);
        let mut both = honest.clone();
        both.append(&boastful);
        assert_eq!((both.pixels(), both.bins[19].right), (30, 7));
    }

    #[test]
    fn outcomes_are_those_of_pixels_with_both_depths() {
        let grid = |values: [f32; 5]| Grid::from_vec(Size::new(5, 1), values.to_vec());
        let ground_truth = grid([2.0, 2.0, 0.0, 2.0, 2.0]);
        let depth = grid([2.0, 2.03, 2.0, 0.0, 2.01]);
        let confidence = grid([0.9, 0.5, 0.5, 0.5, f32::NAN]);
        let found: Vec<_> = outcomes(&depth, &confidence, &ground_truth).collect();
        assert_eq!(found, [(0.9, true), (0.5, false)]);
    }
}
