//! The energy of a plane at a pixel: how badly the photographs match, and how far the plane is from the prior depth.

use nalgebra::{Matrix3, Vector3};

use crate::correlation::correlations;
use crate::descent::{Normal, normal};
use crate::geometry::{Geometries, Seen};
use crate::matcher::{Group, Matcher, Pixel};
use crate::plane::Plane;
use crate::source::MOST_SOURCES;
use crate::transfer::{TOGETHER, Views, indices, of_group};

/// The energy of an impossible plane: behind a camera, or steeper than [`STEEPEST`].
pub(crate) const IMPOSSIBLE: f32 = f32::INFINITY;

/// The steepest plane, pixels of disparity per pixel.
pub(crate) const STEEPEST: f32 = 1.2;

/// A view whose correlation is less than that of the best ones by no more than this tells something of the depth.
pub(crate) const MATCHING: f32 = 0.3;

/// The sum of the normal equations of several source views.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Equations {
    pub matrix: Matrix3<f32>,
    pub vector: Vector3<f32>,
    /// The views.
    pub views: Views,
    /// The mean of their correlations.
    pub correlation: f32,
}

impl Equations {
    fn add(&mut self, view: usize, normal: &Normal) {
        self.matrix += normal.matrix;
        self.vector += normal.vector;
        self.views |= 1 << view;
        self.correlation += normal.correlation;
    }
}

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

    /// The mean cost of some views.
    fn mean_over(&self, views: Views) -> Cost {
        let mut sum = Cost::default();
        indices(views).for_each(|view| sum += self.values[view].1);
        sum.mean(views.count_ones() as usize)
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

impl Pixel<'_> {
    /// The energy of a plane: 1 − the mean correlation of the best views, plus their geometric cost, plus the cost of
    /// the distance to the prior. `rival` is the best plane so far; a plane that is hopeless against it (see
    /// [`Matcher::hopeless`]) gets [`IMPOSSIBLE`].
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
            if energy > rival.energy + self.matcher.hopeless {
                return Judged::IMPOSSIBLE;
            }
        }
        self.costs(self.all() & !known, plane, &mut costs);
        let (Cost { total, correlation }, best) = costs.mean_of_best(self.matcher.options.views);
        Judged { energy: total + prior, correlation, best }
    }

    /// The energy of a plane that is likely to be seen by the views that match a neighbour best: in these views, if it is
    /// not much worse there than the neighbour's.
    pub fn energy_like(&self, plane: &Plane, neighbour: Judged) -> Judged {
        let judged = self.energy_in(plane, neighbour.best);
        if judged.energy < neighbour.energy + self.matcher.hopeless {
            judged
        } else {
            self.energy(plane, None)
        }
    }

    /// Whether a plane is where the pixel's surface is sought, and not too steep.
    pub fn is_possible(&self, plane: &Plane) -> bool {
        let steepest = STEEPEST * self.step;
        self.bounds.contain(plane.w) && plane.gx * plane.gx + plane.gy * plane.gy <= steepest * steepest
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

    /// The surfaces in the own depth maps of a group of sources where they see the plane; `None` if they have none.
    pub fn seen(&self, group: usize, plane: &Plane) -> Option<Seen> {
        let Group { transfers, geometries } = &self.matcher.groups[group];
        let geometries = geometries.as_ref()?;
        let warps = transfers.warps(&self.rays[group], plane);
        Some(geometries.seen(warps.inside, (warps.u, warps.v), (self.x, self.y)))
    }

    /// The normal equations at a plane, in units of [`Pixel::step`], of all source views that match it nearly as well as the
    /// best ones. A view from a wide baseline moves more with depth, so its equations weigh more.
    pub fn equations(&self, plane: &Plane, judged: Judged) -> Equations {
        let Matcher { options, isa, sources, groups, .. } = self.matcher;
        let mut sum = Equations::default();
        for (number, Group { transfers, .. }) in groups.iter().enumerate() {
            let warps = transfers.warps(&self.rays[number], plane);
            let [across, along] = transfers.speeds(&self.rays[number], plane.w);
            for index in indices(of_group(self.all(), number)) {
                let Some(warp) = warps.of(index) else { continue };
                let view = number * TOGETHER + index;
                let speed = [across.as_array()[index] * self.step, along.as_array()[index] * self.step];
                let normal = normal(&self.window, &sources[view].quads, &warp, speed, options.noise, *isa);
                let is_best = judged.best >> view & 1 == 1;
                if normal.correlation > 0.0 && (is_best || normal.correlation > judged.correlation - MATCHING)
                {
                    sum.add(view, &normal);
                }
            }
        }
        sum.correlation /= sum.views.count_ones().max(1) as f32;
        sum
    }

    /// The energy of a plane over the views `best`, and its mean correlation over `views`.
    pub fn energy_and_correlation(&self, plane: &Plane, best: Views, views: Views) -> (Judged, f32) {
        if !self.is_possible(plane) || best == 0 {
            return (Judged::IMPOSSIBLE, 0.0);
        }
        let mut costs = Costs::none(self.matcher.sources.len());
        self.costs(best | views, plane, &mut costs);
        let Cost { total, correlation } = costs.mean_over(best);
        let judged = Judged { energy: total + self.prior_cost(plane.w), correlation, best };
        (judged, costs.mean_over(views).correlation)
    }

    /// All source views.
    fn all(&self) -> Views {
        ((1_u32 << self.matcher.sources.len()) - 1) as Views
    }

    /// Evaluates a plane in some source views. Returns the sum of their costs.
    #[inline]
    fn costs(&self, views: Views, plane: &Plane, costs: &mut Costs) -> Cost {
        let mut sum = Cost::default();
        for group in 0..self.matcher.groups.len() {
            let wanted = of_group(views, group);
            if wanted != 0 {
                sum += self.costs_in(group, wanted, plane, costs);
            }
        }
        sum
    }

    /// As [`Pixel::costs`], for views of one group, one bit per view of the group.
    #[inline]
    fn costs_in(&self, group: usize, views: Views, plane: &Plane, costs: &mut Costs) -> Cost {
        let Matcher { options, isa, sources, groups, .. } = self.matcher;
        let Group { transfers, geometries } = &groups[group];
        let warps = transfers.warps(&self.rays[group], plane);
        let mut images = [None; TOGETHER];
        for index in indices(views) {
            images[index] = Some(&sources[group * TOGETHER + index].quads);
        }
        let correlations = correlations(&self.window, &images, &warps, options.noise, *isa);
        let (at, pixel, most) = ((warps.u, warps.v), (self.x, self.y), options.geometric_reach);
        let errors = |all: &Geometries| all.errors(warps.inside & views, at, pixel, most).to_array();
        let errors = geometries.as_ref().map_or([0.0; TOGETHER], errors);
        let mut sum = Cost::default();
        for index in indices(views) {
            let correlation = correlations[index];
            let cost = Cost { total: 1.0 - correlation + options.geometric * errors[index], correlation };
            let source = group * TOGETHER + index;
            costs.values[source] = (cost.total + self.handicaps[source], cost);
            sum += cost;
        }
        sum
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
    fn the_best_views_are_found() {
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
