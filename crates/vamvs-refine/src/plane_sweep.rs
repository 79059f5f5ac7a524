//! A plane sweep over photographs alone: the seed of a refinement where there is no network.

use rayon::prelude::*;
use vamvs_core::{DepthMap, Grid, Photo, Planes, Size};

use crate::energy::IMPOSSIBLE;
use crate::matcher::{Matcher, Pixel};
use crate::plane::Plane;
use crate::semi_global::{Costs, aggregated};
use crate::{Problem, RefineError, RefineOptions, check, solve, source};

/// Each side of the map is this much shorter than that of the photograph.
pub const SWEEP_STRIDE: usize = 1 << LEVEL;

const LEVEL: usize = 1;

/// The cost of a plane at which the photographs do not correlate.
const UNLIKE: f32 = 127.0;

/// The depth map of a reference view, at half the size of its photograph: the correlation of every plane with the
/// source views, semi-global matching, the plane with the least cost. Its confidence is the correlation there, in
/// [0, 1]. Planes should be about [`SWEEP_STRIDE`] pixels apart in the source views.
///
/// # Errors
/// If there is no source, or a photograph, camera or mask does not fit to another.
pub fn plane_sweep(
    reference: &Photo,
    sources: &[&Photo],
    planes: &Planes,
    options: &RefineOptions,
) -> Result<DepthMap, RefineError> {
    let sources = &sources[..sources.len().min(source::MOST_SOURCES)];
    options.validate()?;
    if planes.count < 2 {
        let found = planes.count.to_string();
        return Err(RefineError::Option { name: "planes", expected: "at least 2", found });
    }
    check(reference, sources)?;
    let problem = Problem { reference, sources, visibility: &[], options, device: None };
    let matcher = solve::matcher(&problem, LEVEL);
    let costs = correlated(&matcher, planes);
    let sums = aggregated(&costs, &matcher.image);
    let found = Grid::from_fn(costs.size, |x, y| {
        if matcher.image.at(x, y) < 0.0 {
            return (0.0, 0.0);
        }
        let (plane, u) = cheapest(sums.at(x, y));
        let confidence = (1.0 - f32::from(costs.at(x, y)[plane]) / UNLIKE).max(0.0);
        (planes.depth(u) as f32, confidence)
    });
    Ok(DepthMap {
        camera: source::reduced(&reference.camera, LEVEL),
        cam_from_world: reference.cam_from_world,
        depth: found.map(|found| found.0),
        confidence: found.map(|found| found.1),
        coarse_confidence: None,
    })
}

/// What a sweep takes beside the photographs, bytes: costs and their sums for each plane of the map's pixels.
#[must_use]
pub fn sweep_bytes(photograph: Size, planes: usize) -> u64 {
    let pixels = photograph.area() / (SWEEP_STRIDE * SWEEP_STRIDE);
    (pixels * planes * (size_of::<u8>() + size_of::<u16>())) as u64
}

/// The costs of all planes, from 0 (correlation 1) to 254 (correlation −1).
fn correlated(matcher: &Matcher, planes: &Planes) -> Costs<u8> {
    let (size, count) = (matcher.image.size, planes.count);
    let inverse: Vec<f32> = planes.depths().iter().map(|depth| (1.0 / depth) as f32).collect();
    let middle = inverse[count / 2];
    let mut values = vec![UNLIKE as u8; size.area() * count];
    values.par_chunks_exact_mut((size.width * count).max(1)).enumerate().for_each(|(y, row)| {
        for (x, costs) in row.chunks_exact_mut(count).enumerate() {
            let Some(pixel) = matcher.pixel(x, y, middle, 0.0) else { continue };
            costs.iter_mut().zip(&inverse).for_each(|(cost, &w)| *cost = self::cost(&pixel, w));
        }
    });
    Costs { size, planes: count, values }
}

/// The cost of the plane through a pixel that is parallel to the image.
fn cost(pixel: &Pixel, w: f32) -> u8 {
    let judged = pixel.energy(&Plane { w, gx: 0.0, gy: 0.0 }, None);
    let correlation = if judged.energy == IMPOSSIBLE { 0.0 } else { judged.correlation };
    (UNLIKE * (1.0 - correlation)).round() as u8
}

/// The plane with the least cost, and its coordinate, interpolated with a parabola through its neighbours.
fn cheapest(costs: &[u16]) -> (usize, f64) {
    let plane = (0..costs.len()).min_by_key(|&plane| costs[plane]).unwrap_or(0);
    let beside = plane.checked_sub(1).zip(costs.get(plane + 1));
    let offset = beside.map_or(0.0, |(before, &after)| {
        let [before, own, after] = [costs[before], costs[plane], after].map(f64::from);
        let bend = before - 2.0 * own + after;
        if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 }
    });
    (plane, plane as f64 + offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheapest_plane_is_interpolated() {
        // 4 (u − 2.25)² + 8, and the ends.
        assert_eq!(cheapest(&[900, 15, 8, 10, 900]), (2, 2.0 + 2.5 / 9.0));
        assert_eq!(cheapest(&[3, 5, 9]), (0, 0.0));
        assert_eq!(cheapest(&[9, 5, 3]), (2, 2.0));
        assert_eq!(cheapest(&[4, 4, 4]), (0, 0.0));
    }
}
