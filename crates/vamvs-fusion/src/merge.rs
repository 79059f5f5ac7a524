//! From kept pixels to points, each place once (section 4.2.2).

use std::ops::Range;

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use vamvs_core::{CloudPoint, Pose, Rgb, Size};

use crate::FusedPoints;
use crate::bits::BitGrid;
use crate::geometric::{Match, Pair};
use crate::normals::normal_in_cam;
use crate::photometric::{FilteredView, centre};
use crate::priority::Ranking;

/// Pixels that become points at once, so that the points of a large view take little memory.
const BATCH: usize = 1 << 18;

/// A reference view with all views that may see the same places.
pub(crate) struct Merger<'a> {
    /// The reference view's number.
    pub view: usize,
    pub reference: &'a FilteredView,
    pub ranking: Ranking,
    pub kept: &'a BitGrid,
    pub others: Vec<Other<'a>>,
}

/// A view that may see the same places.
pub(crate) struct Other<'a> {
    pub pair: Pair,
    pub ranking: Ranking,
    pub kept: &'a BitGrid,
}

impl Merger<'_> {
    /// The rows of the reference view in parts of some [`BATCH`] pixels.
    pub fn batches(&self) -> impl Iterator<Item = Range<usize>> {
        let Size { width, height } = self.reference.size();
        let rows = BATCH.div_ceil(width.max(1));
        (0..height).step_by(rows).map(move |first| first..(first + rows).min(height))
    }

    /// The points that some rows of the reference view make, in the order of the pixels.
    pub fn points(&self, rows: Range<usize>) -> FusedPoints {
        let world_from_cam = self.reference.cam_from_world.inverse();
        let rows: Vec<FusedPoints> = rows.into_par_iter().map(|y| self.row(y, &world_from_cam)).collect();
        let mut points = FusedPoints::default();
        rows.iter().for_each(|row| points.append(row));
        points
    }

    fn row(&self, y: usize, world_from_cam: &Pose) -> FusedPoints {
        let mut points = FusedPoints::default();
        let mut matches = Vec::with_capacity(self.others.len());
        for x in (0..self.reference.size().width).filter(|&x| self.kept.get(x, y)) {
            matches.clear();
            let inverse_depth = self.reference.inverse_depth[(x, y)];
            if self.comes_first(centre(x, y), inverse_depth, &mut matches) {
                let views = matches.iter().map(|(pair, _)| pair.source_view);
                let point = self.mean(x, y, &matches).point(world_from_cam);
                points.push(point, std::iter::once(self.view).chain(views));
            }
        }
        points
    }

    /// Whether no view that agrees on the pixel comes before the reference view and keeps it; if so,
    /// all views that agree are in `matches`.
    fn comes_first<'b>(
        &'b self,
        pixel: Vector2<f32>,
        inverse_depth: f32,
        matches: &mut Vec<(&'b Pair, Match)>,
    ) -> bool {
        let own = self.ranking.rank(inverse_depth);
        for other in &self.others {
            let Some(found) = other.pair.agreement(pixel, inverse_depth) else { continue };
            let (x, y) = found.sample.pixel;
            // Not the interpolated depth: see `Rank`.
            let theirs = other.pair.source.inverse_depth[(x, y)];
            if other.kept.get(x, y) && other.ranking.rank(theirs) < own {
                return false;
            }
            matches.push((&other.pair, found));
        }
        true
    }

    fn mean(&self, x: usize, y: usize, matches: &[(&Pair, Match)]) -> Mean {
        let mut mean = Mean::default();
        let ray = self.reference.camera.intrinsics.ray(&centre(x, y).cast()).cast::<f32>();
        let position = ray / self.reference.inverse_depth[(x, y)];
        mean.add(self.reference, (x, y), &position, &normal_in_cam(self.reference, x, y));
        for (pair, found) in matches {
            let pixel = found.sample.pixel;
            let rotation = pair.reference_from_source.rotation.cast::<f32>();
            let normal = rotation * normal_at(&pair.source, pixel);
            mean.add(&pair.source, pixel, &found.x_in_reference(self.reference), &normal);
        }
        mean
    }
}

/// The normal at a pixel; 0 if the depth there was filtered out.
fn normal_at(view: &FilteredView, pixel: (usize, usize)) -> Vector3<f32> {
    if view.inverse_depth[pixel] > 0.0 { normal_in_cam(view, pixel.0, pixel.1) } else { Vector3::zeros() }
}

/// Sums over the views that agree on a point, in the reference camera's frame.
#[derive(Default)]
struct Mean {
    position: Vector3<f32>,
    normal: Vector3<f32>,
    colour: [f32; 3],
    confidence: f32,
    views: u16,
}

impl Mean {
    fn add(
        &mut self,
        view: &FilteredView,
        pixel: (usize, usize),
        position: &Vector3<f32>,
        normal: &Vector3<f32>,
    ) {
        self.position += position;
        // The back of a thin sheet must not cancel its front.
        if self.normal.dot(normal) >= 0.0 {
            self.normal += normal;
        }
        for (sum, channel) in self.colour.iter_mut().zip(view.colour[pixel]) {
            *sum += f32::from(channel);
        }
        self.confidence += view.confidence[pixel];
        self.views = self.views.saturating_add(1);
    }

    fn point(&self, world_from_cam: &Pose) -> CloudPoint {
        let n = f32::from(self.views);
        let colour: Rgb = self.colour.map(|sum| (sum / n).round() as u8);
        let normal = world_from_cam.rotation * self.normal.cast::<f64>();
        CloudPoint {
            x_in_world: world_from_cam.transform(&(self.position / n).cast()).into(),
            normal: normal.normalize().cast::<f32>().into(),
            colour,
            confidence: self.confidence / n,
            views: self.views.min(255) as u8,
        }
    }
}
