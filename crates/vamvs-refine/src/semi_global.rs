//! Semi-global matching (Hirschmüller, PAMI 2008): the costs of planes, summed along paths over the image on which a
//! change of plane has a price.

use rayon::prelude::*;
use vamvs_core::Size;

use crate::luminance::Padded;

/// The price of a change to a neighbouring plane.
const STEP: u16 = 10;

/// The price of any other change, where the photograph is smooth.
const JUMP: f32 = 110.0;

/// Difference of luminance at which that price is halved, grey values.
const EDGE: f32 = 12.0;

/// Stands for planes that do not exist; larger than any sum along a path.
const NEVER: u16 = u16::MAX / 2;

/// The costs of the planes of all pixels: planes first, then columns, then rows.
pub(crate) struct Costs<T> {
    pub size: Size,
    pub planes: usize,
    pub values: Vec<T>,
}

impl<T> Costs<T> {
    /// The costs of a pixel's planes.
    pub fn at(&self, x: usize, y: usize) -> &[T] {
        &self.values[(y * self.size.width + x) * self.planes..][..self.planes]
    }
}

/// The sums of the costs along eight paths to each pixel. Changes of plane are cheap at edges of the image.
pub(crate) fn aggregated(costs: &Costs<u8>, image: &Padded) -> Costs<u16> {
    let mut sums = Costs { size: costs.size, planes: costs.planes, values: vec![0; costs.values.len()] };
    along_rows(costs, image, &mut sums);
    for down in [true, false] {
        for right in [-1, 0, 1] {
            across_rows(costs, image, (right, down), &mut sums);
        }
    }
    sums
}

/// The paths from the left and from the right.
fn along_rows(costs: &Costs<u8>, image: &Padded, sums: &mut Costs<u16>) {
    let (width, planes) = (costs.size.width, costs.planes);
    sums.values.par_chunks_exact_mut((width * planes).max(1)).enumerate().for_each(|(y, sums)| {
        let (mut before, mut here) = (Path::new(planes), Path::new(planes));
        for backwards in [false, true] {
            for step in 0..width {
                let x = if backwards { width - 1 - step } else { step };
                let from = if backwards { x + 1 } else { x.wrapping_sub(1) };
                let from = (step > 0).then(|| (&before, jump(image, (x, y), (from, y))));
                here.extend(from, costs.at(x, y));
                here.add_to(&mut sums[x * planes..][..planes]);
                std::mem::swap(&mut before, &mut here);
            }
        }
    });
}

/// The paths from the row above (`down`) or below, from the pixel `right` columns to the left.
fn across_rows(costs: &Costs<u8>, image: &Padded, (right, down): (isize, bool), sums: &mut Costs<u16>) {
    let (Size { width, height }, planes) = (costs.size, costs.planes);
    let row = || (0..width).map(|_| Path::new(planes)).collect::<Vec<_>>();
    let (mut before, mut here) = (row(), row());
    for step in 0..height {
        let y = if down { step } else { height - 1 - step };
        let last = if down { y.wrapping_sub(1) } else { y + 1 };
        let sums = sums.values[y * width * planes..][..width * planes].par_chunks_exact_mut(planes);
        here.par_iter_mut().zip(sums).enumerate().with_min_len(32).for_each(|(x, (here, sums))| {
            let from = x.checked_add_signed(-right).filter(|&from| step > 0 && from < width);
            let from = from.map(|from| (&before[from], jump(image, (x, y), (from, last))));
            here.extend(from, costs.at(x, y));
            here.add_to(sums);
        });
        std::mem::swap(&mut before, &mut here);
    }
}

/// The price of a jump between two neighbouring pixels.
fn jump(image: &Padded, (x, y): (usize, usize), (from_x, from_y): (usize, usize)) -> u16 {
    let difference = (image.at(x, y) - image.at(from_x, from_y)) / EDGE;
    STEP + (JUMP / (1.0 + difference * difference)) as u16
}

/// The costs of a path that ends at a pixel, for each plane there, between two planes that do not exist.
struct Path {
    costs: Vec<u16>,
    least: u16,
}

impl Path {
    fn new(planes: usize) -> Self {
        Self { costs: vec![NEVER; planes + 2], least: 0 }
    }

    /// The path `from` a neighbouring pixel, where a jump has the given price, extended to a pixel with the costs
    /// `own`; without `from` it begins there.
    fn extend(&mut self, from: Option<(&Self, u16)>, own: &[u8]) {
        let planes = own.len();
        let here = &mut self.costs[1..=planes];
        match from {
            None => here.iter_mut().zip(own).for_each(|(here, &own)| *here = u16::from(own)),
            Some((from, jump)) => {
                let (nearer, same, farther) =
                    (&from.costs[..planes], &from.costs[1..=planes], &from.costs[2..planes + 2]);
                let far = from.least + jump;
                for i in 0..planes {
                    let beside = nearer[i].min(farther[i]) + STEP;
                    here[i] = u16::from(own[i]) + same[i].min(beside).min(far) - from.least;
                }
            }
        }
        self.least = here.iter().copied().min().unwrap_or(0);
    }

    fn add_to(&self, sums: &mut [u16]) {
        sums.iter_mut().zip(&self.costs[1..]).for_each(|(sum, cost)| *sum += cost);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::Grid;

    /// The least cost of a path by trying all of them: from the left, in a row.
    fn by_brute_force(costs: &Costs<u8>, image: &Padded, x: usize, plane: usize) -> i32 {
        let own = i32::from(costs.at(x, 0)[plane]);
        if x == 0 {
            return own;
        }
        let before = (0..costs.planes).map(|other| {
            let price = match plane.abs_diff(other) {
                0 => 0,
                1 => i32::from(STEP),
                _ => i32::from(jump(image, (x, 0), (x - 1, 0))),
            };
            by_brute_force(costs, image, x - 1, other) + price
        });
        own + before.min().unwrap()
    }

    #[test]
    fn a_path_has_the_least_cost_of_all_paths() {
        let size = Size::new(5, 1);
        let values = (0..30_usize).map(|i| ((i * i * 37 + i * 11) % 251) as u8).collect();
        let costs = Costs { size, planes: 6, values };
        let image = Padded::new(&Grid::from_fn(size, |x, _| [10, 12, 90, 91, 95][x]), None);
        let (mut before, mut here) = (Path::new(6), Path::new(6));
        let mut lifted = 0; // What the recursion subtracts, so that sums stay small.
        for x in 0..5 {
            let from = (x > 0).then(|| (&before, jump(&image, (x, 0), (x - 1, 0))));
            lifted += from.as_ref().map_or(0, |(before, _)| i32::from(before.least));
            here.extend(from, costs.at(x, 0));
            for plane in 0..6 {
                let found = i32::from(here.costs[plane + 1]) + lifted;
                assert_eq!(found, by_brute_force(&costs, &image, x, plane), "pixel {x}, plane {plane}");
            }
            std::mem::swap(&mut before, &mut here);
        }
    }

    #[test]
    fn a_surface_without_texture_takes_the_plane_around_it() {
        let size = Size::new(21, 15);
        let middle = |x: usize, y: usize| (5..16).contains(&x) && (4..11).contains(&y);
        let cost = |x: usize, y: usize, plane: usize| match (middle(x, y), plane) {
            (true, _) => 128,
            (false, 7) => 20,
            (false, _) => 140,
        };
        let values = (0..size.area()).flat_map(|i| (0..12).map(move |plane| cost(i % 21, i / 21, plane)));
        let costs = Costs { size, planes: 12, values: values.collect() };
        let sums = aggregated(&costs, &Padded::new(&Grid::filled(size, 100), None));
        for y in 0..15 {
            for x in 0..21 {
                let best = (0..12).min_by_key(|&plane| sums.at(x, y)[plane]);
                assert_eq!(best, Some(7), "pixel {x}, {y}");
            }
        }
    }
}
