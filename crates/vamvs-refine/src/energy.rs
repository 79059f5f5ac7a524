//! The energy of a plane at a pixel: how badly the photographs match, and how far the plane is from the prior depth.

use nalgebra::{Matrix3, Vector3};

use crate::correlation::{Place, TOGETHER, correlations};
use crate::descent::{Normal, normal};
use crate::geometry::Seen;
use crate::matcher::{Matcher, Pixel};
use crate::plane::Plane;
use crate::source::{MOST_SOURCES, Source};
use crate::transfer::Affine;

/// The energy of an impossible plane: behind a camera, or steeper than [`STEEPEST`].
pub(crate) const IMPOSSIBLE: f32 = f32::INFINITY;

/// The steepest plane, pixels of disparity per pixel.
const STEEPEST: f32 = 1.2;

/// A plane that is worse by more than this in the views that have matched best so far is not tried in the others.
/// Neither is a plane that is better in them: it is accepted at once.
const HOPELESS: f32 = 0.1;

/// A set of source views, one bit per view.
pub(crate) type Views = u16;

/// The energy of a plane, and the views that match it best.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Judged {
    pub energy: f32,
    /// The mean correlation of the best views.
    pub correlation: f32,
    pub best: Views,
}

impl Judged {
    /// An impossible plane.
    const IMPOSSIBLE: Self = Self { energy: IMPOSSIBLE, correlation: 0.0, best: 0 };
}

/// The cost of a plane in one source view, or the sum or mean over several.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    /// 1 − correlation, plus the cost of the distance to the source's own surface.
    total: f32,
    correlation: f32,
}

/// The cost of each source view.
struct Costs {
    /// For each view, the value by which the best are chosen (cost plus handicap), and the cost itself.
    values: [(f32, Cost); MOST_SOURCES],
    count: usize,
}

impl std::ops::AddAssign for Cost {
    fn add_assign(&mut self, other: Self) {
        self.total += other.total;
        self.correlation += other.correlation;
    }
}

impl Cost {
    /// The mean of `count` costs whose sum this is.
    fn mean(self, count: usize) -> Self {
        let share = 1.0 / count.max(1) as f32;
        Self { total: share * self.total, correlation: share * self.correlation }
    }
}

impl Costs {
    /// Costs of `count` views that are not known yet.
    fn none(count: usize) -> Self {
        Self { values: [(0.0, Cost::default()); MOST_SOURCES], count }
    }

    /// The mean cost of the `most` best views, and the set of these views.
    #[inline]
    fn mean_of_best(&self, most: usize) -> (Cost, Views) {
        let (mut sum, mut taken, most) = (Cost::default(), 0 as Views, most.clamp(1, self.count));
        for _ in 0..most {
            let mut best = None;
            for (index, value) in self.values[..self.count].iter().enumerate() {
                let is_better = |best: usize| value.0 < self.values[best].0;
                if taken & (1 << index) == 0 && best.is_none_or(is_better) {
                    best = Some(index);
                }
            }
            let Some(best) = best else { break };
            taken |= 1 << best;
            sum += self.values[best].1;
        }
        (sum.mean(most), taken)
    }
}

/// The indices of the views of a set, ascending.
#[inline]
fn indices(views: Views) -> impl Iterator<Item = usize> {
    let next = |left: &Views| Some(left & (left - 1)).filter(|_| *left != 0);
    std::iter::successors((views != 0).then_some(views), move |left| next(left).filter(|left| *left != 0))
        .map(|left| left.trailing_zeros() as usize)
}

impl Pixel<'_> {
    /// The energy of a plane: 1 − the mean correlation of the best views, plus their geometric cost, plus the cost of
    /// the distance to the prior. `rival` is the best plane so far; a plane that is hopeless against it gets
    /// [`IMPOSSIBLE`].
    pub fn energy(&self, plane: &Plane, rival: Option<Judged>) -> Judged {
        if !self.is_possible(plane) {
            return Judged::IMPOSSIBLE;
        }
        let prior = self.prior_cost(plane.w);
        let mut costs = Costs::none(self.matcher.sources.len());
        let known = rival.map_or(0, |rival| rival.best);
        if let Some(rival) = rival {
            let sum = self.costs(known, plane, &mut costs);
            let Cost { total, correlation } = sum.mean(known.count_ones() as usize);
            let energy = total + prior;
            if energy < rival.energy {
                return Judged { energy, correlation, best: known };
            }
            if energy > rival.energy + HOPELESS {
                return Judged::IMPOSSIBLE;
            }
        }
        let all = ((1_u32 << costs.count) - 1) as Views;
        self.costs(all & !known, plane, &mut costs);
        let (Cost { total, correlation }, best) = costs.mean_of_best(self.matcher.options.views);
        Judged { energy: total + prior, correlation, best }
    }

    fn is_possible(&self, plane: &Plane) -> bool {
        let steepest = STEEPEST * self.step;
        plane.w > 0.0 && plane.gx * plane.gx + plane.gy * plane.gy <= steepest * steepest
    }

    /// The energy of a plane over a given set of views.
    pub fn energy_in(&self, plane: &Plane, views: Views) -> Judged {
        if !self.is_possible(plane) || views == 0 {
            return Judged::IMPOSSIBLE;
        }
        let mut costs = Costs::none(self.matcher.sources.len());
        let sum = self.costs(views, plane, &mut costs);
        let Cost { total, correlation } = sum.mean(views.count_ones() as usize);
        Judged { energy: total + self.prior_cost(plane.w), correlation, best: views }
    }

    /// The number of sources whose own depth maps meet the plane to one pixel of reprojection error; `None` if no
    /// source has a depth map.
    pub fn geometric_agreement(&self, plane: &Plane) -> Option<usize> {
        let sources = &self.matcher.sources;
        let meets = |&source: &usize| self.seen_by(source, plane).is_some_and(|seen| seen.way < 1.0);
        let known = sources.iter().any(|source| source.geometry.is_some());
        known.then(|| (0..sources.len()).filter(meets).count())
    }

    /// The surface in a source's own depth map where the source sees the plane; `None` if there is none.
    pub fn seen_by(&self, source: usize, plane: &Plane) -> Option<Seen> {
        let view = &self.matcher.sources[source];
        let place = view.transfer.place(self.rays[source], plane.w)?;
        view.geometry.as_ref()?.seen(place, (self.x, self.y))
    }

    /// The sum of the normal equations of some source views at a plane, in units of [`Pixel::step`]. Views that do
    /// not see the pixel or do not correlate are left out.
    pub fn normal(&self, plane: &Plane, views: Views) -> (Matrix3<f32>, Vector3<f32>) {
        let (mut matrix, mut vector) = (Matrix3::zeros(), Vector3::zeros());
        for index in indices(views) {
            let Some(normal) = self.normal_of(index, plane).filter(|normal| normal.correlation > 0.0) else {
                continue;
            };
            matrix += normal.matrix;
            vector += normal.vector;
        }
        (matrix, vector)
    }

    /// Evaluates a plane in some source views. Returns the sum of their costs.
    #[inline]
    fn costs(&self, mut views: Views, plane: &Plane, costs: &mut Costs) -> Cost {
        let mut sum = Cost::default();
        while views != 0 {
            let (mut some, mut count) = ([0; TOGETHER], 0);
            for index in indices(views).take(TOGETHER) {
                some[count] = index;
                count += 1;
                views &= views - 1;
            }
            sum += self.costs_of_some(&some[..count], plane, costs);
        }
        sum
    }

    /// As [`Pixel::costs`], for at most [`TOGETHER`] views.
    #[inline]
    fn costs_of_some(&self, views: &[usize], plane: &Plane, costs: &mut Costs) -> Cost {
        let Matcher { options, isa, sources, .. } = self.matcher;
        let (mut warps, mut places) = ([None; TOGETHER], [Place::None; TOGETHER]);
        for (index, (warp, place)) in views.iter().zip(warps.iter_mut().zip(&mut places)) {
            let Source { transfer, quads, .. } = &sources[*index];
            *warp = transfer.affine(self.rays[*index], plane);
            *place = warp.filter(|warp| quads.contains(warp.u, warp.v)).map(|warp| (quads, warp));
        }
        let found = correlations(&self.window, &places, options.noise, *isa);
        let mut sum = Cost::default();
        for ((index, correlation), warp) in views.iter().zip(found).zip(&warps) {
            let total = 1.0 - correlation + self.geometric_cost(&sources[*index], warp.as_ref());
            let cost = Cost { total, correlation };
            costs.values[*index] = (total + self.handicaps[*index], cost);
            sum += cost;
        }
        sum
    }

    #[inline]
    fn normal_of(&self, index: usize, plane: &Plane) -> Option<Normal> {
        let warp = self.warp(index, plane)?;
        let source = &self.matcher.sources[index];
        let speed = source.transfer.speed(self.rays[index], plane.w).map(|speed| speed * self.step);
        let noise = self.matcher.options.noise;
        Some(normal(&self.window, &source.quads, &warp, speed, noise, self.matcher.isa))
    }

    /// The warp of the window into a source image; `None` if the pixel projects outside of it.
    #[inline]
    fn warp(&self, index: usize, plane: &Plane) -> Option<Affine> {
        let source = &self.matcher.sources[index];
        let warp = source.transfer.affine(self.rays[index], plane)?;
        source.quads.contains(warp.u, warp.v).then_some(warp)
    }

    #[inline]
    fn geometric_cost(&self, source: &Source, warp: Option<&Affine>) -> f32 {
        let Some(geometry) = &source.geometry else { return 0.0 };
        let reach = self.matcher.options.geometric_reach;
        let seen = warp.and_then(|warp| geometry.seen((warp.u, warp.v), (self.x, self.y)));
        self.matcher.options.geometric * seen.map_or(reach, |seen| seen.way.min(reach))
    }

    #[inline]
    fn prior_cost(&self, w: f32) -> f32 {
        if self.prior <= 0.0 {
            return 0.0;
        }
        let options = self.matcher.options;
        let way = (w - self.prior).abs() / (self.step * options.prior_reach);
        options.prior * way.min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_listed_and_the_best_of_them_found() {
        assert_eq!(indices(0).count(), 0);
        assert_eq!(indices(0b1001_0000_0000_0101).collect::<Vec<_>>(), [0, 2, 12, 15]);
        let value = |(choice, total)| (choice, Cost { total, correlation: 1.0 - total });
        let mut values = [value((9.0, 9.0)); MOST_SOURCES];
        values[..4].copy_from_slice(&[(0.5, 0.5), (0.4, 0.1), (0.2, 0.2), (0.6, 0.0)].map(value));
        let costs = Costs { values, count: 4 };
        let (mean, best) = costs.mean_of_best(2);
        assert_eq!(best, 0b0110);
        assert!((mean.total - 0.15).abs() < 1e-6 && (mean.correlation - 0.85).abs() < 1e-6);
        assert_eq!(costs.mean_of_best(9).1, 0b1111);
    }
}
