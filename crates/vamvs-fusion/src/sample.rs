//! What fusion keeps of a pixel of a depth map, in one word.

/// The inverse depth and the confidence of a pixel.
///
/// Most of the time of fusion is spent waiting for pixels of other views, four at a time. Two that are side by side fit
/// into a word of 64 bits. An inverse depth has 18 significant bits (its relative error is at most 4·10⁻⁶), a confidence
/// seven bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Sample(u32);

/// Bits of a confidence.
const CONFIDENCE_BITS: u32 = 7;

/// The word of confidence 1.
const SURE: u32 = (1 << CONFIDENCE_BITS) - 1;

/// Bits that are rounded off an inverse depth. Its sign, which is positive, makes room for one more bit of the confidence.
const ROUNDED_BITS: u32 = CONFIDENCE_BITS - 1;

impl Sample {
    /// A pixel without a depth.
    pub const NONE: Self = Self(0);

    /// A pixel with a positive inverse depth and a confidence, 0 to 1. A positive confidence stays positive.
    #[inline(always)]
    pub fn new(inverse_depth: f32, confidence: f32) -> Self {
        let depth = (inverse_depth.to_bits() + (1 << (ROUNDED_BITS - 1))) >> ROUNDED_BITS;
        // SAFETY: the caller's confidence is between 0 and 1.
        let sure: i32 = unsafe { (confidence * SURE as f32 + 0.5).to_int_unchecked() };
        let least = i32::from(confidence > 0.0);
        let sure = if sure > least { sure } else { least };
        Self(depth << CONFIDENCE_BITS | sure as u32)
    }

    /// The inverse depth, 0 if there is none.
    #[inline(always)]
    pub fn inverse_depth(self) -> f32 {
        f32::from_bits(self.0 >> CONFIDENCE_BITS << ROUNDED_BITS)
    }

    /// The confidence, 0 to 1.
    #[inline(always)]
    pub fn confidence(self) -> f32 {
        (self.0 & SURE) as i32 as f32 * (1.0 / SURE as f32)
    }
}

/// Two pixels side by side.
#[derive(Clone, Copy, Default)]
pub(crate) struct Beside(u64);

impl Beside {
    /// The first two of some pixels.
    #[inline(always)]
    pub fn of(pixels: &[Sample]) -> Self {
        Self(u64::from(pixels[0].0) | u64::from(pixels[1].0) << 32)
    }

    #[inline(always)]
    pub fn left(self) -> Sample {
        Sample(self.0 as u32)
    }

    #[inline(always)]
    pub fn right(self) -> Sample {
        Sample((self.0 >> 32) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_numbers_come_back_rounded() {
        for inverse_depth in [1.0e-30_f32, 0.123_456_79, 0.999_999_9, 1.0, 3.3, 7.7e12] {
            for confidence in [0.0_f32, 1e-6, 0.3, 0.5, 0.999, 1.0] {
                let sample = Sample::new(inverse_depth, confidence);
                assert!((sample.inverse_depth() / inverse_depth - 1.0).abs() < 3.9e-6);
                assert!((sample.confidence() - confidence).abs() < 1.0 / f32::from(SURE as u8));
                assert_eq!(sample.confidence() > 0.0, confidence > 0.0);
                let beside = Beside::of(&[sample, Sample::new(0.5, 1.0)]);
                assert_eq!((beside.left(), beside.right()), (sample, Sample::new(0.5, 1.0)));
            }
        }
        assert_eq!((Sample::new(0.25, 1.0).inverse_depth(), Sample::new(0.25, 1.0).confidence()), (0.25, 1.0));
        assert_eq!((Sample::NONE.inverse_depth(), Sample::NONE.confidence()), (0.0, 0.0));
    }
}
