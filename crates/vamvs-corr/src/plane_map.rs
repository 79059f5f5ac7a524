//! Depth in plane coordinates from costs, and from a map of half the resolution.

use rayon::prelude::*;

use crate::map::Map;
use crate::wide::{exp, widened};

/// A depth map in plane coordinates.
#[derive(Debug)]
pub struct PlaneMap {
    pub width: usize,
    pub height: usize,
    /// Depths, (h, w).
    pub u: Vec<f32>,
    /// The probability of the two planes that enclose each, (h, w).
    pub confidence: Vec<f32>,
    /// How widely the probability is spread over the planes: its entropy as a share of the largest, (h, w).
    pub spread: Vec<f32>,
}

impl PlaneMap {
    /// The soft-argmin of costs (D, h, w) over the planes within `window` of the most probable one.
    pub fn of(costs: &[f32], (width, height): (usize, usize), window: usize) -> Self {
        let area = width * height;
        let mut maps = [vec![0.0; area], vec![0.0; area], vec![0.0; area]];
        let [u, confidence, spread] = maps.each_mut();
        let rows =
            u.par_chunks_mut(width).zip(confidence.par_chunks_mut(width)).zip(spread.par_chunks_mut(width));
        rows.enumerate().for_each_init(Vec::new, |probability, (y, ((u, confidence), spread))| {
            row_of_costs((costs, area), (y, window), probability, [u, confidence, spread]);
        });
        let [u, confidence, spread] = maps;
        Self { width, height, u, confidence, spread }
    }

    /// A quantity of each pixel as an image.
    pub fn as_image(&self, of: &[f32]) -> Map {
        Map::image((self.width, self.height, 1), of.to_vec())
    }
}

/// One row of a map, [depths, confidences, spreads], from costs with planes of `area` pixels; `probability` is scratch memory.
#[inline(always)]
fn row_of(
    (costs, area): (&[f32], usize),
    (y, window): (usize, usize),
    probability: &mut Vec<f32>,
    [u, confidence, spread]: [&mut [f32]; 3],
) {
    let (width, count) = (u.len(), costs.len() / area);
    let of_plane = |plane: usize| &costs[plane * area + y * width..][..width];
    // Until they are known, depths are the least costs, and confidences the sums of what the costs are the logarithms of.
    u.copy_from_slice(of_plane(0));
    for plane in 1..count {
        u.iter_mut().zip(of_plane(plane)).for_each(|(least, cost)| *least = least.min(*cost));
    }
    probability.resize(count * width, 0.0);
    confidence.fill(0.0);
    spread.fill(0.0);
    for (plane, probability) in probability.chunks_exact_mut(width).enumerate() {
        for (x, (probability, cost)) in probability.iter_mut().zip(of_plane(plane)).enumerate() {
            let logarithm = u[x] - cost;
            *probability = exp(logarithm);
            confidence[x] += *probability;
            spread[x] -= *probability * logarithm;
        }
    }
    let largest_entropy = (count as f32).ln();
    for x in 0..width {
        let (sum, at) = (confidence[x], |plane: usize| probability[plane * width + x]);
        // −Σ p ln p of p = q / Σq is −Σ q ln q / Σq + ln Σq.
        spread[x] = (spread[x] / sum + sum.ln()) / largest_entropy;
        let likeliest = (1..count).fold(0, |best, plane| if at(plane) > at(best) { plane } else { best });
        let near = likeliest.saturating_sub(window)..(likeliest + window + 1).min(count);
        let (mut mass, mut moment) = (0.0, 0.0);
        for plane in near {
            mass += at(plane);
            moment += (plane as f32 - likeliest as f32) * at(plane);
        }
        u[x] = moment / mass + likeliest as f32;
        let below = (u[x].max(0.0) as usize).min(count.saturating_sub(2));
        confidence[x] = (at(below) + at((below + 1).min(count - 1))) / sum;
    }
}

widened!(row_of => row_of_costs(
    costs: (&[f32], usize),
    at: (usize, usize),
    probability: &mut Vec<f32>,
    out: [&mut [f32]; 3],
));

/// Depths that differ by more than this are of different surfaces; plane distances.
pub const ONE_SURFACE: f32 = 1.0;

/// The depth map `u` at twice its size: for each pixel, with its shares of the 3×3 pixels around it, the mean of the likeliest and of
/// those on one surface with it, so that no pixel lies between two surfaces.
pub fn enlarged_depth(u: &Map, shares: &Map) -> Vec<f32> {
    let mut out = vec![0.0; shares.width * shares.height];
    out.par_chunks_mut(shares.width).enumerate().for_each(|(y, out)| {
        let shares = shares.line(y).as_chunks::<9>().0;
        for (x, (out, shares)) in out.iter_mut().zip(shares).enumerate() {
            let depths = around(u, x / 2, y / 2);
            let likeliest = (1..9).fold(0, |best, k| if shares[k] > shares[best] { k } else { best });
            let (mut mass, mut sum) = (0.0, 0.0);
            for (share, depth) in shares.iter().zip(depths) {
                if (depth - depths[likeliest]).abs() <= ONE_SURFACE {
                    mass += share;
                    sum += share * depth;
                }
            }
            *out = sum / mass;
        }
    });
    out
}

/// The values of the 3×3 pixels around one of an image with one channel, rows first; the border is repeated.
pub fn around(map: &Map, x: usize, y: usize) -> [f32; 9] {
    std::array::from_fn(|k| map.line(row_near(y, k / 3, map.height))[row_near(x, k % 3, map.width)])
}

/// The coordinate `at` − 1 + `step`, inside of an image of this side.
pub fn row_near(at: usize, step: usize, side: usize) -> usize {
    (at + step).saturating_sub(1).min(side - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Planes of one pixel with these probabilities.
    fn map_of(probability: &[f32]) -> PlaneMap {
        let costs: Vec<f32> = probability.iter().map(|p| -p.max(1e-30).ln()).collect();
        PlaneMap::of(&costs, (1, 1), 2)
    }

    #[test]
    fn near_the_likeliest_plane_another_surface_does_not_count() {
        let map = map_of(&[0.0, 1.0 / 3.0, 0.0, 0.0, 0.0, 0.4, 4.0 / 15.0]);
        assert!((map.u[0] - 5.4).abs() < 1e-5 && (map.confidence[0] - 2.0 / 3.0).abs() < 1e-5, "{map:?}");
    }

    #[test]
    fn the_spread_is_that_of_the_probabilities() {
        assert!((map_of(&[0.2; 5]).spread[0] - 1.0).abs() < 1e-5);
        assert!(map_of(&[0.0, 0.0, 1.0, 0.0]).spread[0].abs() < 1e-5);
        let expected = -(0.5 * 0.5_f32.ln() + 2.0 * 0.25 * 0.25_f32.ln()) / 3.0_f32.ln();
        assert!((map_of(&[0.25, 0.5, 0.25]).spread[0] - expected).abs() < 1e-5);
    }

    /// Where a depth breaks, each pixel has the depth of one side; on a slope it has the mean.
    #[test]
    fn a_pixel_never_lies_between_two_surfaces() {
        let u = Map::image((4, 1, 1), vec![1.0, 1.5, 9.0, 9.2]);
        let mut shares = Map::new([1, 2, 8], 9);
        for (column, left, middle, right) in [(0, 0.0, 1.0, 0.0), (2, 0.3, 0.6, 0.1), (3, 0.1, 0.4, 0.5)] {
            shares.values[column * 9 + 3..column * 9 + 6].copy_from_slice(&[left, middle, right]);
        }
        let depth = enlarged_depth(&u, &shares);
        assert!((depth[0] - 1.0).abs() < 1e-6 && (depth[3] - 9.0).abs() < 1e-6, "{depth:?}");
        assert!((depth[2] - (0.3 * 1.0 + 0.6 * 1.5) / 0.9).abs() < 1e-6, "{depth:?}");
    }
}
