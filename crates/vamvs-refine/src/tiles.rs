//! Large photographs are refined in tiles, so that memory does not grow with their size.
//!
//! A tile is a smaller problem of the same kind: parts of the photographs with their cameras. It has a margin that is
//! wider than the speckles that are removed, and than the surroundings on which nearly all of a pixel's result depends.

use nalgebra::Vector2;
use vamvs_core::depth_map::is_valid;
use vamvs_core::homography::PixelTransfer;
use vamvs_core::roi::PixelBox;
use vamvs_core::{DepthMap, Grid, Photo, Size};

use crate::seed::Mapping;
use crate::source::reduced;
use crate::{RefineError, RefineOptions, Refined};

/// Pixels around a tile that are computed too.
const MARGIN: usize = 64;

/// Corners of parts are multiples of this, so that they stay whole at all resolutions.
const ALIGNED: usize = 4;

/// Pixels around the projection of a tile in a source view that are used too.
const AROUND: f64 = 32.0;

/// The depths of a tile are searched for in the source views from its nearest depth divided by this to its farthest
/// times this.
const RANGE: f64 = 1.25;

/// The least side of a part of a source view, pixels.
const LEAST: usize = 16;

/// A tile and what it is made of.
pub(crate) struct Tile {
    /// The tile without and with its margin, pixels of the photograph.
    core: PixelBox,
    pub outer: PixelBox,
    pub reference: Photo,
    pub sources: Vec<Photo>,
    /// The parts of the source views.
    seen: Vec<PixelBox>,
}

/// Whether a photograph is refined in tiles.
pub(crate) fn are_needed(size: Size, options: &RefineOptions) -> bool {
    size.area() > 4 * options.tile * options.tile
}

/// The most pixels that are refined at once.
pub(crate) fn most_pixels(size: Size, options: &RefineOptions) -> usize {
    if !are_needed(size, options) {
        return size.area();
    }
    let side = options.tile + 2 * MARGIN;
    side * side
}

/// Refines a photograph tile by tile. `near` is a depth map of the reference view, which tells at what depths the
/// sources may see a tile; the result is at 1/2^`level` of the photograph's size.
pub(crate) fn refined(
    (reference, sources): (&Photo, &[&Photo]),
    near: &DepthMap,
    (options, level): (&RefineOptions, usize),
    solve: impl Fn(&Tile) -> Result<Refined, RefineError>,
) -> Result<Refined, RefineError> {
    let mut whole = Refined::empty((reduced(&reference.camera, level), reference.cam_from_world));
    for (core, outer) in boxes(reference.image.size(), options.tile) {
        let part = reference.cropped(outer);
        if part.mask.as_ref().is_some_and(|mask| !mask.data().contains(&true)) {
            continue;
        }
        let range = depths(near, &part).or_else(|| depths(near, reference));
        let Some(range) = range else { continue };
        let seen: Vec<PixelBox> = sources.iter().map(|source| seen_in(source, &part, range)).collect();
        let cropped = sources.iter().zip(&seen).map(|(source, &part)| source.cropped(part)).collect();
        let tile = Tile { core, outer, reference: part, sources: cropped, seen };
        let factor = 1 << level;
        whole.paste(&solve(&tile)?, tile.core.reduced(factor), outer.reduced(factor));
    }
    Ok(whole)
}

impl Tile {
    /// The part of a source view's depth map, at any size, that belongs to its part of the photograph.
    pub fn map_of(&self, source: usize, map: &DepthMap) -> DepthMap {
        let (factor, Size { width, height }) =
            (map.scale_in(&self.sources[source].camera).max(1), map.depth.size());
        let PixelBox { x0, y0, x1, y1 } = self.seen[source];
        let first = |at: usize, count: usize| (at / factor).min(count - 1);
        let end = |at: usize, first: usize, count: usize| (at.div_ceil(factor) + 1).clamp(first + 1, count);
        let (left, top) = (first(x0, width), first(y0, height));
        map.cropped(PixelBox { x0: left, y0: top, x1: end(x1, left, width), y1: end(y1, top, height) })
    }

    /// The tile's part, with a value for every 8×8 pixels, of values for the whole photograph at any size.
    pub fn part_of(&self, values: &Grid<f32>, photograph: Size) -> Grid<f32> {
        let Size { width, height } = self.outer.size();
        let place = |pixel: usize, pixels: usize, count: usize| pixel.min(pixels - 1) * count / pixels;
        Grid::from_fn(Size::new(width.div_ceil(8), height.div_ceil(8)), |x, y| {
            let column = place(self.outer.x0 + 8 * x + 4, photograph.width, values.width());
            let row = place(self.outer.y0 + 8 * y + 4, photograph.height, values.height());
            values[(column, row)]
        })
    }
}

/// The tiles of an image, without and with their margins.
fn boxes(size: Size, side: usize) -> impl Iterator<Item = (PixelBox, PixelBox)> {
    let side = side.next_multiple_of(ALIGNED).max(MARGIN);
    let rows = (0..size.height).step_by(side);
    rows.flat_map(move |y0| (0..size.width).step_by(side).map(move |x0| (x0, y0))).map(move |(x0, y0)| {
        let (x1, y1) = ((x0 + side).min(size.width), (y0 + side).min(size.height));
        let outer = PixelBox {
            x0: x0.saturating_sub(MARGIN),
            y0: y0.saturating_sub(MARGIN),
            x1: (x1 + MARGIN).min(size.width),
            y1: (y1 + MARGIN).min(size.height),
        };
        (PixelBox { x0, y0, x1, y1 }, outer)
    })
}

/// The nearest and the farthest depth of a map in the image of `photo`, which may show a part of the view only; `None`
/// if it has no depth there.
fn depths(map: &DepthMap, photo: &Photo) -> Option<[f64; 2]> {
    let to_map = Mapping::new(&photo.camera, &map.camera);
    let (size, Size { width, height }) = (photo.camera.size, map.depth.size());
    let (first, end) = (to_map.to_seed(0, 0), to_map.to_seed(size.width - 1, size.height - 1));
    // One pixel more on each side.
    let along = |axis: usize, count: usize| {
        let inside = |at: f32| at.clamp(0.0, count as f32) as usize;
        inside(first[axis] - 1.0)..inside(end[axis] + 2.0)
    };
    let (columns, rows) = (along(0, width), along(1, height));
    let depths =
        rows.flat_map(|y| &map.depth.row(y)[columns.clone()]).copied().filter(|&depth| is_valid(depth));
    depths.map(|depth| [f64::from(depth); 2]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// The part of a source view that may see the reference view's image at these depths.
fn seen_in(source: &Photo, reference: &Photo, [near, far]: [f64; 2]) -> PixelBox {
    let source_from_reference = source.cam_from_world.compose(&reference.cam_from_world.inverse());
    let transfer = PixelTransfer::new(&reference.camera, &source.camera, &source_from_reference);
    let Size { width, height } = source.camera.size;
    let [right, bottom] = [reference.camera.size.width, reference.camera.size.height].map(|side| side as f64);
    let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
    let places = corners.iter().flat_map(|corner| {
        let corner = Vector2::from(*corner);
        [near / RANGE, far * RANGE].map(|depth| transfer.project(&corner, depth).map(|(place, _)| place))
    });
    let Some(places) = places.collect::<Option<Vec<_>>>() else {
        return PixelBox { x0: 0, y0: 0, x1: width, y1: height };
    };
    let along = |axis: usize, side: usize| {
        let low = places.iter().map(|place| place[axis]).fold(f64::INFINITY, f64::min) - AROUND;
        let high = places.iter().map(|place| place[axis]).fold(f64::NEG_INFINITY, f64::max) + AROUND;
        let first = (low.clamp(0.0, (side - LEAST) as f64) as usize) / ALIGNED * ALIGNED;
        (first, (high.clamp(0.0, side as f64) as usize).max(first + LEAST).min(side))
    };
    let ((x0, x1), (y0, y1)) = (along(0, width), along(1, height));
    PixelBox { x0, y0, x1, y1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_an_image_once_and_their_margins_stay_inside() {
        let size = Size::new(901, 530);
        let mut covered = Grid::filled(size, 0);
        for (core, outer) in boxes(size, 256) {
            assert!(
                outer.x0 <= core.x0
                    && outer.x1 >= core.x1
                    && outer.x1 <= size.width
                    && outer.y1 <= size.height
            );
            assert!(outer.x0.is_multiple_of(ALIGNED) && outer.y0.is_multiple_of(ALIGNED));
            for y in core.y0..core.y1 {
                covered.row_mut(y)[core.x0..core.x1].iter_mut().for_each(|count| *count += 1);
            }
        }
        assert!(covered.data().iter().all(|count| *count == 1));
    }
}
