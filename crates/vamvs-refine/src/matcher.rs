//! The energy of a plane at a pixel: how ill the photographs match, and how far it is from what was known before.

use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Grid, Size};

use crate::correlation::correlation;
use crate::descent::{Normal, normal};
use crate::isa::Isa;
use crate::luminance::Padded;
use crate::plane::Plane;
use crate::source::{MOST_SOURCES, Source};
use crate::window::{Window, window};
use crate::{RefineOptions, geometry::Seen};

/// The energy of what cannot be: behind a camera, or steeper than [`STEEPEST`].
pub(crate) const IMPOSSIBLE: f32 = f32::INFINITY;

/// The cost of a source view that does not see the pixel: that of no correlation.
const UNSEEN: f32 = 1.0;

/// The steepest plane, pixels of disparity a pixel.
const STEEPEST: f32 = 1.2;

/// All photographs at one resolution.
pub(crate) struct Matcher<'a> {
    pub image: Padded,
    pub sources: Vec<Source<'a>>,
    pub options: &'a RefineOptions,
    pub isa: Isa,
}

/// A reference pixel with all that does not depend on the plane.
pub(crate) struct Pixel<'a> {
    matcher: &'a Matcher<'a>,
    x: f32,
    y: f32,
    /// Its window.
    pub window: Window,
    /// The change of inverse depth that moves the sources' pixels by one, the mean over them.
    pub step: f32,
    /// Inverse depth that was known before; 0 if none was.
    pub prior: f32,
    rays: [[f32; 3]; MOST_SOURCES],
    handicaps: [f32; MOST_SOURCES],
}

/// How well the source views match at a plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Match {
    /// The mean correlation of the best views.
    pub correlation: f32,
    /// How many views have a correlation above one half.
    pub agreeing: u32,
}

impl<'a> Matcher<'a> {
    /// The change of inverse depth at `(x, y)` that moves the sources' pixels by one, the mean over them.
    pub fn step(&self, x: usize, y: usize, w: f32) -> f32 {
        let of = |source: &Source| {
            let ray = source.transfer.ray(x as f32 + 0.5, y as f32 + 0.5);
            source.transfer.disparity(ray, w)
        };
        self.sources.len() as f32 / self.sources.iter().map(of).sum::<f32>()
    }

    /// The pixel `(x, y)`, near inverse depth `w`. `None` where it is masked or no source sees it move with depth.
    #[inline]
    pub fn pixel(&'a self, x: usize, y: usize, w: f32, prior: f32) -> Option<Pixel<'a>> {
        if self.image.at(x, y) < 0.0 {
            return None;
        }
        let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
        let (mut rays, mut handicaps) = ([[0.0; 3]; MOST_SOURCES], [0.0; MOST_SOURCES]);
        let mut disparity = 0.0;
        for (source, (ray, handicap)) in self.sources.iter().zip(rays.iter_mut().zip(&mut handicaps)) {
            *ray = source.transfer.ray(px, py);
            disparity += source.transfer.disparity(*ray, w);
            let visible = source.visibility.map_or(1.0, |grid| nearest(grid, px, py, self.image.size));
            *handicap = self.options.visibility * (1.0 - visible);
        }
        let step = self.sources.len() as f32 / disparity;
        let window = window(&self.image, x, y, self.options.colour, self.isa);
        let pixel = Pixel { matcher: self, x: px, y: py, window, step, prior, rays, handicaps };
        step.is_finite().then_some(pixel)
    }
}

fn nearest(grid: &Grid<f32>, x: f32, y: f32, size: Size) -> f32 {
    let column = (x / size.width as f32 * grid.width() as f32) as usize;
    let row = (y / size.height as f32 * grid.height() as f32) as usize;
    grid[(column.min(grid.width() - 1), row.min(grid.height() - 1))]
}

impl Pixel<'_> {
    /// The energy of a plane: 1 − the mean correlation of the best views, and the cost of its distance to what was
    /// known before.
    pub fn energy(&self, plane: &Plane) -> f32 {
        let slope = (plane.gx * plane.gx + plane.gy * plane.gy).sqrt();
        if plane.w <= 0.0 || slope > STEEPEST * self.step {
            return IMPOSSIBLE;
        }
        let mut costs = [(0.0, 0.0); MOST_SOURCES];
        let count = self.matcher.sources.len();
        for (index, cost) in costs[..count].iter_mut().enumerate() {
            let own = self.cost(index, plane);
            *cost = (own + self.handicaps[index], own);
        }
        self.mean_of_best(&mut costs[..count]) + self.prior_cost(plane.w)
    }

    /// The correlation with each source view that sees the pixel.
    pub fn matched(&self, plane: &Plane) -> Match {
        let (mut costs, mut agreeing) = ([(0.0, 0.0); MOST_SOURCES], 0);
        let count = self.matcher.sources.len();
        for (index, cost) in costs[..count].iter_mut().enumerate() {
            let own = 1.0 - self.correlation(index, plane).unwrap_or(0.0);
            *cost = (own + self.handicaps[index], own);
            agreeing += u32::from(own < 0.5);
        }
        Match { correlation: 1.0 - self.mean_of_best(&mut costs[..count]), agreeing }
    }

    /// How many sources' own depth maps meet the plane within a pixel; `None` if there are no such maps.
    pub fn geometric_agreement(&self, plane: &Plane) -> Option<usize> {
        let sources = &self.matcher.sources;
        let meets = |&source: &usize| self.seen_by(source, plane).is_some_and(|seen| seen.way < 1.0);
        let known = sources.iter().any(|source| source.geometry.is_some());
        known.then(|| (0..sources.len()).filter(meets).count())
    }

    /// What a source's depth map says near this plane.
    pub fn seen_by(&self, source: usize, plane: &Plane) -> Option<Seen> {
        self.matcher.sources[source].geometry.as_ref()?.seen(self.x, self.y, plane.w)
    }

    #[inline]
    fn cost(&self, index: usize, plane: &Plane) -> f32 {
        let photometric = self.correlation(index, plane).map_or(UNSEEN, |correlation| 1.0 - correlation);
        photometric + self.geometric_cost(index, plane)
    }

    #[inline]
    fn correlation(&self, index: usize, plane: &Plane) -> Option<f32> {
        let source = &self.matcher.sources[index];
        let warp = source.transfer.affine(self.rays[index], plane)?;
        source.quads.contains(warp.u, warp.v).then(|| {
            correlation(&self.window, &source.quads, &warp, self.matcher.options.noise, self.matcher.isa)
        })
    }

    #[inline]
    fn geometric_cost(&self, index: usize, plane: &Plane) -> f32 {
        if self.matcher.sources[index].geometry.is_none() {
            return 0.0;
        }
        let reach = self.matcher.options.geometric_reach;
        let way = self.seen_by(index, plane).map_or(reach, |seen| seen.way.min(reach));
        self.matcher.options.geometric * way
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

    /// The normal equations of the source views that match best at a plane, in units of [`Pixel::step`].
    pub fn normal(&self, plane: &Plane) -> (Matrix3<f32>, Vector3<f32>) {
        let count = self.matcher.sources.len();
        let mut normals: [(f32, Normal); MOST_SOURCES] = [(f32::INFINITY, Normal::default()); MOST_SOURCES];
        for (index, entry) in normals[..count].iter_mut().enumerate() {
            if let Some(normal) = self.normal_of(index, plane) {
                *entry = (self.handicaps[index] - normal.correlation, normal);
            }
        }
        let (mut matrix, mut vector) = (Matrix3::zeros(), Vector3::zeros());
        for place in 0..self.matcher.options.views.clamp(1, count) {
            let least =
                (place + 1..count).fold(place, |a, b| if normals[b].0 < normals[a].0 { b } else { a });
            normals.swap(place, least);
            let normal = &normals[place].1;
            if normal.correlation > 0.0 {
                matrix += normal.matrix;
                vector += normal.vector;
            }
        }
        (matrix, vector)
    }

    fn normal_of(&self, index: usize, plane: &Plane) -> Option<Normal> {
        let source = &self.matcher.sources[index];
        let warp = source.transfer.affine(self.rays[index], plane)?;
        let speed = source.transfer.speed(self.rays[index], plane.w).map(|speed| speed * self.step);
        let noise = self.matcher.options.noise;
        let seen = source.quads.contains(warp.u, warp.v);
        seen.then(|| normal(&self.window, &source.quads, &warp, speed, noise, self.matcher.isa))
    }

    /// The mean cost (the second value) of the views for which the first is lowest.
    #[inline]
    fn mean_of_best(&self, costs: &mut [(f32, f32)]) -> f32 {
        let best = self.matcher.options.views.clamp(1, costs.len());
        let mut sum = 0.0;
        for place in 0..best {
            let mut least = place;
            for other in place + 1..costs.len() {
                if costs[other].0 < costs[least].0 {
                    least = other;
                }
            }
            costs.swap(place, least);
            sum += costs[place].1;
        }
        sum / best as f32
    }
}
