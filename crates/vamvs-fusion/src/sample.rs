//! What fusion keeps of a pixel of a depth map, in one word.

use crate::lanes::{fmax, fmin};

/// The inverse depth and the confidence of a pixel.
///
/// Fusion reads four neighbouring pixels of another view at a time, as two pairs of eight bytes. An inverse depth has 19 significant bits (its relative error is at most 2·10⁻⁶), the square
/// root of a confidence, by which votes are weighted, six bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub(crate) struct Sample(u32);

/// Bits of the root of a confidence.
const SURENESS_BITS: u32 = 6;

/// These bits for confidence 1.
const SURE: u32 = (1 << SURENESS_BITS) - 1;

/// Bits that are rounded off an inverse depth. Its sign, which is positive, makes room for one more bit.
const ROUNDED_BITS: u32 = SURENESS_BITS - 1;

impl Sample {
    /// A pixel without a depth.
    pub const NONE: Self = Self(0);

    /// A pixel with a positive inverse depth and a confidence, which is clamped to 0 to 1; a positive one stays positive.
    /// Of another inverse depth the result has no meaning.
    #[inline(always)]
    pub fn new(inverse_depth: f32, confidence: f32) -> Self {
        let depth = inverse_depth.to_bits().wrapping_add(1 << (ROUNDED_BITS - 1)) >> ROUNDED_BITS;
        // Not NaN either: `fmin` gives its second argument then.
        let confidence = fmax(fmin(confidence, 1.0), 0.0);
        // SAFETY: it is between 0 and 1.
        let sure: i32 = unsafe { (confidence.sqrt() * SURE as f32 + 0.5).to_int_unchecked() };
        let least = i32::from(confidence > 0.0);
        let sure = if sure > least { sure } else { least };
        Self(depth << SURENESS_BITS | sure as u32)
    }

    /// The inverse depth, 0 if there is none.
    #[inline(always)]
    pub fn inverse_depth(self) -> f32 {
        f32::from_bits(self.0 >> SURENESS_BITS << ROUNDED_BITS)
    }

    /// The square root of the confidence, 0 to 1.
    #[inline(always)]
    pub fn sureness(self) -> f32 {
        (self.0 & SURE) as i32 as f32 * (1.0 / SURE as f32)
    }

    /// The confidence, 0 to 1.
    pub fn confidence(self) -> f32 {
        self.sureness() * self.sureness()
    }
}

/// The samples at four places, and those to the right of them.
///
/// # Safety
/// All places must be less than the number of samples minus 1.
#[inline(always)]
pub(crate) unsafe fn pairs(samples: &[Sample], places: [u32; 4]) -> [[Sample; 4]; 2] {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{
            _mm_castps_si128, _mm_castsi128_ps, _mm_loadl_epi64, _mm_shuffle_ps, _mm_storeu_si128,
            _mm_unpacklo_epi64,
        };
        let [a, b, c, d] = places;
        let mut pairs = [[Sample::NONE; 4]; 2];
        // SAFETY: the caller says that both samples are there. The reads need no alignment, and SSE2 is part of the
        // architecture.
        unsafe {
            let first = samples.as_ptr();
            let (a, b) = (first.add(a as usize).cast(), first.add(b as usize).cast());
            let (c, d) = (first.add(c as usize).cast(), first.add(d as usize).cast());
            let ab = _mm_castsi128_ps(_mm_unpacklo_epi64(_mm_loadl_epi64(a), _mm_loadl_epi64(b)));
            let cd = _mm_castsi128_ps(_mm_unpacklo_epi64(_mm_loadl_epi64(c), _mm_loadl_epi64(d)));
            let (left, right) = (_mm_shuffle_ps::<0x88>(ab, cd), _mm_shuffle_ps::<0xdd>(ab, cd));
            _mm_storeu_si128(pairs[0].as_mut_ptr().cast(), _mm_castps_si128(left));
            _mm_storeu_si128(pairs[1].as_mut_ptr().cast(), _mm_castps_si128(right));
        }
        pairs
    }
    #[cfg(not(target_arch = "x86_64"))]
    // SAFETY: the caller says that both samples are there.
    [0, 1].map(|right| places.map(|place| unsafe { *samples.get_unchecked(place as usize + right) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_numbers_come_back_rounded() {
        for inverse_depth in [1.0e-30_f32, 0.123_456_79, 0.999_999_9, 1.0, 3.3, 7.7e12] {
            for confidence in [0.0_f32, 1e-6, 0.3, 0.5, 0.999, 1.0] {
                let sample = Sample::new(inverse_depth, confidence);
                assert!((sample.inverse_depth() / inverse_depth - 1.0).abs() < 2e-6);
                assert!((sample.confidence() - confidence).abs() < 1.0 / SURE as f32);
                assert_eq!(sample.confidence() > 0.0, confidence > 0.0);
            }
        }
        assert_eq!(
            (Sample::new(0.25, 1.0).inverse_depth(), Sample::new(0.25, 1.0).confidence()),
            (0.25, 1.0)
        );
        assert_eq!((Sample::NONE.inverse_depth(), Sample::NONE.confidence()), (0.0, 0.0));
    }

    #[test]
    fn pairs_are_side_by_side() {
        let samples: Vec<Sample> = (1..=20).map(|i| Sample::new(i as f32, 0.0)).collect();
        let places = [3, 0, 18, 7];
        // SAFETY: there are 20 samples.
        let [left, right] = unsafe { pairs(&samples, places) };
        for ((place, left), right) in places.into_iter().zip(left).zip(right) {
            assert_eq!((left, right), (samples[place as usize], samples[place as usize + 1]));
        }
    }
}
