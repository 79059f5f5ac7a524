//! Which view makes the point where several see the same place.

use crate::photometric::{FilteredView, focal};

/// The rank of a pixel among those of other views that see the same place: the one with the smaller footprint
/// (depth over focal length) comes first. Footprints are compared in steps of half an octave, so that
/// neighbouring pixels decide alike; at equal steps the view with the lower number comes first.
///
/// A pixel's rank depends only on the depth at its own centre, so the order is strict over the
/// pixels of all views: pixels that leave a place to one another form chains of falling ranks, and
/// each chain ends at a pixel that makes a point. (With depths interpolated elsewhere, two pixels
/// on both sides of a step could each leave the place to the other.)
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Rank {
    half_octaves: u32,
    view: usize,
}

/// Ranks the depths of one view.
pub(crate) struct Ranking {
    view: usize,
    /// Footprint at depth 1, in units of the scene's typical footprint.
    footprint: f32,
}

impl Ranking {
    /// `unit` is a footprint typical of the scene, which lies in the middle of a step.
    pub fn new(view: usize, filtered: &FilteredView, unit: f64) -> Self {
        let middle = 2f64.powf(0.25);
        Self { view, footprint: (middle / (focal(&filtered.camera) * unit)) as f32 }
    }

    /// The rank of a pixel of the view that has `inverse_depth` at its centre.
    #[inline]
    pub fn rank(&self, inverse_depth: f32) -> Rank {
        Rank { half_octaves: self.half_octaves(inverse_depth), view: self.view }
    }

    /// Whether a pixel of this view comes before one of `other`, by their inverse depths; without branches.
    #[inline(always)]
    pub fn comes_before(&self, inverse_depth: f32, other: &Self, other_inverse_depth: f32) -> bool {
        let slack = u32::from(self.view < other.view);
        self.half_octaves(inverse_depth) < other.half_octaves(other_inverse_depth) + slack
    }

    #[inline(always)]
    fn half_octaves(&self, inverse_depth: f32) -> u32 {
        let footprint = self.footprint / inverse_depth;
        // The binary exponent of the square counts half octaves.
        (footprint * footprint).to_bits() >> 23
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finer_comes_first_then_the_lower_number() {
        let [a, b] = [3, 5].map(|view| Ranking { view, footprint: 2f32.powf(0.25) });
        assert!(a.rank(1.0) < b.rank(1.0));
        assert!(a.rank(1.0) < b.rank(1.15), "within the step");
        assert!(a.rank(1.0) > b.rank(1.25), "nearer by more than a quarter octave");
        assert!(a.rank(0.8) > b.rank(1.0));
        for (own, theirs) in [(1.0, 1.0), (1.0, 1.15), (1.0, 1.25), (0.8, 1.0), (1.25, 1.0)] {
            assert_eq!(a.comes_before(own, &b, theirs), a.rank(own) < b.rank(theirs));
            assert_eq!(b.comes_before(own, &a, theirs), b.rank(own) < a.rank(theirs));
        }
        assert!(a.rank(0.5) > a.rank(0.75) && a.rank(0.75) > a.rank(1.0));
    }
}
