//! Smooths planes by averaging over neighbours on the same surface.

use rayon::prelude::*;
use vamvs_core::Grid;

use crate::field::Field;
use crate::isa::{Isa, for_each_isa};
use crate::plane::Plane;

/// Radius of the window, pixels.
const RADIUS: usize = 4;

/// Difference in disparity at which a neighbour has a quarter of its weight, pixels.
const SAME: f32 = 0.3;

/// Replaces each plane by the weighted mean of the planes around it, extended to its pixel. The weight falls with the
/// difference in inverse depth there, so that depth edges stay sharp. `steps` holds, for each pixel, the change of
/// inverse depth that is one pixel of disparity.
pub(crate) fn smooth(field: &mut Field, steps: &Grid<f32>, isa: Isa) {
    let planes = Planes::of(field);
    let width = field.size().width;
    field.update_rows(
        || (Sums::new(width), vec![0.0; width]),
        |(sums, scale), y, row| {
            for (scale, step) in scale.iter_mut().zip(steps.row(y)) {
                *scale = 1.0 / (SAME * step);
            }
            planes.add_up(y, scale, sums, isa);
            let own = &planes.row(y + RADIUS, RADIUS, width)[0];
            for x in 0..width {
                if own[x] > 0.0 {
                    row.at_mut(x).plane = sums.mean(x, own[x]);
                }
            }
        },
    );
}

/// The planes of a field, one array per parameter, with a border of pixels without planes.
struct Planes {
    stride: usize,
    /// `w`, `gx` and `gy` of [`Plane`].
    numbers: [Vec<f32>; 3],
}

/// Weighted sums for the pixels of a row.
struct Sums {
    /// The sums of `w` minus the pixel's own, of `gx` and of `gy`.
    numbers: [Vec<f32>; 3],
    weights: Vec<f32>,
}

impl Planes {
    fn of(field: &Field) -> Self {
        let size = field.size();
        let stride = size.width + 2 * RADIUS;
        let number = |of: fn(&Plane) -> f32| {
            let mut numbers = vec![0.0; stride * (size.height + 2 * RADIUS)];
            let rows = numbers.par_chunks_exact_mut(stride).skip(RADIUS).take(size.height).enumerate();
            rows.for_each(|(y, row)| {
                for x in 0..size.width {
                    row[RADIUS + x] = of(&field.at(x, y).plane);
                }
            });
            numbers
        };
        Self {
            stride,
            numbers: [number(|plane| plane.w), number(|plane| plane.gx), number(|plane| plane.gy)],
        }
    }

    /// `width` pixels of row `y`, from column `x` on; rows and columns include the border.
    fn row(&self, y: usize, x: usize, width: usize) -> [&[f32]; 3] {
        self.numbers.each_ref().map(|numbers| &numbers[y * self.stride + x..][..width])
    }

    /// The sums over all neighbours for the pixels of row `y` of the image.
    fn add_up(&self, y: usize, scale: &[f32], sums: &mut Sums, isa: Isa) {
        let width = scale.len();
        let own = self.row(y + RADIUS, RADIUS, width)[0];
        sums.clear();
        for down in 0..=2 * RADIUS {
            for right in 0..=2 * RADIUS {
                let offset = [RADIUS as f32 - right as f32, RADIUS as f32 - down as f32];
                add(sums, own, scale, self.row(y + down, right, width), offset, isa);
            }
        }
    }
}

impl Sums {
    fn new(width: usize) -> Self {
        let zeros = || vec![0.0; width];
        Self { numbers: [zeros(), zeros(), zeros()], weights: zeros() }
    }

    fn clear(&mut self) {
        self.numbers.iter_mut().for_each(|numbers| numbers.fill(0.0));
        self.weights.fill(0.0);
    }

    /// The mean plane at `x`, whose own inverse depth is `w`. The pixel's own plane has weight 1, so the mean exists.
    fn mean(&self, x: usize, w: f32) -> Plane {
        let [change, gx, gy] = self.numbers.each_ref().map(|numbers| numbers[x] / self.weights[x]);
        Plane { w: w + change, gx, gy }
    }
}

for_each_isa! {
    /// Adds the neighbours at one offset of all pixels of a row.
    fn add(sums: &mut Sums, own: &[f32], scale: &[f32], planes: [&[f32]; 3], offset: [f32; 2]) -> () = add_row
}

#[inline(always)]
fn add_row<const N: usize>(
    sums: &mut Sums,
    own: &[f32],
    scale: &[f32],
    planes: [&[f32]; 3],
    [dx, dy]: [f32; 2],
) {
    let count = own.len();
    let (scale, [w, gx, gy]) = (&scale[..count], planes.map(|numbers| &numbers[..count]));
    let [ws, gxs, gys] = sums.numbers.each_mut().map(|numbers| &mut numbers[..count]);
    let weights = &mut sums.weights[..count];
    for x in 0..count {
        let change = w[x] + gx[x] * dx + gy[x] * dy - own[x];
        let difference = change * scale[x];
        let likeness = 1.0 / (1.0 + difference * difference);
        let weight = if w[x] > 0.0 { likeness * likeness } else { 0.0 };
        ws[x] += weight * change;
        gxs[x] += weight * gx[x];
        gys[x] += weight * gy[x];
        weights[x] += weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::State;
    use vamvs_core::Size;

    /// Two planes that do not intersect, with noise of up to 2e-3, and a hole.
    fn field() -> Field {
        Field::new(Size::new(37, 21), |x, y| {
            let noise = ((x * 7 + y * 13) % 5) as f32 - 2.0;
            let left = Plane { w: 1.0 + 0.01 * x as f32 + 0.001 * noise, gx: 0.01, gy: 0.0 };
            let right = Plane { w: 3.0 + 0.02 * y as f32 + 0.001 * noise, gx: 0.0, gy: 0.02 };
            let plane = if x < 18 { left } else { right };
            State::unjudged(if (x, y) == (10, 10) { Plane::default() } else { plane })
        })
    }

    #[test]
    fn noise_goes_edges_stay_and_holes_stay_holes() {
        let mut smoothed = field();
        let steps = Grid::filled(smoothed.size(), 0.01);
        smooth(&mut smoothed, &steps, Isa::Scalar);
        assert_eq!(smoothed.at(10, 10).plane, Plane::default());
        for (x, y) in [(0, 0), (5, 10), (17, 2), (11, 11)] {
            assert!((smoothed.at(x, y).plane.w - 1.0 - 0.01 * x as f32).abs() < 1e-3, "{x} {y}");
        }
        for (x, y) in [(18, 8), (30, 20), (35, 0)] {
            assert!((smoothed.at(x, y).plane.w - 3.0 - 0.02 * y as f32).abs() < 1e-3, "{x} {y}");
        }
    }

    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let of = |isa| {
            let mut field = field();
            let steps = Grid::filled(field.size(), 0.01);
            smooth(&mut field, &steps, isa);
            Grid::from_fn(field.size(), |x, y| field.at(x, y).plane)
        };
        let scalar = of(Isa::Scalar);
        for isa in Isa::all() {
            assert_eq!(of(isa), scalar, "{isa:?}");
        }
    }
}
