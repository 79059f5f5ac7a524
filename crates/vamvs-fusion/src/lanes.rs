//! Numbers of many pixels at once, one a lane.

/// Number of pixels in a strip: one word of [`BitGrid`](crate::bits::BitGrid).
pub(crate) const LANES: usize = 64;

/// A number for each pixel of a strip.
pub(crate) type Lanes<T = f32> = [T; LANES];

/// Number of pixels of a strip worked on at once: a vector of AVX-512, two of AVX2.
pub(crate) const BLOCK: usize = 16;

/// A number for each pixel of a block.
pub(crate) type Block<T = f32> = [T; BLOCK];

/// The numbers of a block.
#[inline(always)]
pub(crate) fn block<T>(lanes: &Lanes<T>, number: usize) -> &Block<T> {
    &lanes.as_chunks().0[number]
}

/// The same, to be written.
#[inline(always)]
pub(crate) fn block_mut<T>(lanes: &mut Lanes<T>, number: usize) -> &mut Block<T> {
    &mut lanes.as_chunks_mut().0[number]
}

/// Whether any lane of a block is positive; none is negative.
#[inline(always)]
pub(crate) fn any_positive(lanes: &Block) -> bool {
    let mut any = 0;
    for lane in lanes {
        any |= lane.to_bits();
    }
    any != 0
}

/// One bit for each lane.
pub(crate) fn bits(lanes: &Lanes<bool>) -> u64 {
    let eight = |lanes: &[bool; 8]| {
        let bytes = u64::from_le_bytes(lanes.map(u8::from));
        // Brings the lowest bit of byte i to bit 56 + i.
        bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56
    };
    lanes.as_chunks().0.iter().rev().fold(0, |bits, lanes| bits << 8 | eight(lanes))
}

/// The first `count` lanes, one bit each; at least one and at most all.
pub(crate) fn first_lanes(count: usize) -> u64 {
    u64::MAX >> (LANES - count)
}

/// Whether a bit of a block is set.
#[inline(always)]
pub(crate) fn any_of_block(bits: u64, number: usize) -> bool {
    bits >> (number * BLOCK) & ((1 << BLOCK) - 1) != 0
}

/// The lanes whose bits are set.
pub(crate) fn set_bits(bits: u64) -> impl Iterator<Item = usize> {
    let first = |bits: u64| (bits != 0).then_some(bits);
    std::iter::successors(first(bits), move |&bits| first(bits & (bits - 1)))
        .map(|bits| bits.trailing_zeros() as usize)
}

#[inline(always)]
pub(crate) fn fmin(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(crate) fn fmax(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_become_bits() {
        let pattern = 0x8000_0123_4567_89ab_u64;
        let lanes = std::array::from_fn(|lane| pattern >> lane & 1 == 1);
        assert_eq!(bits(&lanes), pattern);
    }

    #[test]
    fn lanes_are_chosen_by_their_bits() {
        assert_eq!(set_bits(0).count(), 0);
        assert_eq!(set_bits(1 << 63 | 0b101).collect::<Vec<_>>(), [0, 2, 63]);
        for count in [1, 5, LANES] {
            assert!(set_bits(first_lanes(count)).eq(0..count));
        }
    }
}
