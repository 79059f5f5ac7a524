//! Procedural textures. All of them tile without a seam.

use rand::RngExt;
use rand_pcg::Pcg64;
use vamvs_core::{Grid, Rgb, Size};

use crate::noise::{Octaves, grid_value, lerp, plane, smooth};
use crate::pixel::fill;

/// The fine grain over every motif.
const GRAIN: Octaves = Octaves { count: 2, gain: 1.0 };

/// The figure of wood.
const FIGURE: Octaves = Octaves { count: 3, gain: 0.4 };

/// What a pattern shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motif {
    /// Almost textureless: one colour, faintly uneven.
    Plain,
    /// Clouds of many scales.
    Clouds,
    /// Grains of several sizes, as in stone.
    Speckles,
    /// Winding veins.
    Marble,
    /// Boards with grain.
    Wood,
    /// Bricks in mortar, every second row shifted by half a brick.
    Bricks,
    /// Square tiles of different shades.
    Tiles,
    /// Stripes of random widths.
    Stripes,
    /// Woven threads.
    Weave,
    /// Lines of signs that resemble text.
    Glyphs,
    /// Discs of random size.
    Discs,
}

impl Motif {
    /// All motifs.
    pub const ALL: [Self; 11] = [
        Self::Plain,
        Self::Clouds,
        Self::Speckles,
        Self::Marble,
        Self::Wood,
        Self::Bricks,
        Self::Tiles,
        Self::Stripes,
        Self::Weave,
        Self::Glyphs,
        Self::Discs,
    ];
}

/// A motif with its colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// What the pattern shows.
    pub motif: Motif,
    /// Scale: bricks, tiles, pairs of stripes or discs across the picture. Other motifs use a multiple of it;
    /// plain ones, clouds and marble ignore it.
    pub count: u16,
    /// Colours of the motif's low, middle and high values, sRGB, 0 to 255.
    pub colours: [[f32; 3]; 3],
    /// Strength of the fine grain over the motif, 0 to 1.
    pub grain: f32,
    /// Seed of all random numbers in the picture.
    pub seed: u32,
}

impl Pattern {
    /// A pattern with random colours, counts and grain.
    #[must_use]
    pub fn random(motif: Motif, rng: &mut Pcg64) -> Self {
        let plain = motif == Motif::Plain;
        let mut colours = random_colours(rng);
        if plain {
            colours = [colours[rng.random_range(0..3)]; 3];
        }
        let grain = if plain { rng.random_range(0.0..0.05) } else { rng.random_range(0.04..0.35) };
        Self { motif, count: rng.random_range(4..=14), colours, grain, seed: rng.random() }
    }

    /// The picture, `side` × `side` pixels, sRGB-encoded.
    #[must_use]
    pub fn draw(&self, side: usize) -> Grid<Rgb> {
        let centre = |i: usize| (i as f32 + 0.5) / side as f32;
        fill(Size::new(side, side), |x, y| self.colour(centre(x), centre(y)))
    }

    fn colour(&self, u: f32, v: f32) -> Rgb {
        let level = 2.0 * self.level(u, v).clamp(0.0, 1.0);
        let [low, middle, high] = self.colours;
        let (from, to) = if level < 1.0 { (low, middle) } else { (middle, high) };
        let grain = 1.0 + self.grain * GRAIN.plane([96.0 * u, 96.0 * v], [96; 2], self.seed ^ 0xA5);
        [0, 1, 2].map(|i| (lerp(from[i], to[i], level.fract()) * grain).clamp(0.0, 255.0) as u8)
    }

    /// The motif's value in [0, 1] at a point of the unit square.
    fn level(&self, u: f32, v: f32) -> f32 {
        let n = f32::from(self.count);
        match self.motif {
            Motif::Plain => 0.5,
            Motif::Clouds => 0.5 + 0.9 * self.clouds([u, v], 4, 7, 0.7),
            Motif::Speckles => self.speckles(u, v),
            Motif::Marble => self.marble(u, v),
            Motif::Wood => self.wood(u, v),
            Motif::Bricks => self.bricks(u * n, v * n * 2.0),
            Motif::Tiles => self.tiles(u * n, v * n),
            Motif::Stripes => self.stripes(u * n),
            Motif::Weave => self.weave(u * n * 8.0, v * n * 8.0),
            Motif::Glyphs => self.glyphs(u * n * 3.0, v * n * 2.0),
            Motif::Discs => self.discs(u, v),
        }
    }

    fn clouds(&self, [u, v]: [f32; 2], period: i32, count: u32, gain: f32) -> f32 {
        Octaves { count, gain }.plane([u, v].map(|c| c * period as f32), [period; 2], self.seed)
    }

    /// The random number in [0, 1) of the grid cell that contains the point `cell`; the grid repeats after
    /// `columns` and `rows`. Each `purpose` has its own numbers.
    fn shade(&self, cell: [f32; 2], [columns, rows]: [i32; 2], purpose: i32) -> f32 {
        let [x, y] = [cell[0].floor() as i32, cell[1].floor() as i32];
        grid_value([x.rem_euclid(columns), y.rem_euclid(rows), purpose], self.seed)
    }

    fn count(&self) -> i32 {
        i32::from(self.count)
    }

    fn speckles(&self, u: f32, v: f32) -> f32 {
        let at = |period: i32, seed| plane([u, v].map(|c| c * period as f32), [period; 2], self.seed ^ seed);
        let [coarse, fine] = [at(8 * self.count(), 1), at(20 * self.count(), 2)];
        0.5 + 0.35 * smooth(2.0 * coarse) - 0.35 * smooth(2.0 * fine - 0.3)
            + 0.15 * self.clouds([u, v], 4, 3, 0.6)
    }

    fn marble(&self, u: f32, v: f32) -> f32 {
        let bend = 1.8 * self.clouds([u, v], 3, 6, 0.5);
        let ridge = (std::f32::consts::TAU * (u + 2.0 * v + bend)).sin().abs();
        0.25 * ridge + 0.75 * ridge.sqrt()
    }

    fn wood(&self, u: f32, v: f32) -> f32 {
        let boards = self.count().div_euclid(2).max(2);
        let board = v * boards as f32;
        let shade = self.shade([0.0, board], [1, boards], 1);
        let periods = [3, 3 * boards];
        let wavy = FIGURE.plane([u * 3.0, v * periods[1] as f32], periods, self.seed);
        let rings = (8.0 * wavy + 9.0 * shade).sin();
        let fibre = plane([u * 16.0, v * 256.0], [16, 256], self.seed ^ 3);
        let gap = if to_edge(board) < 0.015 { 0.4 } else { 0.0 };
        0.3 + 0.4 * shade + 0.12 * rings + 0.12 * fibre - gap
    }

    fn bricks(&self, u: f32, v: f32) -> f32 {
        let grid = [self.count(), 2 * self.count()];
        let shifted = u + 0.5 * v.floor().rem_euclid(2.0);
        let mortar = to_edge(shifted) < 0.035 || to_edge(v) < 0.07;
        if mortar { 1.0 } else { 0.65 * self.shade([shifted, v], grid, 0) }
    }

    fn tiles(&self, u: f32, v: f32) -> f32 {
        let joint = to_edge(u) < 0.03 || to_edge(v) < 0.03;
        if joint { 0.0 } else { 0.35 + 0.65 * self.shade([u, v], [self.count(); 2], 0) }
    }

    /// Two stripes per unit, their border at a random place.
    fn stripes(&self, u: f32) -> f32 {
        let unit = [self.count(), 1];
        let width = 0.2 + 0.6 * self.shade([u, 0.0], unit, 0);
        self.shade([u, 0.0], unit, if u.rem_euclid(1.0) < width { 1 } else { 2 })
    }

    fn weave(&self, u: f32, v: f32) -> f32 {
        let over = (u.floor() + v.floor()).rem_euclid(2.0) < 1.0;
        let across = if over { u } else { v }.rem_euclid(1.0) - 0.5;
        let thread =
            self.shade(if over { [u, 0.0] } else { [0.0, v] }, [8 * self.count(); 2], i32::from(over));
        (1.0 - 3.0 * across * across) * (0.3 + 0.3 * f32::from(u8::from(over)) + 0.4 * thread)
    }

    /// Words of signs, each made of four strokes between the points of a 3 × 3 grid.
    fn glyphs(&self, u: f32, v: f32) -> f32 {
        let grid = [3 * self.count(), 2 * self.count()];
        let [x, y] = [u.rem_euclid(1.0), v.rem_euclid(1.0)];
        let is_space = self.shade([u, v], grid, 0) < 0.2;
        let is_large = self.shade([0.0, v], [1, grid[1]], 8) < 0.25;
        let paper = 0.9 - 0.5 * f32::from(u8::from(is_large));
        if is_space || y > 0.8 || x > 0.85 {
            return paper;
        }
        let point = |i: i32| {
            let place = (9.0 * self.shade([u, v], grid, i)) as i32;
            [0.15 + 0.28 * (place % 3) as f32, 0.12 + 0.28 * (place / 3) as f32]
        };
        let strokes = (1..=4).map(|i| to_segment([x, y], point(i), point(i + 1)));
        if strokes.fold(1.0, f32::min) < 0.07 { 0.0 } else { paper }
    }

    /// One disc per grid cell; it may reach into the neighbouring cells.
    fn discs(&self, u: f32, v: f32) -> f32 {
        let n = self.count();
        let [x, y] = [u * n as f32, v * n as f32];
        let mut level = 0.5 + 0.15 * self.clouds([u, v], 4, 4, 0.6);
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx as f32, dy as f32))) {
            let cell = [(x + dx).floor(), (y + dy).floor()];
            let random = |purpose| self.shade(cell, [n; 2], purpose);
            let centre = [cell[0] + random(0), cell[1] + random(1)];
            if f32::hypot(x - centre[0], y - centre[1]) < 0.15 + 0.5 * random(2) {
                level = random(3);
            }
        }
        level
    }
}

/// A dark, a middle and a light colour, or the reverse. They mostly share a hue and are seldom strongly
/// saturated.
fn random_colours(rng: &mut Pcg64) -> [[f32; 3]; 3] {
    let (dark, light) = (rng.random_range(30.0..110.0_f32), rng.random_range(130.0..235.0_f32));
    let middle = lerp(dark, light, rng.random_range(0.3..0.7));
    let hue = random_hue(rng);
    let mut colour = |brightness| {
        let hue = if rng.random_bool(0.8) { hue + rng.random_range(-0.3..0.3) } else { random_hue(rng) };
        hsv(hue, 0.75 * rng.random::<f32>().powi(2), brightness)
    };
    let colours = [colour(dark), colour(middle), colour(light)];
    let [a, b, c] = colours;
    if rng.random_bool(0.3) { [c, b, a] } else { colours }
}

/// A hue from 0 to 6; most are between red (0) and yellow (1), as most real things are.
fn random_hue(rng: &mut Pcg64) -> f32 {
    let widest = if rng.random_bool(0.6) { 1.0 } else { 6.0 };
    rng.random_range(0.0..widest)
}

/// The sRGB colour of a hue (0 to 6), saturation (0 to 1) and brightness (0 to 255).
fn hsv(hue: f32, saturation: f32, brightness: f32) -> [f32; 3] {
    let channel = |shift: f32| ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
    [0.0, 4.0, 2.0].map(|shift| brightness * lerp(1.0, channel(shift).clamp(0.0, 1.0), saturation))
}

/// Distance to the nearest integer.
fn to_edge(t: f32) -> f32 {
    (t - t.round()).abs()
}

/// Distance from `p` to the segment from `a` to `b`.
fn to_segment(p: [f32; 2], a: [f32; 2], b: [f32; 2]) -> f32 {
    let [way, to_p] = [[b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]];
    let length = (way[0] * way[0] + way[1] * way[1]).max(1e-9);
    let t = ((way[0] * to_p[0] + way[1] * to_p[1]) / length).clamp(0.0, 1.0);
    f32::hypot(to_p[0] - t * way[0], to_p[1] - t * way[1])
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    const SIDE: usize = 128;

    fn drawn(motif: Motif) -> Grid<Rgb> {
        Pattern::random(motif, &mut Pcg64::seed_from_u64(5)).draw(SIDE)
    }

    fn grey(pixel: &Rgb) -> f64 {
        pixel.iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0
    }

    fn deviation(picture: &Grid<Rgb>) -> f64 {
        let count = picture.size().area() as f64;
        let mean = picture.data().iter().map(grey).sum::<f64>() / count;
        (picture.data().iter().map(|p| (grey(p) - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    #[test]
    fn motifs_have_contrast_but_the_plain_one() {
        for motif in Motif::ALL {
            let contrast = deviation(&drawn(motif));
            assert_eq!(contrast < 5.0, motif == Motif::Plain, "{motif:?}: {contrast}");
        }
    }

    #[test]
    fn patterns_are_deterministic_and_differ_by_seed() {
        for motif in Motif::ALL {
            assert_eq!(drawn(motif), drawn(motif));
            let pattern = Pattern::random(motif, &mut Pcg64::seed_from_u64(5));
            assert_ne!(Pattern { seed: !pattern.seed, ..pattern }.draw(SIDE), drawn(motif), "{motif:?}");
        }
    }

    #[test]
    fn patterns_repeat_without_a_seam() {
        for motif in Motif::ALL {
            let pattern = Pattern::random(motif, &mut Pcg64::seed_from_u64(3));
            for i in 0..200 {
                let (u, v) = (0.00513 * i as f32, 0.00731 * i as f32);
                let near = |a: Rgb, b: Rgb| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 6);
                let here = pattern.colour(u, v);
                // Rounding may carry one point over an edge of the motif, seldom both.
                let again = [0.0, 1e-4].map(|e| pattern.colour(u + 1.0 + e, v - 1.0 - e));
                assert!(again.iter().any(|&c| near(here, c)), "{motif:?} at {u} {v}: {here:?} {again:?}");
            }
        }
    }
}
