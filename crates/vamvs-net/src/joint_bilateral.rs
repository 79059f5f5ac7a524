//! Joint bilateral upsampling: doubles the size of a depth map and aligns its edges with those of the photograph.
//!
//! If a window of the coarse map contains two surfaces, a fine pixel takes the median of the window's depths,
//! weighted by similarity of colour and by distance, so it joins the surface whose colour it has. Everywhere else
//! it takes the depth of the nearest coarse pixel.

use rayon::prelude::*;

use vamvs_core::{Grid, Rgb, Size};

/// Radius of the window, coarse pixels.
const RADIUS: usize = 2;
const WINDOW: usize = (2 * RADIUS + 1) * (2 * RADIUS + 1);

/// Standard deviation of the distance weight, coarse pixels.
const DISTANCE: f32 = 1.2;
/// Added to every weight, so that the weights never sum to zero.
const LEAST: f32 = 1e-9;

/// The parameters of the upsampling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guidance {
    /// Standard deviation of the colour weight, grey values.
    pub colour: f32,
    /// A window whose depths differ by more than this contains two surfaces; in the unit of the depths.
    pub jump: f32,
}

/// Upsamples `u`, the depth map of the photograph `coarse`, to the size of `fine`, the same photograph at twice the
/// size.
#[must_use]
pub fn upsample(u: &Grid<f32>, coarse: &Grid<Rgb>, fine: &Grid<Rgb>, guidance: Guidance) -> Grid<f32> {
    let mut out = Grid::filled(fine.size(), 0.0);
    let width = fine.width().max(1);
    out.data_mut().par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            *value = pixel(u, coarse, fine, [x, y], guidance);
        }
    });
    out
}

fn pixel(u: &Grid<f32>, coarse: &Grid<Rgb>, fine: &Grid<Rgb>, [x, y]: [usize; 2], guidance: Guidance) -> f32 {
    let Size { width, height } = u.size();
    let (cx, cy) = (x / 2, y / 2);
    let columns = cx.saturating_sub(RADIUS)..(cx + RADIUS + 1).min(width);
    let rows = cy.saturating_sub(RADIUS)..(cy + RADIUS + 1).min(height);
    let own = u[(cx, cy)];
    let window = rows.clone().flat_map(|y| &u.row(y)[columns.clone()]);
    let (low, high) = window.fold((own, own), |(low, high), &u| (low.min(u), high.max(u)));
    if high - low <= guidance.jump {
        return own;
    }
    let colour = fine[(x, y)];
    let place = [x, y].map(|c| (c as f32 + 0.5) / 2.0 - 0.5);
    let mut candidates = [(0.0_f32, 0.0_f32); WINDOW];
    let places = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
    let mut count = 0;
    for ((x, y), candidate) in places.zip(&mut candidates) {
        let other = coarse[(x, y)];
        let difference: f32 = (0..3).map(|c| (f32::from(colour[c]) - f32::from(other[c])).powi(2)).sum();
        let distance = (x as f32 - place[0]).powi(2) + (y as f32 - place[1]).powi(2);
        let exponent = difference / guidance.colour.powi(2) + distance / DISTANCE.powi(2);
        *candidate = (u[(x, y)], (-0.5 * exponent).exp() + LEAST);
        count += 1;
    }
    weighted_median(&mut candidates[..count])
}

/// The weighted median of (value, weight) pairs, which are sorted by value.
fn weighted_median(candidates: &mut [(f32, f32)]) -> f32 {
    candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * candidates.iter().map(|(_, weight)| weight).sum::<f32>();
    let mut sum = 0.0;
    for &(value, weight) in candidates.iter() {
        sum += weight;
        if sum >= half {
            return value;
        }
    }
    candidates.last().map_or(f32::NAN, |last| last.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GUIDANCE: Guidance = Guidance { colour: 40.0, jump: 1.5 };

    #[test]
    fn an_edge_inside_a_coarse_pixel_comes_to_lie_where_colours_change() {
        let (coarse_size, fine_size) = (Size::new(12, 8), Size::new(24, 16));
        // The edge is at fine column 13, in the middle of coarse column 6, all of which has the left depth in the map.
        let fine = Grid::from_fn(fine_size, |x, _| if x < 13 { [20; 3] } else { [230; 3] });
        let coarse = Grid::from_fn(coarse_size, |x, _| match x {
            0..6 => [20; 3],
            6 => [125; 3],
            _ => [230; 3],
        });
        let u = Grid::from_fn(coarse_size, |x, _| if x < 7 { 4.0 } else { 40.0 });
        let upsampled = upsample(&u, &coarse, &fine, GUIDANCE);
        for y in 0..fine_size.height {
            for x in 0..fine_size.width {
                assert_eq!(upsampled[(x, y)], if x < 13 { 4.0 } else { 40.0 }, "at {x}, {y}");
            }
        }
    }

    #[test]
    fn on_one_surface_the_nearest_depth_stays_whatever_the_colours() {
        let u = Grid::from_fn(Size::new(9, 7), |x, y| 0.2 * x as f32 + 0.1 * y as f32);
        let colours = |size| Grid::from_fn(size, |x, y| [(x * 97 + y * 31) as u8; 3]);
        let (coarse, fine) = (colours(u.size()), colours(Size::new(18, 14)));
        assert_eq!(upsample(&u, &coarse, &fine, GUIDANCE), u.resized_nearest(fine.size()));
    }

    #[test]
    fn the_median_goes_by_weight() {
        assert_eq!(weighted_median(&mut [(9.0, 0.2), (1.0, 0.3), (5.0, 0.5)]), 5.0);
        assert_eq!(weighted_median(&mut [(9.0, 0.6), (1.0, 0.3), (5.0, 0.1)]), 9.0);
    }
}
