//! The plane sweep of vis-corr. The correlations of all planes are first pooled, to predict the visibility of a view,
//! and then averaged over the views with these weights. They are computed twice rather than kept, because writing a
//! volume takes longer than computing it.

use rayon::prelude::*;
use tch::Tensor;

use super::dot::{Corners, best_of};
use super::transfer::Transfer;
use super::{Level, in_memory_mut};
use crate::NetError;
use crate::aggregate::UNSEEN;
use crate::project::PixelGrid;

/// A source view of a sweep: its coarse features and the transfer of reference pixels into it.
pub(crate) struct Source<'a> {
    pub level: Level<'a>,
    pub transfer: Transfer,
}

/// The inputs that all source views of a sweep share.
pub(crate) struct Swept<'a> {
    /// The coarse features of the reference view.
    pub reference: Level<'a>,
    /// The pixels of these features.
    pub pixel_grid: &'a PixelGrid,
    /// Depths of the planes, in units of the nearest depth searched: one for each plane, or (D, h, w).
    pub depths: &'a [f32],
    /// D, the number of planes.
    pub planes: usize,
    /// G, the number of groups of channels.
    pub groups: usize,
}

impl Swept<'_> {
    /// The depth of a plane at a pixel, by its number in the image.
    #[inline(always)]
    fn depth(&self, plane: usize, pixel: usize) -> f32 {
        let of_plane = self.depths.len() / self.planes;
        self.depths[plane * of_plane + if of_plane == 1 { 0 } else { pixel }]
    }
}

/// The maximum and the mean over all planes of the correlation, (1, 2 G, h, w); see [`crate::correlate::pooled`].
pub(crate) fn pooled(swept: &Swept<'_>, source: &Source<'_>) -> Result<Tensor, NetError> {
    let Level { width, height, .. } = swept.reference;
    let row = width * 2 * swept.groups;
    let mut pooled = vec![0.0_f32; height * row];
    pooled.par_chunks_mut(row).enumerate().for_each(|(y, row)| match swept.groups {
        4 => pool_row::<4>(swept, source, y, row),
        _ => pool_row::<8>(swept, source, y, row),
    });
    let shape = [1, height as i64, width as i64, 2 * swept.groups as i64];
    Ok(Tensor::f_from_slice(&pooled)?.f_view(shape)?.f_permute([0, 3, 1, 2])?)
}

#[inline(always)]
fn pool<const G: usize>(swept: &Swept<'_>, source: &Source<'_>, y: usize, row: &mut [f32]) {
    let Level { values, width, channels, .. } = swept.reference;
    let mut rays = Vec::with_capacity(width);
    source.transfer.rays(swept.pixel_grid, y, &mut rays);
    let share = 1.0 / swept.planes as f32;
    for (x, (ray, pooled)) in rays.iter().zip(row.as_chunks_mut::<G>().0.as_chunks_mut::<2>().0).enumerate() {
        let reference = &values[(y * width + x) * channels..][..channels];
        let (mut largest, mut sum) = ([f32::NEG_INFINITY; G], [0.0; G]);
        for plane in 0..swept.planes {
            let depth = swept.depth(plane, y * width + x);
            let mut values = [0.0; G];
            let place = source.transfer.place(*ray, depth);
            if let Some(corners) = place.and_then(|place| Corners::around(&source.level, place)) {
                corners.add_correlation(&source.level, reference, 1.0, &mut values);
            }
            for g in 0..G {
                largest[g] = largest[g].max(values[g]);
                sum[g] += values[g];
            }
        }
        *pooled = [largest, sum.map(|sum| sum * share)];
    }
}
best_of!(pool => pool_row<const G>(swept: &Swept<'_>, source: &Source<'_>, y: usize, row: &mut [f32]));

/// The mean over the source views of their correlations, each weighted by its mask (h, w): (1, G, D, h, w).
pub(crate) fn volume(
    swept: &Swept<'_>,
    sources: &[Source<'_>],
    masks: &[&[f32]],
) -> Result<Tensor, NetError> {
    let Level { width, height, .. } = swept.reference;
    let plane = height * width * swept.groups;
    let depths = swept.planes;
    let mut volume = Tensor::f_empty([(depths * plane) as i64], (tch::Kind::Float, tch::Device::Cpu))?;
    let values = in_memory_mut(&mut volume)?;
    let row = width * swept.groups;
    values.par_chunks_mut(row).enumerate().for_each(|(at, row)| {
        let place = (at / height, at % height);
        match swept.groups {
            4 => volume_row::<4>(swept, sources, masks, place, row),
            _ => volume_row::<8>(swept, sources, masks, place, row),
        }
    });
    let [d, h, w, g] = [depths, height, width, swept.groups].map(|side| side as i64);
    Ok(volume.f_view([1, d, h, w, g])?.f_permute([0, 4, 1, 2, 3])?)
}

#[inline(always)]
fn weigh<const G: usize>(
    swept: &Swept<'_>,
    sources: &[Source<'_>],
    masks: &[&[f32]],
    (plane, y): (usize, usize),
    row: &mut [f32],
) {
    let Level { values, width, channels, .. } = swept.reference;
    row.fill(0.0);
    let mut rays = Vec::with_capacity(width);
    for (source, mask) in sources.iter().zip(masks) {
        source.transfer.rays(swept.pixel_grid, y, &mut rays);
        let pixels = row.as_chunks_mut::<G>().0.iter_mut().zip(&rays);
        for (x, (sums, ray)) in pixels.enumerate() {
            let place = source.transfer.place(*ray, swept.depth(plane, y * width + x));
            let Some(corners) = place.and_then(|place| Corners::around(&source.level, place)) else {
                continue;
            };
            let reference = &values[(y * width + x) * channels..][..channels];
            corners.add_correlation(&source.level, reference, mask[y * width + x], sums);
        }
    }
    for (x, sums) in row.as_chunks_mut::<G>().0.iter_mut().enumerate() {
        let weight: f32 = masks.iter().map(|mask| mask[y * width + x]).sum();
        let share = 1.0 / (weight + UNSEEN as f32);
        sums.iter_mut().for_each(|sum| *sum *= share);
    }
}
best_of!(weigh => volume_row<const G>(
    swept: &Swept<'_>,
    sources: &[Source<'_>],
    masks: &[&[f32]],
    at: (usize, usize),
    row: &mut [f32],
));
