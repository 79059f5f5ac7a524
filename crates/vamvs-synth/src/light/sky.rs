//! Light from infinitely far, sampled by how bright it is.

use std::f32::consts::{PI, TAU};

use nalgebra::Vector3;
use vamvs_core::{Grid, Size};

use crate::Environment;
use crate::colour::luminance;
use crate::surface::around;

/// An environment with the distribution of its light. Its pixels' columns run clockwise seen from
/// above, so that it is not mirrored for a viewer inside.
pub(crate) struct Sky {
    environment: Environment,
    /// For each row, the running sum of its pixels' shares of the row's light.
    columns: Grid<f32>,
    /// The running sum of the rows' shares of all light.
    rows: Vec<f32>,
    /// Mean luminance over all directions.
    mean: f32,
}

impl Sky {
    pub fn new(environment: &Environment) -> Self {
        let map = &environment.map;
        let size = map.size();
        let mean_over = |x, y| luminance(mean_of_interpolated(map, x, y));
        let light = Grid::from_fn(size, |x, y| mean_over(x, y) * row_height(size, y));
        let mut columns = Grid::filled(size, 0.0);
        let sums = (0..size.height).map(|y| running_shares(light.row(y), columns.row_mut(y)));
        let sums: Vec<f32> = sums.collect();
        let mut rows = vec![0.0; size.height];
        let total = running_shares(&sums, &mut rows);
        let mean = environment.strength * total / (2.0 * size.width as f32);
        Self { environment: environment.clone(), columns, rows, mean }
    }

    /// Mean luminance over all directions.
    pub fn mean_luminance(&self) -> f32 {
        self.mean
    }

    /// Linear radiance from a direction.
    pub fn radiance(&self, direction: &Vector3<f32>) -> Vector3<f32> {
        let (u, height) = self.coordinates(direction);
        let size = self.columns.size();
        let (x, y) = (u * size.width as f32 - 0.5, height.acos() / PI * size.height as f32 - 0.5);
        interpolated(&self.environment.map, x, y) * self.environment.strength
    }

    /// A direction and its density by solid angle, for numbers in [0, 1).
    pub fn sample(&self, [u, v]: [f32; 2]) -> (Vector3<f32>, f32) {
        let size = self.columns.size();
        let (y, v) = pick(&self.rows, v);
        let (x, u) = pick(self.columns.row(y), u);
        let (above, below) = row_bounds(size, y);
        let height = above + v * (below - above);
        let turn = (x as f32 + u) / size.width as f32 - self.environment.rotation as f32 / TAU;
        (around(height, -turn), self.cell_density(x, y))
    }

    /// The density of [`Self::sample`] at a direction.
    pub fn density(&self, direction: &Vector3<f32>) -> f32 {
        let (u, height) = self.coordinates(direction);
        let size = self.columns.size();
        let column = ((u * size.width as f32) as usize).min(size.width - 1);
        let row = ((height.acos() / PI * size.height as f32) as usize).min(size.height - 1);
        self.cell_density(column, row)
    }

    /// Turns in [0, 1) from the map's left border, and the height.
    fn coordinates(&self, direction: &Vector3<f32>) -> (f32, f32) {
        let azimuth = direction.y.atan2(direction.x) - self.environment.rotation as f32;
        ((-azimuth / TAU).rem_euclid(1.0), direction.z.clamp(-1.0, 1.0))
    }

    fn cell_density(&self, x: usize, y: usize) -> f32 {
        let size = self.columns.size();
        let share = step(&self.rows, y) * step(self.columns.row(y), x);
        share * size.width as f32 / (TAU * row_height(size, y))
    }
}

/// Heights z of the upper and the lower border of a row.
fn row_bounds(size: Size, y: usize) -> (f32, f32) {
    let border = |y: usize| (PI * y as f32 / size.height as f32).cos();
    (border(y), border(y + 1))
}

/// A row's extent in z: its share of the sphere is half of that.
fn row_height(size: Size, y: usize) -> f32 {
    let (above, below) = row_bounds(size, y);
    above - below
}

/// Writes the running sums of `weights`, scaled to end at 1, and gives their unscaled sum. Where there
/// is no weight at all, all are equal.
fn running_shares(weights: &[f32], shares: &mut [f32]) -> f32 {
    let total: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
    let even = 1.0 / weights.len() as f64;
    let mut running = 0.0;
    for (share, &weight) in shares.iter_mut().zip(weights) {
        running += if total > 0.0 { f64::from(weight) / total } else { even };
        *share = running as f32;
    }
    total as f32
}

/// The share of entry `index`.
fn step(shares: &[f32], index: usize) -> f32 {
    shares[index] - if index == 0 { 0.0 } else { shares[index - 1] }
}

/// The entry that a number in [0, 1) falls into, and how far it is within the entry.
fn pick(shares: &[f32], number: f32) -> (usize, f32) {
    let index = shares.partition_point(|&share| share <= number).min(shares.len() - 1);
    let below = shares[index] - step(shares, index);
    let within = (number - below) / step(shares, index);
    (index, if within.is_nan() { 0.5 } else { within.clamp(0.0, 1.0) })
}

/// The map between its pixels' centres; it is closed along x.
fn interpolated(map: &Grid<[f32; 3]>, x: f32, y: f32) -> Vector3<f32> {
    let (left, top) = (x.floor(), y.floor());
    let column = |i: i64| i.rem_euclid(map.width() as i64) as usize;
    let row = |j: i64| j.clamp(0, map.height() as i64 - 1) as usize;
    let (i, j) = (left as i64, top as i64);
    let at = |i, j| Vector3::from(map[(column(i), row(j))]);
    let along = |j| at(i, j).lerp(&at(i + 1, j), x - left);
    along(j).lerp(&along(j + 1), y - top)
}

/// The mean over a pixel of the interpolated map: each neighbour reaches half a pixel into it.
fn mean_of_interpolated(map: &Grid<[f32; 3]>, x: usize, y: usize) -> [f32; 3] {
    let weights = [0.125, 0.75, 0.125];
    let column = |i: usize| (x + i + map.width() - 1) % map.width();
    let row = |j: usize| (y + j).clamp(1, map.height()) - 1;
    let mut mean = [0.0; 3];
    for (j, i) in (0..9).map(|k| (k / 3, k % 3)) {
        let colour = map[(column(i), row(j))];
        mean.iter_mut().zip(colour).for_each(|(mean, light)| *mean += weights[i] * weights[j] * light);
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    /// A dim sky with a gradient and a small sun.
    fn sky(size: Size, rotation: f64) -> Sky {
        let sun = (size.width / 3, size.height / 4);
        let value = |x, y| if (x, y) == sun { [300.0, 280.0, 200.0] } else { [0.1 + 0.01 * y as f32; 3] };
        Sky::new(&Environment { map: Arc::new(Grid::from_fn(size, value)), rotation, strength: 2.0 })
    }

    fn points(count: u32) -> impl Iterator<Item = [f32; 2]> {
        (0..count).map(move |i| [i.reverse_bits() as f32 / 2.0_f32.powi(32), (i as f32 + 0.5) / count as f32])
    }

    #[test]
    fn samples_have_the_density_that_is_told_for_their_direction() {
        let sky = sky(Size::new(48, 24), 0.7);
        let alike = |uv| {
            let (direction, density) = sky.sample(uv);
            (sky.density(&direction) - density).abs() < 1e-3 * density
        };
        let agreeing = points(4096).filter(|&uv| alike(uv)).count();
        assert!(agreeing > 4090, "{agreeing}: only samples at the border of a pixel may round into the next");
    }

    #[test]
    fn the_light_summed_by_samples_is_that_of_evenly_spread_directions() {
        let sky = sky(Size::new(48, 24), -2.0);
        let up = |direction: &Vector3<f32>| direction.z.max(0.0) * sky.radiance(direction).x;
        let by_samples = |uv| {
            let (direction, density) = sky.sample(uv);
            up(&direction) / density
        };
        let count = 1 << 18;
        let sampled = points(1 << 14).map(by_samples).sum::<f32>() / (1 << 14) as f32;
        let even: f64 = points(count).map(|[u, v]| f64::from(up(&around(2.0 * v - 1.0, u)))).sum();
        let even = even as f32 * 2.0 * TAU / count as f32;
        assert!((sampled / even - 1.0).abs() < 5e-3, "{sampled} {even}");
    }

    #[test]
    fn rotation_turns_the_light_and_the_map_is_not_mirrored_inside() {
        let map = Arc::new(Grid::from_fn(Size::new(4, 1), |x, _| [x as f32; 3]));
        let sky = |rotation| Sky::new(&Environment { map: map.clone(), rotation, strength: 1.0 });
        let at = |sky: &Sky, degrees: f32| {
            sky.radiance(&Vector3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0)).x
        };
        // Column 0 spans azimuths 0 to −90 degrees; its middle is at −45.
        for (column, azimuth) in [(0.0, -45.0), (1.0, -135.0), (2.0, 135.0), (3.0, 45.0)] {
            assert!((at(&sky(0.0), azimuth) - column).abs() < 1e-4);
            assert!((at(&sky(0.5), azimuth + 0.5_f32.to_degrees()) - column).abs() < 1e-4);
        }
    }

    #[test]
    fn a_black_sky_can_be_sampled() {
        let map = Arc::new(Grid::filled(Size::new(8, 4), [0.0; 3]));
        let sky = Sky::new(&Environment { map, rotation: 0.0, strength: 1.0 });
        let (direction, density) = sky.sample([0.3, 0.8]);
        assert!(direction.norm() > 0.99 && density > 0.0);
        assert_eq!(sky.mean_luminance(), 0.0);
    }
}
