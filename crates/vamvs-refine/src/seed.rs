//! The seed as planes: depth completion of its holes, slopes from neighbouring pixels, and joint bilateral
//! upsampling.

use rayon::prelude::*;
use vamvs_core::depth_map::is_valid;
use vamvs_core::{DepthMap, Grid, Pinhole, Size};

use crate::luminance::Padded;
use crate::plane::Plane;

/// Radius of the window of upsampling, pixels of the seed.
const RADIUS: usize = 1;
const WINDOW: usize = (2 * RADIUS + 1) * (2 * RADIUS + 1);

/// Standard deviation of the spatial weight, pixels of the seed.
const DISTANCE: f32 = 0.8;

/// Difference of luminance at which a pixel of the seed has a quarter of its weight, grey values.
const COLOUR: f32 = 10.0;

/// A window shows more than one surface if its inverse depths differ by more than this share of the largest.
const JUMP: f32 = 0.02;

/// The inverse depths, all positive, between which the surface of a pixel is sought.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    farthest: f32,
    nearest: f32,
}

/// The seed upsampled to a pixel of the photograph.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Guess {
    /// The likeliest plane; w = 0 if the whole seed has no depth.
    pub plane: Plane,
    /// The inverse depths of the nearest and of the farthest surface in the seed's window.
    pub ends: [f32; 2],
    /// The seed's confidence; −1 where it has no depth.
    pub confidence: f32,
}

impl Bounds {
    /// Everywhere in front of the camera.
    pub const NONE: Self = Self { farthest: 0.0, nearest: f32::INFINITY };

    #[inline]
    pub fn contain(&self, w: f32) -> bool {
        w > 0.0 && w >= self.farthest && w <= self.nearest
    }
}

impl Guess {
    /// The plane where the seed itself has a depth; none (w = 0) where it was filled in.
    pub fn trusted(&self) -> Plane {
        if self.confidence >= 0.0 { self.plane } else { Plane::default() }
    }

    /// From the farthest to the nearest surface of the seed's window, and `beyond` (inverse depth) to both sides; everywhere
    /// where the seed was filled in.
    pub fn bounds(&self, beyond: f32) -> Bounds {
        let [nearest, farthest] = self.ends;
        if self.confidence < 0.0 {
            return Bounds::NONE;
        }
        Bounds { farthest: farthest - beyond, nearest: nearest + beyond }
    }
}

/// A seed with its holes filled.
pub(crate) struct Seed {
    planes: Grid<Plane>,
    confidence: Grid<f32>,
    camera: Pinhole,
}

impl Seed {
    pub fn new(map: &DepthMap) -> Self {
        let mut w = map.depth.map(|&depth| if is_valid(depth) { 1.0 / depth } else { 0.0 });
        let mut confidence = map.confidence.clone();
        for (confidence, w) in confidence.data_mut().iter_mut().zip(w.data()) {
            *confidence = if *w > 0.0 { *confidence } else { -1.0 };
        }
        fill(&mut w);
        let planes = Grid::from_fn(w.size(), |x, y| Plane {
            w: w[(x, y)],
            gx: slope(x.checked_sub(1).map(|x| w[(x, y)]), w[(x, y)], w.get(x + 1, y).copied()),
            gy: slope(y.checked_sub(1).map(|y| w[(x, y)]), w[(x, y)], w.get(x, y + 1).copied()),
        });
        Self { planes, confidence, camera: map.camera }
    }

    /// The guess for each pixel of a photograph; `camera` must have the photograph's size.
    pub fn guesses(&self, image: &Padded, camera: &Pinhole) -> Grid<Guess> {
        let view = Mapping::new(camera, &self.camera);
        let guide = self.guide(image, &view);
        let mut guesses = Grid::filled(image.size, Guess::default());
        let width = image.size.width.max(1);
        guesses.data_mut().par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
            for (x, guess) in row.iter_mut().enumerate() {
                *guess = self.guess(image.at(x, y), &guide, &view, view.to_seed(x, y));
            }
        });
        guesses
    }

    /// The photograph's luminance at the seed's size: the mean over the pixels under each pixel of the seed.
    fn guide(&self, image: &Padded, view: &Mapping) -> Grid<f32> {
        let reach = |ratio: f32, at: usize, first: f32, count: usize| {
            let begin = ((at as f32 - first) / ratio).max(0.0) as usize;
            let end = ((at as f32 + 1.0 - first) / ratio).ceil().max(0.0) as usize;
            let begin = begin.min(count - 1);
            begin..end.clamp(begin + 1, count.max(begin + 1))
        };
        Grid::from_fn(self.planes.size(), |x, y| {
            let columns = reach(view.ratio[0], x, view.origin[0], image.size.width);
            let rows = reach(view.ratio[1], y, view.origin[1], image.size.height);
            let count = (columns.len() * rows.len()) as f32;
            rows.flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| image.at(x, y)).sum::<f32>()
                / count
        })
    }

    fn guess(&self, grey: f32, guide: &Grid<f32>, view: &Mapping, [sx, sy]: [f32; 2]) -> Guess {
        let Size { width, height } = self.planes.size();
        let inside = |at: f32, count: usize| (at.max(0.0) as usize).min(count - 1);
        let (cx, cy) = (inside(sx, width), inside(sy, height));
        let own = self.planes[(cx, cy)];
        if own.w <= 0.0 {
            return Guess::default();
        }
        let mut near = Near { values: [(Plane::default(), 0.0); WINDOW], count: 0 };
        for y in cy.saturating_sub(RADIUS)..(cy + RADIUS + 1).min(height) {
            for x in cx.saturating_sub(RADIUS)..(cx + RADIUS + 1).min(width) {
                let (dx, dy) = (sx - x as f32 - 0.5, sy - y as f32 - 0.5);
                let nearness = (-0.5 * (dx * dx + dy * dy) / (DISTANCE * DISTANCE)).exp();
                let difference = (guide[(x, y)] - grey) / COLOUR;
                let likeness = 1.0 / (1.0 + difference * difference);
                near.add(self.planes[(x, y)].seen_from(dx, dy), nearness, likeness * likeness);
            }
        }
        let (plane, ends) = near.plane();
        let scaled = Plane { gx: plane.gx * view.ratio[0], gy: plane.gy * view.ratio[1], ..plane };
        Guess { plane: scaled, ends, confidence: self.confidence[(cx, cy)] }
    }
}

/// The planes in the window around a pixel, extended to it, with their weights.
struct Near {
    values: [(Plane, f32); WINDOW],
    count: usize,
}

impl Near {
    fn add(&mut self, plane: Plane, nearness: f32, likeness: f32) {
        self.values[self.count] = (plane, nearness * (likeness + 1e-6));
        self.count += 1;
    }

    /// The likeliest plane, and the inverse depths of the nearest and the farthest surface. On one surface, the
    /// likeliest plane is the weighted mean; across several, it is the weighted median by inverse depth.
    fn plane(mut self) -> (Plane, [f32; 2]) {
        let values = &mut self.values[..self.count];
        values.sort_unstable_by(|a, b| a.0.w.total_cmp(&b.0.w));
        let ends = [values[values.len() - 1].0.w, values[0].0.w];
        let total: f32 = values.iter().map(|(_, weight)| weight).sum();
        if ends[0] - ends[1] < JUMP * ends[0] {
            return (mean(values, total), ends);
        }
        let mut sum = 0.0;
        let middle = values.iter().find(|(_, weight)| {
            sum += weight;
            sum >= 0.5 * total
        });
        (middle.unwrap_or(&values[0]).0, ends)
    }
}

fn mean(values: &[(Plane, f32)], total: f32) -> Plane {
    let mean = |part: fn(&Plane) -> f32| {
        values.iter().map(|(plane, weight)| part(plane) * weight).sum::<f32>() / total
    };
    Plane { w: mean(|plane| plane.w), gx: mean(|plane| plane.gx), gy: mean(|plane| plane.gy) }
}

/// The change of inverse depth per pixel: the smaller of the differences to both sides; 0 if their signs differ,
/// and at the border.
fn slope(before: Option<f32>, own: f32, after: Option<f32>) -> f32 {
    let (back, forth) = (before.map(|before| own - before), after.map(|after| after - own));
    match (back, forth) {
        (Some(a), Some(b)) if a * b <= 0.0 => 0.0,
        (Some(a), Some(b)) => {
            if a.abs() < b.abs() {
                a
            } else {
                b
            }
        }
        _ => 0.0,
    }
}

/// Gives each pixel without depth the inverse depth of a nearest pixel that has one (city-block distance), in a
/// forward and a backward pass over the image.
fn fill(w: &mut Grid<f32>) {
    let Size { width, height } = w.size();
    let mut distance = w.map(|&w| if w > 0.0 { 0_u32 } else { u32::MAX });
    let mut take = |to: (usize, usize), from: Option<(usize, usize)>| {
        let Some(from) = from else { return };
        let way = distance[from].saturating_add(1);
        if way < distance[to] {
            distance[to] = way;
            w[to] = w[from];
        }
    };
    for y in 0..height {
        for x in 0..width {
            take((x, y), x.checked_sub(1).map(|x| (x, y)));
            take((x, y), y.checked_sub(1).map(|y| (x, y)));
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            take((x, y), (x + 1 < width).then_some((x + 1, y)));
            take((x, y), (y + 1 < height).then_some((x, y + 1)));
        }
    }
}

/// The map from image coordinates of the photograph to those of the seed.
pub(crate) struct Mapping {
    /// Pixels of the seed per pixel of the photograph.
    ratio: [f32; 2],
    /// The position of the photograph's upper left corner in the seed, pixels.
    origin: [f32; 2],
}

impl Mapping {
    pub fn new(from: &Pinhole, to: &Pinhole) -> Self {
        let (a, b) = (&from.intrinsics, &to.intrinsics);
        let (x, y) = (b.fx / a.fx, b.fy / a.fy);
        Self { ratio: [x as f32, y as f32], origin: [(b.cx - a.cx * x) as f32, (b.cy - a.cy * y) as f32] }
    }

    /// The seed's coordinates of the centre of pixel `(x, y)`.
    pub fn to_seed(&self, x: usize, y: usize) -> [f32; 2] {
        let [rx, ry] = self.ratio;
        [(x as f32 + 0.5) * rx + self.origin[0], (y as f32 + 0.5) * ry + self.origin[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_is_sought_between_those_of_the_seed_and_a_little_beyond() {
        let seen = Guess { ends: [0.5, 0.2], confidence: 0.3, ..Guess::default() };
        let bounds = seen.bounds(0.05);
        assert!([0.16, 0.2, 0.4, 0.5, 0.54].iter().all(|&w| bounds.contain(w)));
        assert!([0.14, 0.56].iter().all(|&w| !bounds.contain(w)));
        let filled = Guess { confidence: -1.0, ..seen }.bounds(0.05);
        assert!(filled.contain(1e-6) && filled.contain(1e6));
        assert!(!filled.contain(0.0) && !seen.bounds(0.3).contain(-0.01), "behind the camera");
    }
}
