//! Depth completion: fills textureless surfaces between confident depths.
//!
//! Where there is no texture to match, depth must come from the surroundings. The inverse depth of a plane is
//! linear in pixel coordinates, so textureless regions are filled with the smoothest inverse depths between
//! confident ones. This is a least-squares problem. Its data term is weighted by confidence; its smoothness term,
//! on second differences, is weighted by similarity of colour and is reweighted in several rounds by a robust
//! function of the second differences themselves, so that depth discontinuities stay.

use serde::{Deserialize, Serialize};

use vamvs_core::{Grid, Rgb, Size};

/// The parameters of depth completion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Completion {
    /// Weight of the smoothness term relative to the data term of a value with confidence 1.
    pub stiffness: f32,
    /// The data term of a value is weighted by its confidence to this power.
    pub power: f32,
}

/// Standard deviation of colours on one surface, grey values.
const COLOUR: f32 = 10.0;
/// Lower bound of the colour weight of a second difference, reached at edges of the photograph.
const ACROSS: f32 = 1e-3;
/// Scale of the robust function: second differences much larger than this count as discontinuities. In the unit of
/// the values, at full resolution; doubled for each halving.
const BEND: f32 = 0.5;
/// Rounds of reweighting, and the most conjugate-gradient steps in each.
const ROUNDS: usize = 4;
const STEPS: usize = 60;
/// Added to the data weight of every value, so that the solution is unique.
const LEAST: f32 = 1e-5;
/// Maps with a shorter side than this are solved without a coarser level.
const SMALLEST: usize = 16;

/// The smoothest map that follows `values` where `confidence`, in [0, 1], is high. All three maps have the same size;
/// values are plane coordinates, so their unit is one plane distance.
#[must_use]
pub fn complete(values: &Grid<f32>, confidence: &Grid<f32>, image: &Grid<Rgb>, how: Completion) -> Grid<f32> {
    let weight = confidence.map(|confidence| confidence.clamp(0.0, 1.0).powf(how.power));
    solve(values, &weight, image, how.stiffness, BEND)
}

/// Solves from coarse to fine, so that large textureless regions are filled in a few steps.
fn solve(values: &Grid<f32>, weight: &Grid<f32>, image: &Grid<Rgb>, stiffness: f32, bend: f32) -> Grid<f32> {
    let size = values.size();
    let mut x = if size.width.min(size.height) >= SMALLEST {
        let (values, weight) = (halved(values, Some(weight)), halved(weight, None));
        doubled(&solve(&values, &weight, &halved_image(image), stiffness, 2.0 * bend), size)
    } else {
        values.clone()
    };
    for ((x, value), weight) in x.data_mut().iter_mut().zip(values.data()).zip(weight.data()) {
        *x += weight * (value - *x);
    }
    let mut x = x.into_vec();
    let colours = Bends::of(size, |places| likeness(image, places));
    for _ in 0..ROUNDS {
        let bends = colours.reweighted(size.width, &x, bend);
        System { width: size.width, weight: weight.data(), bends, stiffness }.solve(
            values.data(),
            &mut x,
            STEPS,
        );
    }
    Grid::from_vec(size, x)
}

/// The means of 2×2 blocks, weighted if there are weights.
fn halved(grid: &Grid<f32>, weight: Option<&Grid<f32>>) -> Grid<f32> {
    let size = Size::new(grid.width().div_ceil(2), grid.height().div_ceil(2));
    Grid::from_fn(size, |x, y| {
        let (mut sum, mut total) = (0.0, 0.0);
        for ny in 2 * y..(2 * y + 2).min(grid.height()) {
            for nx in 2 * x..(2 * x + 2).min(grid.width()) {
                let w = weight.map_or(1.0, |weight| weight[(nx, ny)] + LEAST);
                sum += w * grid[(nx, ny)];
                total += w;
            }
        }
        sum / total
    })
}

fn halved_image(image: &Grid<Rgb>) -> Grid<Rgb> {
    let channels: [Grid<f32>; 3] = std::array::from_fn(|c| halved(&image.map(|rgb| f32::from(rgb[c])), None));
    Grid::from_fn(channels[0].size(), |x, y| std::array::from_fn(|c| channels[c][(x, y)].round() as u8))
}

/// Upsamples bilinearly by two, to `size`.
fn doubled(small: &Grid<f32>, size: Size) -> Grid<f32> {
    let axis = |c: usize, side: usize| {
        let at = ((c as f32 + 0.5) * 0.5 - 0.5).clamp(0.0, (side - 1) as f32);
        (at as usize, (at as usize + 1).min(side - 1), at.fract())
    };
    Grid::from_fn(size, |x, y| {
        let ((x0, x1, fx), (y0, y1, fy)) = (axis(x, small.width()), axis(y, small.height()));
        let row = |y: usize| small[(x0, y)] * (1.0 - fx) + small[(x1, y)] * fx;
        row(y0) * (1.0 - fy) + row(y1) * fy
    })
}

/// How alike the colours along a path of neighbouring pixels are, from `ACROSS` to 1.
fn likeness(image: &Grid<Rgb>, places: &[(usize, usize)]) -> f32 {
    let difference = |pair: &[(usize, usize)]| -> f32 {
        let [a, b] = [image[pair[0]], image[pair[1]]];
        (0..3).map(|c| (f32::from(a[c]) - f32::from(b[c])).powi(2)).sum()
    };
    let largest = places.windows(2).map(difference).fold(0.0, f32::max);
    (-0.5 * largest / (COLOUR * COLOUR)).exp().max(ACROSS)
}

/// The weights of the second differences at each pixel: along its row and column, centred on it, and the mixed one of
/// the 2×2 block to its right and below.
struct Bends {
    x: Vec<f32>,
    y: Vec<f32>,
    xy: Vec<f32>,
}

impl Bends {
    fn of(size: Size, weight: impl Fn(&[(usize, usize)]) -> f32) -> Self {
        let grid = |inside: &dyn Fn(usize, usize) -> bool, at: &dyn Fn(usize, usize) -> f32| {
            Grid::from_fn(size, |x, y| if inside(x, y) { at(x, y) } else { 0.0 }).into_vec()
        };
        let Size { width, height } = size;
        Self {
            x: grid(&|x, _| x > 0 && x + 1 < width, &|x, y| weight(&[(x - 1, y), (x, y), (x + 1, y)])),
            y: grid(&|_, y| y > 0 && y + 1 < height, &|x, y| weight(&[(x, y - 1), (x, y), (x, y + 1)])),
            xy: grid(&|x, y| x + 1 < width && y + 1 < height, &|x, y| {
                weight(&[(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)])
            }),
        }
    }

    /// The weights times those of iteratively reweighted least squares for the Geman–McClure function.
    fn reweighted(&self, width: usize, values: &[f32], bend: f32) -> Self {
        let map = |weights: &[f32], second: &dyn Fn(usize) -> f32| {
            let robust = |(i, &weight): (usize, &f32)| match weight {
                0.0 => 0.0,
                _ => weight / (1.0 + (second(i) / bend).powi(2)).powi(2),
            };
            weights.iter().enumerate().map(robust).collect()
        };
        Self {
            x: map(&self.x, &|i| along(values, i, 1)),
            y: map(&self.y, &|i| along(values, i, width)),
            xy: map(&self.xy, &|i| twist(values, i, width)),
        }
    }
}

/// The second difference along an axis.
fn along(v: &[f32], i: usize, step: usize) -> f32 {
    v[i - step] - 2.0 * v[i] + v[i + step]
}

/// The mixed second difference.
fn twist(v: &[f32], i: usize, width: usize) -> f32 {
    v[i] - v[i + 1] - v[i + width] + v[i + width + 1]
}

/// The normal equations (W + k Σ w bᵀ b) x = W d, for data weights W, stiffness k, and second differences b with
/// weights w.
struct System<'a> {
    width: usize,
    weight: &'a [f32],
    bends: Bends,
    stiffness: f32,
}

impl System<'_> {
    fn apply(&self, v: &[f32], out: &mut [f32]) {
        let (w, k) = (self.width, self.stiffness);
        for ((out, v), weight) in out.iter_mut().zip(v).zip(self.weight) {
            *out = (weight + LEAST) * v;
        }
        for i in 0..v.len() {
            for (weight, step) in [(self.bends.x[i], 1), (self.bends.y[i], w)] {
                if weight > 0.0 {
                    let second = k * weight * along(v, i, step);
                    out[i - step] += second;
                    out[i] -= 2.0 * second;
                    out[i + step] += second;
                }
            }
            let weight = self.bends.xy[i];
            if weight > 0.0 {
                // Twice, because the thin-plate energy has the mixed derivative in both orders.
                let second = 2.0 * k * weight * twist(v, i, w);
                out[i] += second;
                out[i + 1] -= second;
                out[i + w] -= second;
                out[i + w + 1] += second;
            }
        }
    }

    fn diagonal(&self) -> Vec<f32> {
        let (w, k) = (self.width, self.stiffness);
        let mut diagonal: Vec<f32> = self.weight.iter().map(|weight| weight + LEAST).collect();
        for i in 0..diagonal.len() {
            for (weight, step) in [(self.bends.x[i], 1), (self.bends.y[i], w)] {
                if weight > 0.0 {
                    diagonal[i - step] += k * weight;
                    diagonal[i] += 4.0 * k * weight;
                    diagonal[i + step] += k * weight;
                }
            }
            let weight = self.bends.xy[i];
            if weight > 0.0 {
                for j in [i, i + 1, i + w, i + w + 1] {
                    diagonal[j] += 2.0 * k * weight;
                }
            }
        }
        diagonal
    }

    /// Conjugate gradients with diagonal preconditioner, starting from `x`.
    fn solve(&self, data: &[f32], x: &mut [f32], steps: usize) {
        let diagonal = self.diagonal();
        let mut product = vec![0.0; x.len()];
        self.apply(x, &mut product);
        let right = data.iter().zip(self.weight).map(|(data, weight)| (weight + LEAST) * data);
        let mut r: Vec<f32> = right.zip(&product).map(|(right, product)| right - product).collect();
        let mut p: Vec<f32> = r.iter().zip(&diagonal).map(|(r, d)| r / d).collect();
        let mut z = p.clone();
        let mut error = dot(&r, &z);
        let goal = error * 1e-10;
        for _ in 0..steps {
            if error <= goal {
                break;
            }
            self.apply(&p, &mut product);
            let step = (error / dot(&p, &product)) as f32;
            for i in 0..x.len() {
                x[i] += step * p[i];
                r[i] -= step * product[i];
                z[i] = r[i] / diagonal[i];
            }
            let next = dot(&r, &z);
            let beta = (next / error) as f32;
            error = next;
            for (p, z) in p.iter_mut().zip(&z) {
                *p = z + beta * *p;
            }
        }
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    const HOW: Completion = Completion { stiffness: 20.0, power: 4.0 };

    /// Noise that no smooth surface follows, in [-10, 10].
    fn noise(x: usize, y: usize) -> f32 {
        (((x * 37 + y * 91) % 53) as f32 / 26.5 - 1.0) * 10.0
    }

    #[test]
    fn a_textureless_wall_between_trusted_borders_is_the_plane_between_them() {
        let size = Size::new(48, 36);
        let plane = |x: usize, y: usize| 5.0 + 0.4 * x as f32 - 0.2 * y as f32;
        let trusted = |x: usize, y: usize| !(6..42).contains(&x) || !(6..30).contains(&y);
        let values = Grid::from_fn(size, |x, y| plane(x, y) + if trusted(x, y) { 0.0 } else { noise(x, y) });
        let confidence = Grid::from_fn(size, |x, y| if trusted(x, y) { 1.0 } else { 0.1 });
        let filled = complete(&values, &confidence, &Grid::filled(size, [200; 3]), HOW);
        for y in 0..size.height {
            for x in 0..size.width {
                let error = (filled[(x, y)] - plane(x, y)).abs();
                assert!(error < 0.1, "{error} off at {x}, {y}");
            }
        }
    }

    #[test]
    fn two_surfaces_of_two_colours_stay_apart() {
        let size = Size::new(40, 24);
        let step = |x: usize| if x < 20 { 3.0_f32 } else { 30.0 };
        let unsure = |x: usize| (8..14).contains(&x) || (24..32).contains(&x);
        let values = Grid::from_fn(size, |x, y| if unsure(x) { step(x) + noise(x, y) } else { step(x) });
        let confidence = Grid::from_fn(size, |x, _| if unsure(x) { 0.1 } else { 0.9 });
        let image = Grid::from_fn(size, |x, _| if x < 20 { [30; 3] } else { [220; 3] });
        let filled = complete(&values, &confidence, &image, HOW);
        for y in 0..size.height {
            for x in 0..size.width {
                assert!((filled[(x, y)] - step(x)).abs() < 0.2, "{} at {x}, {y}", filled[(x, y)]);
            }
        }
    }

    #[test]
    fn conjugate_gradients_solve_the_normal_equations() {
        let size = Size::new(6, 5);
        let count = size.area();
        let weight: Vec<f32> = (0..count).map(|i| 0.1 + (i * 7 % 10) as f32 / 10.0).collect();
        let data: Vec<f32> = (0..count).map(|i| noise(i % 6, i / 6)).collect();
        let bends = Bends::of(size, |places| 0.2 + (places[0].0 + 2 * places[0].1) as f32 / 10.0);
        let system = System { width: size.width, weight: &weight, bends, stiffness: 0.7 };
        let mut matrix = DMatrix::<f64>::zeros(count, count);
        for i in 0..count {
            let (mut unit, mut column) = (vec![0.0; count], vec![0.0; count]);
            unit[i] = 1.0;
            system.apply(&unit, &mut column);
            matrix.set_column(i, &DVector::from_iterator(count, column.iter().map(|v| f64::from(*v))));
        }
        assert!((&matrix - matrix.transpose()).amax() < 1e-6, "the equations are symmetric");
        let diagonal = system.diagonal();
        assert!((0..count).all(|i| (matrix[(i, i)] - f64::from(diagonal[i])).abs() < 1e-5));
        let right = DVector::from_fn(count, |i, _| f64::from((weight[i] + LEAST) * data[i]));
        let exact = matrix.lu().solve(&right).unwrap();
        let mut x = vec![0.0; count];
        system.solve(&data, &mut x, 200);
        for i in 0..count {
            assert!((f64::from(x[i]) - exact[i]).abs() < 1e-3, "{} is not {}", x[i], exact[i]);
        }
    }
}
