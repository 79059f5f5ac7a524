//! The volume that a surface is looked for in, and its blocks.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::{Part, Rgb};

use crate::assembly::BlockSurface;
use crate::bricks::Bricks;
use crate::field::Field;
use crate::outline::Outline;
use crate::sight::Sight;
use crate::surface::{Surface, extract};
use crate::view::SeenView;

/// A surface is near within this distance, in cells of the width that is asked for: they are up to √2 times as wide.
const NEAR: f64 = 1.5;

/// Bytes that a brick takes on average: vertices, triangles, and what makes them a manifold.
const BRICK_BYTES: u64 = 4500;

/// By how much more than is needed cells are larger where the volume takes too much memory...
const LARGER: f64 = 1.02;

/// ... but they are not larger than this, in sizes of a pixel.
pub(crate) const LARGEST_CELL: f64 = 64.0;

/// Bricks of a block: their distances take 50 MB.
const BLOCK: usize = 1 << 15;

/// Bricks that are asked together which views may see them.
const GROUP: usize = 64;

/// How far from a brick what its surface depends on is, in widths of it: bricks beside it, up to twice as wide, and those
/// at their faces.
const AROUND: f64 = 4.0;

/// The volume around all that views see.
pub struct Volume {
    sights: Vec<Sight>,
    bricks: Bricks,
    cell: f64,
}

/// A part of the volume, and the views that may say something of it.
#[derive(Clone, Debug)]
pub struct Block {
    bricks: Range<usize>,
    pub(crate) views: Vec<usize>,
}

impl Volume {
    /// That of these views, with cells of so many sizes of a pixel or, where their mesh would then take more than `memory` bytes,
    /// with larger ones.
    pub(crate) fn around(outlines: Vec<Outline>, mut cell: f64, memory: u64) -> Self {
        let most = (memory / BRICK_BYTES).max(1);
        let mut bricks = Bricks::around(&outlines, cell);
        while bricks.all.len() as u64 > most && cell < LARGEST_CELL {
            let factor = LARGER * (bricks.all.len() as f64 / most as f64).sqrt();
            cell = (cell * factor).min(LARGEST_CELL);
            bricks = Bricks::around(&outlines, cell);
        }
        Self { sights: outlines.into_iter().map(|outline| outline.sight).collect(), bricks, cell }
    }

    /// The width of its cells, in sizes of the finest pixel that sees a place.
    #[must_use]
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// The number of views.
    pub(crate) fn views(&self) -> usize {
        self.sights.len()
    }

    /// Whether a view may see a place.
    pub(crate) fn may_see(&self, view: usize, place: &Vector3<f64>) -> bool {
        self.sights[view].may_see((place, 0.0), self.near())
    }

    /// Bytes that its mesh takes.
    pub(crate) fn bytes(&self) -> u64 {
        self.bricks.all.len() as u64 * BRICK_BYTES
    }

    /// What the positions of its mesh are relative to.
    pub(crate) fn origin(&self) -> Vector3<f64> {
        let first = self.bricks.all.first().map(|brick| brick.low.cast()).unwrap_or_default();
        self.bricks.x_in_world(&first)
    }

    /// The blocks of a part of the volume.
    #[must_use]
    pub fn blocks(&self, part: Part) -> Vec<Block> {
        self.blocks_of(part, BLOCK)
    }

    pub(crate) fn blocks_of(&self, part: Part, bricks: usize) -> Vec<Block> {
        let all = part.range(self.bricks.all.len());
        let block = |first: usize| {
            let bricks = first..(first + bricks).min(all.end);
            Block { views: self.views_of(bricks.clone()), bricks }
        };
        all.clone().step_by(bricks).map(block).collect()
    }

    /// The views that may say something of what the surface in bricks depends on.
    fn views_of(&self, bricks: Range<usize>) -> Vec<usize> {
        let groups = self.bricks.all[bricks].chunks(GROUP);
        let ball = |group: &[crate::bricks::Brick]| {
            let infinite = Vector3::repeat(f64::INFINITY);
            let (low, high) = group.iter().fold((infinite, -infinite), |(low, high), brick| {
                let (begin, width) = (brick.low.cast::<f64>(), f64::from(brick.width()));
                let (before, behind) =
                    (Vector3::repeat(AROUND * width), Vector3::repeat((1.0 + AROUND) * width));
                (low.inf(&(begin - before)), high.sup(&(begin + behind)))
            });
            (self.bricks.x_in_world(&((low + high) / 2.0)), (high - low).norm() / 2.0 * self.bricks.unit)
        };
        let balls: Vec<(Vector3<f64>, f64)> = groups.map(ball).collect();
        let may_see = |sight: &Sight| {
            balls.iter().any(|(middle, radius)| sight.may_see((middle, *radius), self.near()))
        };
        (0..self.sights.len()).into_par_iter().filter(|&view| may_see(&self.sights[view])).collect()
    }

    /// The surface in a block, of the views that may say something of it, in their order.
    pub(crate) fn surface(&self, block: &Block, views: &[Arc<SeenView>]) -> BlockSurface {
        let field = Field::of(&self.bricks, views, self.near());
        let faces_a_view = |place: &Vector3<f64>, normal: &Vector3<f64>| {
            let place = self.bricks.x_in_world(place);
            views.iter().any(|view| view.faces(&place, normal, self.near()))
        };
        let Surface { counts, positions, triangles } = extract(&field, block.bricks.clone(), faces_a_view);
        let places: Vec<Vector3<f64>> =
            positions.par_iter().map(|place| self.bricks.x_in_world(place)).collect();
        let origin = self.origin();
        let mut left = places.as_slice();
        let of_bricks: Vec<(usize, &[Vector3<f64>])> = block
            .bricks
            .clone()
            .zip(&counts)
            .map(|(brick, &count)| {
                let (own, rest) = left.split_at(count.into());
                left = rest;
                (brick, own)
            })
            .collect();
        let colours =
            of_bricks.into_par_iter().flat_map_iter(|(brick, places)| self.colours(brick, places, views));
        BlockSurface {
            counts,
            positions: places.par_iter().map(|place| (place - origin).cast::<f32>().into()).collect(),
            colours: colours.collect(),
            triangles,
        }
    }

    /// The colours of places on the surface in a brick: the means over the views, mostly of those that see a place with the most
    /// pixels.
    fn colours<'a>(
        &self,
        brick: usize,
        places: &'a [Vector3<f64>],
        views: &'a [Arc<SeenView>],
    ) -> impl Iterator<Item = Rgb> + 'a {
        let (middle, radius) = self.bricks.ball(brick);
        let near = self.near();
        let may_see =
            |view: &&Arc<SeenView>| !places.is_empty() && view.sight.may_see((&middle, radius), near);
        let seeing: Vec<&Arc<SeenView>> = views.iter().filter(may_see).collect();
        places.iter().map(move |place| {
            let mut sum = (Vector3::zeros(), f32::MIN_POSITIVE);
            for view in &seeing {
                if let Some((colour, weight)) = view.colour(&view.sight.cam_from_world.transform(place)) {
                    sum = (sum.0 + colour * weight, sum.1 + weight);
                }
            }
            (sum.0 / sum.1).map(|value| value.round() as u8).into()
        })
    }

    fn near(&self) -> f32 {
        (NEAR * self.cell) as f32
    }
}
