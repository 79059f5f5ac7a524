//! The rules that decide whether source views confirm the depth of a pixel.
//!
//! In the dynamic rule each source view votes. A vote is the geometric mean of the source's and the
//! pixel's own confidence, times 1 − e, where e is the error of the round trip as a share of its
//! threshold ([`Answers::error`]), times the triangulation angle as a share of [`FULL_PARALLAX`],
//! at most 1; views almost without an angle, such as a photograph's copies, are no voters.
//! Views that see through the point to a surface clearly behind it (free-space
//! violations) vote against it. The sum of votes times the number of views that agree must reach
//! [`FuseOptions::min_support`], and four times that at an edge of the depth map. So few views must agree closely and be confident, while many may
//! agree loosely, as in the dynamic consistency checking of D2HC-RMVSNet (Yan et al. 2020), but
//! without steps. All terms are shares and angles, so the rule does not depend on the scene's
//! scale. The constants are those of the ablation `crates/vamvs/examples/fusion_ablation.rs`.

#![allow(
    clippy::needless_range_loop,
    reason = "one lane of many arrays at a time, as the compiler turns into vectors"
)]

use crate::candidates::{Candidates, Lanewise, move_together};
use crate::lanes::{LANES, Lanes, bits};
use crate::pair::Pair;
use crate::photometric::FilteredView;
use crate::round_trip::{Answers, Strip, ask};
use crate::sample::Sample;
use crate::{Consistency, FuseOptions};
use vamvs_core::widened;

/// The triangulation angle from which a vote counts in full, radians (2°).
const FULL_PARALLAX: f32 = 0.035;

/// The least share of [`FULL_PARALLAX`] of a voter.
const LEAST_PARALLAX: f32 = 0.1;

/// A view sees through a point if what it sees there lies behind it by more than this many times
/// [`FuseOptions::max_relative_depth`].
const CLEARLY_BEHIND: f32 = 3.0;

/// How many times as many votes a pixel at an edge needs.
const AT_EDGE: f32 = 4.0;

/// How far from an edge a pixel counts as being at it, pixels.
const REACH: usize = 2;

/// Decides about the pixels of one view.
pub(crate) struct Rule<'a> {
    reference: &'a FilteredView,
    pairs: &'a [Pair<'a>],
    options: &'a FuseOptions,
    votes: Votes,
}

/// What the views asked so far answered for some pixels.
struct Tally {
    /// The votes that each pixel needs.
    needed: Lanes,
    /// Views that agree.
    views: Lanes,
    /// Votes for the pixel.
    support: Lanes,
    /// Votes against it.
    against: Lanes,
}

impl Lanewise for Tally {
    type Lane = [f32; 4];

    fn lane(&self, lane: usize) -> [f32; 4] {
        [self.needed[lane], self.views[lane], self.support[lane], self.against[lane]]
    }

    fn set_lane(&mut self, lane: usize, [needed, views, support, against]: [f32; 4]) {
        (self.needed[lane], self.views[lane]) = (needed, views);
        (self.support[lane], self.against[lane]) = (support, against);
    }
}

impl<'a> Rule<'a> {
    pub fn new(reference: &'a FilteredView, pairs: &'a [Pair<'a>], options: &'a FuseOptions) -> Self {
        Self { reference, pairs, options, votes: Votes::of(options) }
    }

    /// Sets the bits of the pixels of row `y` that are confirmed; `strips` are all strips of the row.
    pub fn confirm(&self, strips: &[Strip], y: usize, confirmed: &mut [u64]) {
        let candidates = |(number, strip): (usize, &Strip)| {
            let needed = self.needed(number * LANES, y);
            let values = Tally { needed, views: [0.0; LANES], support: [0.0; LANES], against: [0.0; LANES] };
            Candidates { open: bits(&strip.inverse_depth.map(|w| w > 0.0)), strip: strip.clone(), values }
        };
        let mut all: Vec<Candidates<Tally>> = strips.iter().enumerate().map(candidates).collect();
        let mut answers = Answers::new();
        for (done, pair) in self.pairs.iter().enumerate() {
            self.decide(&mut all, self.pairs.len() - done, confirmed);
            move_together(&mut all);
            for Candidates { strip, values: tally, open } in &mut all {
                ask(pair, strip, *open, &mut answers);
                let margin = CLEARLY_BEHIND * self.options.max_relative_depth;
                count(&answers, margin, self.votes.least_parallax, tally);
            }
        }
        self.decide(&mut all, 0, confirmed);
    }

    /// Decides about the candidates whose outcome the remaining `rest` views cannot change, even if all of them agree
    /// exactly or all of them see through the point, and sets the bits of those that are confirmed.
    fn decide(&self, all: &mut [Candidates<Tally>], rest: usize, confirmed: &mut [u64]) {
        for candidates in all {
            let (mut at_best, mut at_worst) = ([false; LANES], [false; LANES]);
            foresee(&self.votes, &candidates.values, rest, [&mut at_best, &mut at_worst]);
            let (at_best, at_worst) = (bits(&at_best), bits(&at_worst));
            for x in candidates.columns(candidates.open & at_worst) {
                confirmed[x / LANES] |= 1 << (x % LANES);
            }
            candidates.open &= at_best & !at_worst;
        }
    }

    /// The votes that each pixel needs: the less confident the pixel, the more, and many at an edge,
    /// where depth maps have skirts between a surface and what is behind it.
    fn needed(&self, first: usize, y: usize) -> Lanes {
        let mut needed = [f32::INFINITY; LANES];
        let own = &self.reference.samples.row(y)[first..];
        let factor = |own: &Sample| self.options.min_support / own.sureness();
        needed.iter_mut().zip(own).for_each(|(needed, own)| *needed = factor(own));
        for (needed, is_edge) in needed.iter_mut().zip(self.edges(first, y)) {
            *needed *= if is_edge { AT_EDGE } else { 1.0 };
        }
        needed
    }

    /// The pixels whose depth differs from that of a pixel within [`REACH`] in their row or column by
    /// more than a surface does.
    fn edges(&self, first: usize, y: usize) -> Lanes<bool> {
        let samples = &self.reference.samples;
        let own = inverse_depths(samples.row(y), first, 0);
        let mut edges = [false; LANES];
        for distance in 1..=REACH {
            let step = distance as f32 * self.reference.edge_step;
            let reach = distance as isize;
            mark_edges(&own, &inverse_depths(samples.row(y), first, reach), step, &mut edges);
            mark_edges(&own, &inverse_depths(samples.row(y), first, -reach), step, &mut edges);
            for row in [y.checked_sub(distance), Some(y + distance).filter(|&row| row < samples.height())] {
                let Some(row) = row else { continue };
                mark_edges(&own, &inverse_depths(samples.row(row), first, 0), step, &mut edges);
            }
        }
        edges
    }
}

/// How votes are weighed.
struct Votes {
    contradiction: f32,
    /// Number of other views that must agree.
    least_views: f32,
    /// The least triangulation angle of a view that agrees, as a share of [`FULL_PARALLAX`].
    least_parallax: f32,
    are_counted_only: bool,
}

impl Votes {
    fn of(options: &FuseOptions) -> Self {
        let are_counted_only = options.consistency == Consistency::Classic;
        Self {
            contradiction: options.contradiction,
            least_views: (options.min_views - 1) as f32,
            least_parallax: if are_counted_only { 0.0 } else { LEAST_PARALLAX },
            are_counted_only,
        }
    }

    /// Whether so many views that agree, with these votes for and against, confirm a pixel.
    #[inline(always)]
    fn accept(&self, views: f32, support: f32, against: f32, needed: f32) -> bool {
        let balance = (support - self.contradiction * against) * views;
        (views >= self.least_views) & (self.are_counted_only | (balance >= needed))
    }
}

widened! {
    /// Marks the pixels that are confirmed if the remaining `rest` views agree exactly, and those that are if all of these see
    /// through the point.
    fn foresee(votes: &Votes, tally: &Tally, rest: usize, outcomes: [&mut Lanes<bool>; 2]) = foresee_any;
}

#[inline(always)]
fn foresee_any(votes: &Votes, tally: &Tally, rest: usize, [at_best, at_worst]: [&mut Lanes<bool>; 2]) {
    // Sums of votes are rounded.
    let (views, most) = (rest as f32, 1.001 * rest as f32);
    for lane in 0..LANES {
        let (agree, support, against) = (tally.views[lane], tally.support[lane], tally.against[lane]);
        at_best[lane] = votes.accept(agree + views, support + most, against, tally.needed[lane]);
        at_worst[lane] = votes.accept(agree, support, against + most, tally.needed[lane]);
    }
}

/// The inverse depths of a strip's pixels of a row, `shift` pixels to the right; 0 outside of the image.
fn inverse_depths(row: &[Sample], first: usize, shift: isize) -> Lanes {
    let mut found = [0.0; LANES];
    let begin = first as isize + shift;
    let outside = usize::try_from(-begin).unwrap_or(0);
    let inside = row.get((begin + outside as isize) as usize..).unwrap_or(&[]);
    found[outside..].iter_mut().zip(inside).for_each(|(found, sample)| *found = sample.inverse_depth());
    found
}

widened! {
    /// Marks the pixels whose inverse depth differs from another's, where there is one, by more than the share `step`.
    fn mark_edges(own: &Lanes, other: &Lanes, step: f32, edges: &mut Lanes<bool>) = mark_edges_any;
}

#[inline(always)]
fn mark_edges_any(own: &Lanes, other: &Lanes, step: f32, edges: &mut Lanes<bool>) {
    for lane in 0..LANES {
        edges[lane] |= (other[lane] > 0.0) & ((other[lane] - own[lane]).abs() > step * own[lane]);
    }
}

widened! {
    /// Counts the answers of a source view. It votes against points that are in front of its
    /// surface by more than the share `margin` of its depth, and agrees only from the angle `least_parallax` on.
    fn count(answers: &Answers, margin: f32, least_parallax: f32, tally: &mut Tally) = count_any;
}

#[inline(always)]
fn count_any(answers: &Answers, margin: f32, least_parallax: f32, tally: &mut Tally) {
    for lane in 0..LANES {
        let (error, angle) = (answers.error[lane], answers.parallax[lane] * (1.0 / FULL_PARALLAX));
        let (angle, sure) = (at_most_1(angle), answers.sureness[lane]);
        let agrees = (error < 1.0) & (angle >= least_parallax);
        let sees_through = answers.nearest_inverse_depth[lane] < (1.0 - margin) * answers.expected[lane];
        tally.views[lane] += if agrees { 1.0 } else { 0.0 };
        tally.support[lane] += if agrees { (1.0 - error) * angle * sure } else { 0.0 };
        tally.against[lane] += if sees_through { sure } else { 0.0 };
    }
}

#[inline(always)]
fn at_most_1(value: f32) -> f32 {
    if value < 1.0 { value } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MaskedMap;
    use nalgebra::Vector3;
    use vamvs_core::{DepthMap, Grid, Intrinsics, Pinhole, Pose, Size};

    const SIZE: Size = Size::new(64, 48);

    /// A camera at (x, 0, 0) that looks along z at a wall at depth 10, with the relative error of
    /// its depths and their confidence.
    #[derive(Clone, Copy)]
    struct Wall {
        x: f64,
        error: f32,
        confidence: f32,
    }

    impl Wall {
        fn new(x: f64, error: f32) -> Self {
            Self { x, error, confidence: 1.0 }
        }

        fn view(self) -> FilteredView {
            let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 32.0, cy: 24.0 };
            let map = DepthMap {
                camera: Pinhole { size: SIZE, intrinsics },
                cam_from_world: Pose { translation: Vector3::new(-self.x, 0.0, 0.0), ..Pose::identity() },
                depth: Grid::filled(SIZE, 10.0 * (1.0 + self.error)),
                confidence: Grid::filled(SIZE, self.confidence),
                coarse_confidence: None,
            };
            FilteredView::new(0, &MaskedMap { map, mask: None }, &FuseOptions::default()).unwrap()
        }
    }

    /// Whether a pixel in the middle of the first wall is confirmed by the others.
    fn is_confirmed(walls: &[Wall], options: &FuseOptions) -> bool {
        are_confirmed(&walls.iter().map(|wall| wall.view()).collect::<Vec<_>>(), options)
    }

    /// The same for views.
    fn are_confirmed(views: &[FilteredView], options: &FuseOptions) -> bool {
        let (reference, sources) = (&views[0], &views[1..]);
        let pairs: Vec<_> = sources.iter().map(|source| Pair::new(reference, 1, source, options)).collect();
        let (strip, mut confirmed) = (Strip::of_row(24, 0, reference.samples.row(24)), [0]);
        Rule::new(reference, &pairs, options).confirm(&[strip], 24, &mut confirmed);
        confirmed[0] >> 32 & 1 == 1
    }

    const OWN: Wall = Wall { x: 0.0, error: 0.0, confidence: 1.0 };

    #[test]
    fn the_more_views_agree_the_looser_they_may() {
        let options = FuseOptions::default();
        // 1 % of the depth is allowed; at these baselines it decides, not the pixel.
        let off = |count: usize, error| {
            let sources = (1..=count).map(|i| Wall::new(0.35 + 0.02 * i as f64, error));
            is_confirmed(&[OWN].into_iter().chain(sources).collect::<Vec<_>>(), &options)
        };
        assert!(off(1, 0.001) && !off(1, 0.009));
        assert!(off(4, 0.009) && !off(10, 0.0101), "but none may agree beyond what is allowed");
    }

    #[test]
    fn two_views_suffice_if_both_are_sure_and_the_angle_is_large() {
        let options = FuseOptions::default();
        let sure = Wall::new(0.5, 0.001);
        assert!(is_confirmed(&[OWN, sure], &options));
        assert!(!is_confirmed(&[OWN, Wall { confidence: 0.15, ..sure }], &options));
        assert!(!is_confirmed(&[Wall { confidence: 0.15, ..OWN }, sure], &options));
        assert!(!is_confirmed(&[OWN, Wall { x: 0.05, ..sure }], &options), "0.3 degrees");
        assert!(!is_confirmed(&[OWN, sure], &FuseOptions { min_views: 3, ..options }));
    }

    #[test]
    fn views_that_see_through_a_point_outweigh_those_that_confirm_it() {
        let options = FuseOptions { contradiction: 2.0, ..FuseOptions::default() };
        let confirmed_with = |other: Wall, options: &FuseOptions| {
            is_confirmed(&[OWN, Wall::new(0.5, 0.001), Wall::new(0.45, 0.001), other], options)
        };
        let through = Wall::new(-0.5, 0.2);
        assert!(!confirmed_with(through, &options));
        assert!(confirmed_with(Wall { confidence: 0.2, ..through }, &options), "unsure");
        assert!(confirmed_with(Wall { error: 0.02, ..through }, &options), "not clearly behind");
        assert!(confirmed_with(Wall { error: -0.2, ..through }, &options), "before: it hides it");
        assert!(confirmed_with(through, &FuseOptions { contradiction: 0.0, ..options }));
    }

    #[test]
    fn a_pixel_at_an_edge_needs_more_votes() {
        let options = FuseOptions::default();
        let confirmed_with = |sources: usize, beside: (usize, usize)| {
            let walls = (1..=sources).map(|i| Wall::new(0.4 + 0.05 * i as f64, 0.001));
            let mut views: Vec<_> = [OWN].into_iter().chain(walls).map(Wall::view).collect();
            views[0].samples[beside] = Sample::new(0.5 / 10.0, 1.0);
            are_confirmed(&views, &options)
        };
        for beside in [(34, 24), (30, 24), (32, 22), (32, 25)] {
            assert!(!confirmed_with(1, beside) && confirmed_with(2, beside), "{beside:?}");
        }
        for elsewhere in [(35, 24), (32, 21), (33, 25)] {
            assert!(confirmed_with(1, elsewhere), "{elsewhere:?}");
        }
    }

    #[test]
    fn copies_of_a_photograph_are_no_voters() {
        let options = FuseOptions::default();
        let (sure, unsure) = (Wall::new(0.5, 0.001), Wall { confidence: 0.15, ..Wall::new(0.5, 0.001) });
        assert!(!is_confirmed(&[OWN, unsure, OWN, OWN, OWN], &options));
        assert!(!is_confirmed(&[OWN, sure, OWN, OWN], &FuseOptions { min_views: 3, ..options }));
        assert!(is_confirmed(&[OWN, unsure, unsure, unsure], &options), "others are");
    }

    #[test]
    fn the_classic_rule_counts_views() {
        let options = FuseOptions::classic();
        let near = |x| Wall { confidence: 0.15, ..Wall::new(x, 0.009) };
        assert!(is_confirmed(&[OWN, near(0.3), near(-0.3)], &options));
        assert!(!is_confirmed(&[OWN, OWN, Wall::new(0.3, 0.011)], &options));
        assert!(is_confirmed(&[OWN], &FuseOptions { min_views: 1, ..options }), "one view needs no other");
    }
}
