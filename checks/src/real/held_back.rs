//! Held-back photographs: a cloud that was made without a photograph is projected into it. How much of the photograph it
//! covers tells completeness, how far its colours are from the photograph's tells floaters and wrong surfaces, both without
//! ground truth.

use serde::Serialize;
use vamvs_core::{CloudPoint, Grid, Rgb, Size};

use super::cameras::Shot;

/// The photograph is reduced by this factor, so that a cloud with about one point a pixel leaves no gaps.
const REDUCED: usize = 2;

/// Points within this share of the nearest point's depth are of one surface.
const ONE_SURFACE: f64 = 0.01;

/// A colour this near to the photograph's explains a pixel, grey values.
const NEAR: f64 = 16.0;

/// Rounds of the fit of exposure; each leaves out more of what does not fit.
const ROUNDS: usize = 4;

/// How well a cloud explains a photograph.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Explained {
    /// Share of the pixels that the cloud covers. What is sky does not count in any of these.
    pub covered: f64,
    /// Mean difference of colour where it does, grey values, after a fit of exposure.
    pub error: f64,
    /// Share of all pixels that are covered with a difference below 16 grey values.
    pub right: f64,
}

impl Explained {
    /// The mean over photographs.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let mean = |of: fn(&Self) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| Self {
            covered: mean(|one| one.covered),
            error: mean(|one| one.error),
            right: mean(|one| one.right),
        })
    }
}

/// Projects a cloud into a photograph, of which some pixels may be sky.
pub fn explain(cloud: &[CloudPoint], shot: &Shot, sky: Option<&Grid<bool>>) -> Explained {
    let Size { width, height } = shot.photo.size();
    let size = Size::new(width / REDUCED, height / REDUCED);
    let photo = reduced(&shot.photo, size);
    let seen = projected(cloud, shot, size);
    let counts = Grid::from_fn(size, |x, y| sky.is_none_or(|sky| !sky[(x * REDUCED, y * REDUCED)]));
    let all = counts.data().iter().filter(|counts| **counts).count().max(1) as f64;
    let pixels = seen.data().iter().zip(photo.data()).zip(counts.data());
    let pairs: Vec<([f64; 3], [f64; 3])> =
        pixels.filter_map(|((seen, photo), counts)| Some(((*seen).filter(|_| *counts)?, *photo))).collect();
    let errors = errors(&pairs);
    let right = errors.iter().filter(|error| **error < NEAR).count();
    Explained {
        covered: pairs.len() as f64 / all,
        error: errors.iter().sum::<f64>() / errors.len().max(1) as f64,
        right: right as f64 / all,
    }
}

/// The mean colour of each block of pixels.
fn reduced(photo: &Grid<Rgb>, size: Size) -> Grid<[f64; 3]> {
    Grid::from_fn(size, |x, y| {
        let mut sum = [0.0; 3];
        for (dx, dy) in (0..REDUCED).flat_map(|dy| (0..REDUCED).map(move |dx| (dx, dy))) {
            let pixel = photo[(x * REDUCED + dx, y * REDUCED + dy)];
            (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
        }
        sum.map(|sum| sum / (REDUCED * REDUCED) as f64)
    })
}

/// The mean colour of the nearest points at each pixel; `None` where there is no point.
fn projected(cloud: &[CloudPoint], shot: &Shot, size: Size) -> Grid<Option<[f64; 3]>> {
    let places: Vec<Option<((usize, usize), f64)>> = cloud
        .iter()
        .map(|point| {
            let ((x, y), depth) = shot.pixel_of(&point.x_in_world)?;
            let place = (x / REDUCED, y / REDUCED);
            (place.0 < size.width && place.1 < size.height).then_some((place, depth))
        })
        .collect();
    let mut nearest = Grid::filled(size, f64::INFINITY);
    for (place, depth) in places.iter().flatten() {
        nearest[*place] = nearest[*place].min(*depth);
    }
    let mut sums = Grid::filled(size, ([0.0; 3], 0.0));
    for (point, place) in cloud.iter().zip(&places) {
        let Some((place, depth)) = *place else { continue };
        if depth <= nearest[place] * (1.0 + ONE_SURFACE) {
            let (sum, count) = &mut sums[place];
            (0..3).for_each(|c| sum[c] += f64::from(point.colour[c]));
            *count += 1.0;
        }
    }
    sums.map(|(sum, count)| (*count > 0.0).then(|| sum.map(|sum| sum / count)))
}

/// The mean difference over the channels of each pair of colours, after gain and offset of each channel are fitted.
fn errors(pairs: &[([f64; 3], [f64; 3])]) -> Vec<f64> {
    let mut errors = vec![0.0; pairs.len()];
    // The median ratio is that of surfaces that are right, as long as half of them are.
    let mut fitted =
        [0, 1, 2].map(|c| (median_ratio(pairs.iter().map(|(cloud, photo)| (cloud[c], photo[c]))), 0.0));
    for round in 0..=ROUNDS {
        if round > 0 {
            let mut sorted = errors.clone();
            sorted.sort_by(f64::total_cmp);
            let limit = 2.0 * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
            fitted = [0, 1, 2].map(|c| {
                let kept = pairs.iter().zip(&errors).filter(|(_, error)| **error <= limit);
                fit(kept.map(|((cloud, photo), _)| (cloud[c], photo[c])))
            });
        }
        for (error, (cloud, photo)) in errors.iter_mut().zip(pairs) {
            *error =
                (0..3).map(|c| (fitted[c].0 * cloud[c] + fitted[c].1 - photo[c]).abs()).sum::<f64>() / 3.0;
        }
    }
    errors
}

/// The median of the second values divided by the first ones; 1 if there are none.
fn median_ratio(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let mut ratios: Vec<f64> = pairs.map(|(a, b)| (b + 1.0) / (a + 1.0)).collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
}

/// The gain and offset that map the first values to the second ones, by least squares; an offset alone if nothing tells a gain.
fn fit(pairs: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    let [mut n, mut x, mut y, mut xx, mut xy] = [0.0; 5];
    for (a, b) in pairs {
        n += 1.0;
        x += a;
        y += b;
        xx += a * a;
        xy += a * b;
    }
    let spread = n * xx - x * x;
    if spread <= 1e-9 * n * n {
        return (1.0, (y - x) / n.max(1.0));
    }
    let gain = (n * xy - x * y) / spread;
    (gain, (y - gain * x) / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Intrinsics, Pinhole, Pose};

    fn shot() -> Shot {
        let size = Size::new(32, 24);
        let photo = Grid::from_fn(size, |x, y| [(60 + 4 * x) as u8, (50 + 5 * y) as u8, 90]);
        let intrinsics = Intrinsics { fx: 30.0, fy: 30.0, cx: 16.0, cy: 12.0 };
        Shot {
            name: String::new(),
            camera: Pinhole { size, intrinsics },
            cam_from_world: Pose::identity(),
            photo,
        }
    }

    /// A point for each pixel of the columns, at a depth, darker than the photograph.
    fn plane(shot: &Shot, columns: std::ops::Range<usize>, depth: f64) -> Vec<CloudPoint> {
        let point = |(x, y): (usize, usize)| CloudPoint {
            x_in_world: [
                (x as f64 + 0.5 - 16.0) / 30.0 * depth,
                (y as f64 + 0.5 - 12.0) / 30.0 * depth,
                depth,
            ],
            normal: [0.0, 0.0, -1.0],
            colour: shot.photo[(x, y)].map(|value| (value as f32 * 0.7).round() as u8),
            confidence: 1.0,
            sigma: 0.0,
            views: 3,
        };
        (0..24).flat_map(|y| columns.clone().map(move |x| (x, y))).map(point).collect()
    }

    #[test]
    fn the_true_surface_explains_what_it_covers_whatever_the_exposure() {
        let shot = shot();
        let found = explain(&plane(&shot, 0..16, 4.0), &shot, None);
        assert!((found.covered - 0.5).abs() < 1e-9 && (found.right - 0.5).abs() < 1e-9);
        assert!(found.error < 1.5, "{found:?}");
    }

    #[test]
    fn floaters_are_seen_as_errors_and_what_they_hide_does_not_count() {
        let shot = shot();
        let mut cloud = plane(&shot, 0..32, 4.0);
        let whole = explain(&cloud, &shot, None);
        let mut floaters = plane(&shot, 4..12, 2.0);
        floaters.iter_mut().for_each(|point| point.colour = [0, 255, 0]);
        cloud.extend(floaters);
        let found = explain(&cloud, &shot, None);
        assert!((found.covered - 1.0).abs() < 1e-9 && found.error > whole.error + 10.0, "{found:?}");
        assert!((found.right - 0.75).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn sky_does_not_count() {
        let shot = shot();
        let sky = Grid::from_fn(shot.photo.size(), |x, _| x >= 16);
        let found = explain(&plane(&shot, 0..24, 4.0), &shot, Some(&sky));
        assert!((found.covered - 1.0).abs() < 1e-9 && (found.right - 1.0).abs() < 1e-9, "{found:?}");
    }
}
