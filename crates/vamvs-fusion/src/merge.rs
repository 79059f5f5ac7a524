//! Turns kept pixels into points, one for each place (section 4.2.2).

#![allow(
    clippy::needless_range_loop,
    reason = "one lane of many arrays at a time, as the compiler turns into vectors"
)]

use std::ops::Range;

use rayon::prelude::*;
use vamvs_core::Size;

use crate::FusedPoints;
use crate::appearance::SeenView;
use crate::bits::BitGrid;
use crate::candidates::{Candidates, move_together};
use crate::geometric::RoiTest;
use crate::lanes::{LANES, Lanes, bits, first_lanes, set_bits};
use crate::mean::{Means, Viewpoint};
use crate::pair::Pair;
use crate::priority::Ranking;
use crate::round_trip::{Answers, Strip, ask, inverse_depths_in_source};
use vamvs_core::widened;

/// Number of pixels in a batch, so that the points of a large view take little memory.
const BATCH: usize = 1 << 18;

/// A pixel that agrees on a point may be nearer than the point by this many times
/// [`FuseOptions::max_relative_depth`](crate::FuseOptions::max_relative_depth): once for the
/// threshold of agreement, once for the interpolation between pixels, once as a margin.
const NEARER: f32 = 3.0;

/// A reference view with all views that may see the same places.
pub(crate) struct Merger<'a> {
    /// The reference view's number.
    pub view: usize,
    pub reference: &'a SeenView,
    pub ranking: Ranking,
    pub kept: &'a BitGrid,
    /// How much the depths of views that agree may differ, as a share.
    pub max_relative_depth: f32,
    /// The largest standard deviation of a point, scene units.
    pub max_sigma: f32,
    pub others: Vec<RivalView<'a>>,
    /// The region of interest.
    pub region: Option<RoiTest<'a>>,
}

/// A view that may see the same places.
pub(crate) struct RivalView<'a> {
    pub pair: Pair<'a>,
    pub seen: &'a SeenView,
    pub ranking: Ranking,
    pub kept: &'a BitGrid,
}

impl Merger<'_> {
    /// The rows of the reference view in parts of some [`BATCH`] pixels.
    pub fn batches(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let Size { width, height } = self.reference.filtered.size();
        let rows = BATCH.div_ceil(width.max(1));
        (0..height).step_by(rows).map(move |first| first..(first + rows).min(height))
    }

    /// The points that some rows of the reference view make, row by row in the order of the pixels.
    pub fn points(&self, rows: Range<usize>) -> Vec<FusedPoints> {
        let viewpoint = Viewpoint::new(self.reference);
        let room = || (Answers::new(), Means::new(&viewpoint));
        let row = |(answers, means): &mut (Answers, Means<'_>), y| self.row(y, answers, means);
        rows.into_par_iter().map_init(room, row).collect()
    }

    fn row(&self, y: usize, answers: &mut Answers, means: &mut Means<'_>) -> FusedPoints {
        let pixels = self.first_comers(y, answers);
        let mut points = FusedPoints::with_room(pixels.len());
        for pixels in pixels.chunks(LANES) {
            let strip = self.strip(pixels, y);
            means.begin(self.view, pixels, y);
            for other in &self.others {
                ask(&other.pair, &strip, first_lanes(pixels.len()), answers);
                means.add(&other.pair, other.seen, answers);
            }
            for lane in 0..pixels.len() {
                let mut point = means.point(lane, self.max_relative_depth);
                if point.sigma > self.max_sigma {
                    continue;
                }
                if let Some(region) = &self.region {
                    region.hold(&mut point, (pixels[lane], y));
                }
                points.push(point, means.views(lane));
            }
        }
        points
    }

    /// The kept pixels of a row whose places no view of higher priority takes.
    fn first_comers(&self, y: usize, answers: &mut Answers) -> Vec<usize> {
        let parts = self.reference.filtered.samples.row(y).chunks(LANES).zip(self.kept.row(y)).enumerate();
        let candidates = |(number, (samples, &kept))| Candidates {
            strip: Strip::of_row(y, number * LANES, samples),
            values: (),
            open: kept,
        };
        let mut all: Vec<Candidates<()>> = parts.map(candidates).collect();
        for other in &self.others {
            move_together(&mut all);
            for Candidates { strip, open, .. } in &mut all {
                let may_be_taken = *open & self.may_come_first(other, strip);
                if may_be_taken != 0 {
                    ask(&other.pair, strip, may_be_taken, answers);
                    *open &= !self.taken(other, strip, answers, *open);
                }
            }
        }
        all.iter().flat_map(|candidates| candidates.columns(candidates.open)).collect()
    }

    /// The lanes in which another view may come before the reference view if it agrees. If it
    /// agrees, its depth is close to that of the point, which is cheap to compute; so most round
    /// trips are needed in one direction only.
    fn may_come_first(&self, other: &RivalView<'_>, strip: &Strip) -> u64 {
        let mut inverse_depth = [0.0; LANES];
        inverse_depths_in_source(&other.pair, strip, &mut inverse_depth);
        let nearest = 1.0 + NEARER * self.max_relative_depth;
        let mut may = [false; LANES];
        compare([&other.ranking, &self.ranking], [&inverse_depth, &strip.inverse_depth], nearest, &mut may);
        bits(&may)
    }

    /// The lanes among those `open` whose place another view keeps and takes, because it comes
    /// before the reference view.
    fn taken(&self, other: &RivalView<'_>, strip: &Strip, answers: &Answers, open: u64) -> u64 {
        let width = other.seen.filtered.size().width;
        let mut taken = 0;
        for lane in set_bits(answers.agreeing() & open) {
            let own = self.ranking.rank(strip.inverse_depth[lane]);
            let pixel = answers.pixel[lane] as usize;
            // Not the interpolated depth: see `Rank`.
            let theirs = other.seen.filtered.samples.data()[pixel].inverse_depth();
            if other.kept.at(pixel, width) && other.ranking.rank(theirs) < own {
                taken |= 1 << lane;
            }
        }
        taken
    }

    /// A strip of some pixels of row `y`.
    fn strip(&self, pixels: &[usize], y: usize) -> Strip {
        let mut strip = Strip::empty(y as f32 + 0.5);
        for (lane, &x) in pixels.iter().enumerate() {
            strip.x[lane] = x as f32 + 0.5;
            strip.inverse_depth[lane] = self.reference.filtered.inverse_depth((x, y));
        }
        strip
    }
}

widened! {
    /// Marks the lanes in which a pixel of the first view would come before one of the second if it were `nearest` times
    /// as near.
    fn compare(rankings: [&Ranking; 2], inverse_depths: [&Lanes; 2], nearest: f32, may: &mut Lanes<bool>) = compare_any;
}

#[inline(always)]
fn compare_any(
    [theirs, own]: [&Ranking; 2],
    [their_depths, own_depths]: [&Lanes; 2],
    nearest: f32,
    may: &mut Lanes<bool>,
) {
    for lane in 0..LANES {
        may[lane] = theirs.comes_before(their_depths[lane] * nearest, own, own_depths[lane]);
    }
}
