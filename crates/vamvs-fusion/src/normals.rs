//! Surface normals of a depth map.

#![allow(
    clippy::needless_range_loop,
    reason = "one lane of many arrays at a time, as the compiler turns into vectors"
)]

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use vamvs_core::Grid;

use crate::photometric::FilteredView;
use crate::sample::Sample;
use vamvs_core::widened;

/// Pixels to each side that a normal is fitted to.
const RADIUS: usize = 2;

/// Pixels in a window.
const WINDOW: f32 = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;

/// Pixels that are fitted at once.
const LANES: usize = 8;

/// A plane fitted around a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Fit {
    /// Slopes of the inverse depth along x and y, per pixel; `None` where too few pixels are on the surface.
    pub slopes: Option<[f32; 2]>,
    /// Whether all pixels around are on the pixel's surface.
    pub inner: bool,
}

/// The unit normals of all pixels that have a depth, in the camera's frame and towards the camera, with whether all
/// pixels around are on the same surface; 0 and false where there is no depth.
pub(crate) fn normals_in_cam(view: &FilteredView) -> Grid<(Vector3<f32>, bool)> {
    let size = view.size();
    let mut normals = Grid::filled(size, (Vector3::zeros(), false));
    let rows = normals.data_mut().par_chunks_mut(size.width.max(1)).enumerate();
    let rays = Rays::of(view);
    rows.for_each(|(y, row)| {
        for (x, (to, fit)) in row.iter_mut().zip(fits_of_row(view, y)).enumerate() {
            let w = view.inverse_depth((x, y));
            if w > 0.0 {
                *to = (Vector3::from(rays.direction((x, y), w, fit.slopes)).normalize(), fit.inner);
            }
        }
    });
    normals
}

/// Directions along the normals of a row's pixels in the world's frame, of any length, towards the camera.
pub(crate) fn directions_of_row(
    view: &FilteredView,
    y: usize,
    fits: &[Fit],
    world_from_cam: &Matrix3<f32>,
) -> Vec<[f32; 3]> {
    let mut directions = vec![[0.0; 3]; fits.len()];
    let row = Row { rays: Rays::of(view), y, samples: view.samples.row(y), world_from_cam };
    direct_row(&row, fits, &mut directions);
    directions
}

/// A row of a view.
struct Row<'a> {
    rays: Rays,
    y: usize,
    samples: &'a [Sample],
    world_from_cam: &'a Matrix3<f32>,
}

widened! {
    fn direct_row(row: &Row<'_>, fits: &[Fit], directions: &mut [[f32; 3]]) = direct_row_any;
}

#[inline(always)]
fn direct_row_any(row: &Row<'_>, fits: &[Fit], directions: &mut [[f32; 3]]) {
    let m = row.world_from_cam;
    for x in 0..directions.len() {
        let [a, b, c] = row.rays.direction((x, row.y), row.samples[x].inverse_depth(), fits[x].slopes);
        directions[x][0] = m[(0, 0)] * a + m[(0, 1)] * b + m[(0, 2)] * c;
        directions[x][1] = m[(1, 0)] * a + m[(1, 1)] * b + m[(1, 2)] * c;
        directions[x][2] = m[(2, 0)] * a + m[(2, 1)] * b + m[(2, 2)] * c;
    }
}

/// The rays of a view's pixels.
struct Rays {
    focal: [f32; 2],
    centre: [f32; 2],
}

impl Rays {
    fn of(view: &FilteredView) -> Self {
        let k = &view.camera.intrinsics;
        Self { focal: [k.fx as f32, k.fy as f32], centre: [k.cx as f32, k.cy as f32] }
    }

    /// A direction along the normal at a pixel with these slopes, in the camera's frame, towards the camera.
    ///
    /// On a plane the inverse depth is linear in the image, w = a·x + b·y + c, and the plane's normal is
    /// Kᵀ (a, b, c). The slopes a and b are fitted by least squares to the 5×5 pixels around, without
    /// those beyond an edge. Where too few are left, the normal is the direction to the camera.
    #[inline(always)]
    fn direction(&self, (x, y): (usize, usize), w: f32, slopes: Option<[f32; 2]>) -> [f32; 3] {
        let [fx, fy] = self.focal;
        let [u, v] = [x as f32 + 0.5 - self.centre[0], y as f32 + 0.5 - self.centre[1]];
        match slopes {
            Some([a, b]) => [-a * fx, -b * fy, a * u + b * v - w],
            None => [-u / fx, -v / fy, -1.0],
        }
    }
}

/// The planes around the pixels of a row.
pub(crate) fn fits_of_row(view: &FilteredView, y: usize) -> Vec<Fit> {
    let rows = padded_rows(view, y);
    let mut fits = vec![Fit::default(); view.size().width];
    fit_rows(&rows, view.edge_step, &mut fits);
    fits
}

/// The rows around row `y`, with zeros around the image so that all windows lie inside.
fn padded_rows(view: &FilteredView, y: usize) -> Vec<Vec<f32>> {
    let size = view.size();
    let padded = |j: usize| {
        let mut row = vec![0.0; size.width + 2 * RADIUS + LANES];
        if let Some(j) = j.checked_sub(RADIUS).filter(|&j| j < size.height) {
            row[RADIUS..]
                .iter_mut()
                .zip(view.samples.row(j))
                .for_each(|(to, sample)| *to = sample.inverse_depth());
        }
        row
    };
    (y..=y + 2 * RADIUS).map(padded).collect()
}

widened! {
    fn fit_rows(rows: &[Vec<f32>], edge_step: f32, fits: &mut [Fit]) = fit_rows_any;
}

// No closures from here on: they would not be compiled for the widest vectors.
#[inline(always)]
fn fit_rows_any(rows: &[Vec<f32>], edge_step: f32, fits: &mut [Fit]) {
    for (number, fits) in fits.chunks_mut(LANES).enumerate() {
        let moments = Moments::around(rows, number * LANES, edge_step);
        for (lane, fit) in fits.iter_mut().enumerate() {
            *fit = moments.fit(lane);
        }
    }
}

/// Sums over the windows of neighbouring pixels, one lane each, of those pixels on the surface of
/// the middle pixel, relative to it.
#[derive(Default)]
struct Moments {
    n: [f32; LANES],
    x: [f32; LANES],
    y: [f32; LANES],
    xx: [f32; LANES],
    xy: [f32; LANES],
    yy: [f32; LANES],
    w: [f32; LANES],
    xw: [f32; LANES],
    yw: [f32; LANES],
}

/// The same over one row of the windows.
#[derive(Default)]
struct RowSums {
    n: [f32; LANES],
    x: [f32; LANES],
    xx: [f32; LANES],
    w: [f32; LANES],
    xw: [f32; LANES],
}

impl RowSums {
    /// Adds a pixel of each window, `x` to the right of the middle one, or nothing where it is beyond an edge.
    #[inline(always)]
    fn add(&mut self, x: f32, values: &[f32], middle: &[f32; LANES], step: f32) {
        for lane in 0..LANES {
            let w = values[lane] - middle[lane];
            let same_surface = (values[lane] > 0.0) & (w.abs() <= step * middle[lane]);
            let (counts, w) = if same_surface { (1.0, w) } else { (0.0, 0.0) };
            self.n[lane] += counts;
            self.x[lane] += counts * x;
            self.xx[lane] += counts * (x * x);
            self.w[lane] += w;
            self.xw[lane] += w * x;
        }
    }
}

impl Moments {
    #[inline(always)]
    fn around(rows: &[Vec<f32>], first: usize, edge_step: f32) -> Self {
        let mut moments = Self::default();
        let mut middle = [0.0; LANES];
        middle.copy_from_slice(&rows[RADIUS][first + RADIUS..first + RADIUS + LANES]);
        for (j, row) in rows.iter().enumerate() {
            let row = &row[first..first + LANES + 2 * RADIUS];
            let y = j as f32 - RADIUS as f32;
            let mut sums = RowSums::default();
            for i in 0..=2 * RADIUS {
                let x = i as f32 - RADIUS as f32;
                sums.add(x, &row[i..i + LANES], &middle, x.abs().max(y.abs()) * edge_step);
            }
            moments.add(y, &sums);
        }
        moments
    }

    /// Adds a row of each window, `y` below the middle one.
    #[inline(always)]
    fn add(&mut self, y: f32, row: &RowSums) {
        for lane in 0..LANES {
            self.n[lane] += row.n[lane];
            self.x[lane] += row.x[lane];
            self.y[lane] += row.n[lane] * y;
            self.xx[lane] += row.xx[lane];
            self.xy[lane] += row.x[lane] * y;
            self.yy[lane] += row.n[lane] * (y * y);
            self.w[lane] += row.w[lane];
            self.xw[lane] += row.xw[lane];
            self.yw[lane] += row.w[lane] * y;
        }
    }

    /// The least-squares fit of a window; its slopes are `None` if the pixels lie on a line.
    #[inline(always)]
    fn fit(&self, lane: usize) -> Fit {
        let (n, x, y, w) = (self.n[lane], self.x[lane], self.y[lane], self.w[lane]);
        // About the mean, times the squared number of pixels.
        let (xx, yy) = (self.xx[lane] * n - x * x, self.yy[lane] * n - y * y);
        let xy = self.xy[lane] * n - x * y;
        let (xw, yw) = (self.xw[lane] * n - x * w, self.yw[lane] * n - y * w);
        // Of integers, hence exact: 0 if and only if the pixels lie on a line.
        let determinant = xx * yy - xy * xy;
        let solved = [(yy * xw - xy * yw) / determinant, (xx * yw - xy * xw) / determinant];
        let slopes = if determinant > 0.0 { Some(solved) } else { None };
        Fit { slopes, inner: n == WINDOW }
    }
}
