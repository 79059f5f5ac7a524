//! The sky: light from infinitely far away, sampled in proportion to its brightness.

use std::f32::consts::{PI, TAU};

use nalgebra::Vector3;
use vamvs_core::{Grid, Size};

use crate::Environment;
use crate::colour::luminance;
use crate::surface::around;

/// Largest width of the map that lights surfaces, pixels: 1.4 degrees each, and small enough for a processor's
/// cache.
const LIGHT_WIDTH: usize = 256;

/// An environment with the distribution of its light. The map's columns run clockwise as seen from above, so that
/// a viewer inside does not see it mirrored.
pub(crate) struct Sky {
    environment: Environment,
    /// The map that lights surfaces: the environment's, reduced.
    light: Grid<[f32; 3]>,
    /// For each row, the cumulative distribution of its light over the columns.
    columns: Grid<f32>,
    /// The cumulative distribution of all light over the rows.
    rows: Vec<f32>,
    /// Mean luminance over all directions.
    mean: f32,
}

/// Light from a direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SkyLight {
    /// Linear radiance.
    pub radiance: Vector3<f32>,
    /// Probability density of [`Sky::sample`], by solid angle.
    pub density: f32,
}

impl Sky {
    pub fn new(environment: &Environment) -> Self {
        let light = reduced(&environment.map, LIGHT_WIDTH);
        let size = light.size();
        let mean_over = |x, y| luminance(mean_of_interpolated(&light, x, y));
        let weights = Grid::from_fn(size, |x, y| mean_over(x, y) * row_height(size, y));
        let mut columns = Grid::filled(size, 0.0);
        let sums = (0..size.height).map(|y| running_shares(weights.row(y), columns.row_mut(y)));
        let sums: Vec<f32> = sums.collect();
        let mut rows = vec![0.0; size.height];
        let total = running_shares(&sums, &mut rows);
        let mean = environment.strength * total / (2.0 * size.width as f32);
        Self { environment: environment.clone(), light, columns, rows, mean }
    }

    /// Mean luminance over all directions.
    pub fn mean_luminance(&self) -> f32 {
        self.mean
    }

    /// The radiance that a camera sees in a direction, in full resolution.
    pub fn background(&self, direction: &Vector3<f32>) -> Vector3<f32> {
        let place = self.place(direction);
        interpolated(&self.environment.map, place) * self.environment.strength
    }

    /// The light that a surface gets from a direction.
    pub fn light(&self, direction: &Vector3<f32>) -> SkyLight {
        let place = self.place(direction);
        let Size { width, height } = self.light.size();
        let column = ((place[0] * width as f32) as usize).min(width - 1);
        let row = ((place[1] * height as f32) as usize).min(height - 1);
        SkyLight { radiance: self.radiance(place), density: self.cell_density(column, row) }
    }

    /// Samples a direction, from two numbers in [0, 1); returns it with the light from there.
    pub fn sample(&self, [u, v]: [f32; 2]) -> (Vector3<f32>, SkyLight) {
        let size = self.light.size();
        let (y, v) = pick(&self.rows, v);
        let (x, u) = pick(self.columns.row(y), u);
        let (above, below) = row_bounds(size, y);
        let height = above + v * (below - above);
        let turn = (x as f32 + u) / size.width as f32;
        let radiance = self.radiance([turn, height.clamp(-1.0, 1.0).acos() / PI]);
        let direction = around(height, -turn + self.environment.rotation as f32 / TAU);
        (direction, SkyLight { radiance, density: self.cell_density(x, y) })
    }

    fn radiance(&self, place: [f32; 2]) -> Vector3<f32> {
        interpolated(&self.light, place) * self.environment.strength
    }

    /// The place of a direction on the map: (from the left, from the top), each 0 to 1.
    fn place(&self, direction: &Vector3<f32>) -> [f32; 2] {
        let azimuth = direction.y.atan2(direction.x) - self.environment.rotation as f32;
        [(-azimuth / TAU).rem_euclid(1.0), direction.z.clamp(-1.0, 1.0).acos() / PI]
    }

    fn cell_density(&self, x: usize, y: usize) -> f32 {
        let size = self.light.size();
        let share = step(&self.rows, y) * step(self.columns.row(y), x);
        share * size.width as f32 / (TAU * row_height(size, y))
    }
}

/// The z of the upper and the lower border of a row, on the unit sphere.
fn row_bounds(size: Size, y: usize) -> (f32, f32) {
    let border = |y: usize| (PI * y as f32 / size.height as f32).cos();
    (border(y), border(y + 1))
}

/// The extent of a row in z; half of it is the row's share of the sphere.
fn row_height(size: Size, y: usize) -> f32 {
    let (above, below) = row_bounds(size, y);
    above - below
}

/// Writes the cumulative distribution of `weights` to `shares` and returns the sum of `weights`. If that is 0, the
/// distribution is uniform.
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

/// The probability of entry `index` of a cumulative distribution.
fn step(shares: &[f32], index: usize) -> f32 {
    shares[index] - if index == 0 { 0.0 } else { shares[index - 1] }
}

/// Samples a cumulative distribution: the entry that `number`, in [0, 1), falls into, and its position within the
/// entry, 0 to 1.
fn pick(shares: &[f32], number: f32) -> (usize, f32) {
    let index = shares.partition_point(|&share| share <= number).min(shares.len() - 1);
    let below = shares[index] - step(shares, index);
    let within = (number - below) / step(shares, index);
    (index, if within.is_nan() { 0.5 } else { within.clamp(0.0, 1.0) })
}

/// The map reduced to at most `width` pixels across; each pixel is the mean of those that fall into it, weighted by
/// solid angle.
fn reduced(map: &Grid<[f32; 3]>, width: usize) -> Grid<[f32; 3]> {
    let from = map.size();
    let height = (from.height * width / from.width.max(1)).max(1);
    if from.width <= width {
        return map.clone();
    }
    let mut sums = Grid::filled(Size::new(width, height), [0.0_f32; 4]);
    for y in 0..from.height {
        let (row, weight) = (y * height / from.height, row_height(from, y));
        for (x, light) in map.row(y).iter().enumerate() {
            let sum = &mut sums[(x * width / from.width, row)];
            sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += weight * light);
            sum[3] += weight;
        }
    }
    sums.map(|&[red, green, blue, weight]| [red / weight, green / weight, blue / weight])
}

/// The map, bilinearly interpolated at `place`; it wraps around along x.
fn interpolated(map: &Grid<[f32; 3]>, place: [f32; 2]) -> Vector3<f32> {
    let (x, y) = (place[0] * map.width() as f32 - 0.5, place[1] * map.height() as f32 - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let column = |i: f32| (i as isize).rem_euclid(map.width() as isize) as usize;
    let row = |j: f32| (j.max(0.0) as usize).min(map.height() - 1);
    let (x0, x1) = (column(left), column(left + 1.0));
    let along = |j| {
        let row = map.row(row(j));
        Vector3::from(row[x0]).lerp(&row[x1].into(), x - left)
    };
    along(top).lerp(&along(top + 1.0), y - top)
}

/// The mean of the interpolated map over a pixel, into which each neighbour reaches half a pixel.
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
    fn samples_have_the_light_that_is_told_for_their_direction() {
        let sky = sky(Size::new(48, 24), 0.7);
        let alike = |uv| {
            let (direction, light) = sky.sample(uv);
            let other = sky.light(&direction);
            (other.density - light.density).abs() < 1e-3 * light.density
                && (other.radiance - light.radiance).norm() < 1e-2 * light.radiance.norm()
        };
        let agreeing = points(4096).filter(|&uv| alike(uv)).count();
        assert!(agreeing > 4090, "{agreeing}: only samples at the border of a pixel may round into the next");
    }

    #[test]
    fn the_light_summed_by_samples_is_that_of_evenly_spread_directions() {
        let sky = sky(Size::new(48, 24), -2.0);
        let up = |direction: &Vector3<f32>| direction.z.max(0.0) * sky.light(direction).radiance.x;
        let by_samples = |uv| {
            let (direction, light) = sky.sample(uv);
            up(&direction) / light.density
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
            sky.background(&Vector3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0)).x
        };
        // Column 0 spans azimuths 0 to −90 degrees; its middle is at −45.
        for (column, azimuth) in [(0.0, -45.0), (1.0, -135.0), (2.0, 135.0), (3.0, 45.0)] {
            assert!((at(&sky(0.0), azimuth) - column).abs() < 1e-4);
            assert!((at(&sky(0.5), azimuth + 0.5_f32.to_degrees()) - column).abs() < 1e-4);
        }
    }

    #[test]
    fn large_maps_are_reduced_without_loss_of_light() {
        let value = |x: usize, y: usize| [if (x, y) == (700, 201) { 1e5 } else { (x + 3 * y) as f32 }; 3];
        let map = Arc::new(Grid::from_fn(Size::new(1000, 500), value));
        let sky = Sky::new(&Environment { map: map.clone(), rotation: 0.0, strength: 1.0 });
        assert_eq!(sky.light.size(), Size::new(256, 128));
        let rows = (0..500)
            .map(|y| map.row(y).iter().map(|light| light[0]).sum::<f32>() * row_height(map.size(), y));
        let mean = rows.sum::<f32>() / 2000.0;
        assert!((sky.mean_luminance() / mean - 1.0).abs() < 5e-3, "{} {mean}", sky.mean_luminance());
    }

    #[test]
    fn a_black_sky_can_be_sampled() {
        let map = Arc::new(Grid::filled(Size::new(8, 4), [0.0; 3]));
        let sky = Sky::new(&Environment { map, rotation: 0.0, strength: 1.0 });
        let (direction, light) = sky.sample([0.3, 0.8]);
        assert!(direction.norm() > 0.99 && light.density > 0.0);
        assert_eq!(sky.mean_luminance(), 0.0);
    }
}
