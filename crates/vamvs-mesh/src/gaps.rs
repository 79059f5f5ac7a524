//! Fills gaps between the pixels of a view that other views confirm.

use nalgebra::Vector3;
use rayon::prelude::*;
use vamvs_core::Grid;

use crate::pixel::PixelSurface;
use crate::rays::Rays;

/// Gaps in what other views confirm are filled from pixels in so many columns and rows to each side...
const REACH: usize = 5;

/// ... of which every so many are asked, first for small gaps, then for larger ones...
const STEPS: [usize; 2] = [1, 2];

/// ... in at least so many of the four quadrants around...
const QUADRANTS: usize = 3;

/// ... whose planes differ by no more than this standard deviation, sizes of a pixel...
const SPREAD: f32 = 1.5;

/// ... and get this standard deviation, sizes of a pixel.
const DOUBT: f32 = 2.0;

/// Planes are not seen more obliquely than this: the cosine of ray and normal.
const LEAST_FACING: f32 = -0.1;

/// Drops pixels that other views do not confirm, but gives those in small gaps between confirmed ones of one surface its place.
pub(crate) fn fill(rays: &Rays, surfaces: &mut Grid<PixelSurface>, confirmed: &Grid<bool>) {
    let drop = |(surface, is_confirmed): (&mut PixelSurface, &bool)| {
        let is_open = surface.depth > 0.0 && !is_confirmed;
        if is_open {
            *surface = PixelSurface::unknown();
        }
        is_open
    };
    let is_open: Vec<bool> = surfaces.data_mut().iter_mut().zip(confirmed.data()).map(drop).collect();
    let width = surfaces.width().max(1);
    for step in STEPS {
        let before = surfaces.clone();
        let rows = surfaces.data_mut().par_chunks_mut(width).zip(is_open.par_chunks(width)).enumerate();
        rows.for_each(|(y, (row, is_open))| {
            for (x, (surface, is_open)) in row.iter_mut().zip(is_open).enumerate() {
                if *is_open && surface.depth <= 0.0 {
                    *surface = between(rays, &before, (x, y), step).unwrap_or_else(PixelSurface::unknown);
                }
            }
        });
    }
}

/// The surface at a pixel between others, of which every `step`th is asked: the mean of their tangent planes, if there
/// are some to all sides and they agree.
fn between(
    rays: &Rays,
    surfaces: &Grid<PixelSurface>,
    (x, y): (usize, usize),
    step: usize,
) -> Option<PixelSurface> {
    let size = surfaces.size();
    let (mut depths, mut normals, mut squares) = ([0.0_f32; 2], Vector3::zeros(), 0.0_f32);
    let mut quadrants = [false; 4];
    let direction = rays.of((x, y));
    let around = |at: usize, length: usize| {
        let first = at as isize - (step * REACH) as isize;
        let places = (0..=2 * REACH).map(move |number| first + (number * step) as isize);
        places.filter(move |place| (0..length as isize).contains(place)).map(|place| place as usize)
    };
    for row in around(y, size.height) {
        for column in around(x, size.width) {
            let surface = surfaces[(column, row)];
            let normal = surface.normal();
            let facing = normal.dot(&direction);
            if surface.depth <= 0.0 || facing > LEAST_FACING {
                continue;
            }
            let depth = normal.dot(&rays.of((column, row))) * surface.depth / facing;
            let squared = (column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2)) as f32;
            let weight = 1.0 / (((step * step) as f32 + squared) * (0.25 + surface.sigma().powi(2)));
            depths = [depths[0] + weight * depth, depths[1] + weight];
            squares += weight * depth * depth;
            normals += normal * weight;
            quadrants[usize::from(column > x) + 2 * usize::from(row > y)] = true;
        }
    }
    if quadrants.iter().filter(|is_there| **is_there).count() < QUADRANTS {
        return None;
    }
    let depth = depths[0] / depths[1];
    let spread = (squares / depths[1] - depth * depth).max(0.0).sqrt() / rays.pixel_size(depth);
    let normal = normals.try_normalize(0.0)?;
    (spread * -normal.dot(&direction) < SPREAD).then(|| PixelSurface::new(depth, normal, DOUBT))
}
