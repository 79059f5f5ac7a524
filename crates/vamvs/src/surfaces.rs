//! Where a photograph shows surfaces, and where the sky: what the network tells, carried to the borders of patches of one colour.
//!
//! Beside a roof the sky looks to the network like more of the roof; a little farther from it, it knows the sky. So each pixel
//! takes the mean vote of those around it that have its colour, by a recursive filter that stops at edges (the domain transform of
//! Gastal and Oliveira, SIGGRAPH 2011): first at the size of the depth map, over large patches, then at half the photograph's size, to
//! find their borders.

use rayon::prelude::*;
use vamvs_core::{DepthMap, Grid, Rgb, Size};

use crate::region;

/// What a pixel that surely shows a surface counts beside one that shows none: where there is no texture, what is beside it is easily
/// continued.
const SURFACE_COUNTS: f32 = 0.15;

/// Neighbours are of one patch if their colours differ by no more than this: noise and gradients, grey values...
const SAME: f32 = 3.0;

/// ... and of two if they differ by so much more.
const EDGE: f32 = 12.0;

/// What a pixel takes from the next one falls short of all of it by this, divided by the longer side, in each pass.
const LOSSES: [f32; 3] = [6.4, 12.8, 25.6];

/// The sky is bright: the least value of its strongest channel...
const LEAST_BRIGHT: f64 = 110.0;

/// ... and white, grey or blue: the least value of blue minus red. What is neither is left to the photographs, sunsets too.
const LEAST_BLUE: f64 = -10.0;

/// The share of a patch that the network itself must know to be sky. Of plain walls, of which it knows little, it was up to 0.42, of skies
/// 0.5 and more.
const KNOWN: f64 = 0.45;

/// Patches whose mean colours differ by no more than this from one of the sky are sky too, as under an arch, grey values.
const SKY: f64 = 40.0;

/// Pixels that are less of one patch with their neighbours have texture, so that photographs tell whether they show a surface.
const PLAIN: f32 = 0.8;

/// Whether each pixel of a photograph may show a surface, from a depth map of it that in a part of the image, given as shares of its
/// width and height, has a depth wherever its maker saw a surface; `None` if all may.
pub(crate) fn surfaces(
    (map, part): (&DepthMap, [[f64; 2]; 2]),
    photograph: &Grid<Rgb>,
) -> Option<Grid<bool>> {
    let size = map.depth.size();
    let votes = Grid::from_fn(size, |x, y| match map.depth[(x, y)] {
        depth if depth > 0.0 => SURFACE_COUNTS * map.confidence[(x, y)],
        _ if region::contains(part, (x, y), size) => -1.0,
        _ => 0.0,
    });
    if votes.data().iter().all(|&vote| vote >= 0.0) {
        return None;
    }
    let told = votes.clone();
    let mut votes = Votes::new(votes, photograph);
    votes.spread();
    let half = Size::new(photograph.width().div_ceil(2), photograph.height().div_ceil(2));
    let mut votes = Votes::new(sampled(&votes.votes, half), photograph);
    votes.spread();
    let shows_none = Grid::from_fn(half, |x, y| votes.votes[(x, y)] < 0.0 && votes.is_plain(x, y));
    let sky = sky(&shows_none, &sampled(&told, half), &votes.colours);
    let has_sky = sky.data().iter().any(|&is_sky| is_sky);
    has_sky.then(|| Grid::from_fn(photograph.size(), |x, y| !sky[(x / 2, y / 2)]))
}

/// For each pixel how much speaks for a surface, from −1, and how far it is of one patch with the pixel before it in its row and its
/// column, 0 to 1.
struct Votes {
    votes: Grid<f32>,
    colours: Grid<Rgb>,
    across: Grid<f32>,
    down: Grid<f32>,
}

impl Votes {
    fn new(votes: Grid<f32>, photograph: &Grid<Rgb>) -> Self {
        let colours = reduced(photograph, votes.size());
        let (across, down) = (links(&colours, (1, 0)), links(&colours, (0, 1)));
        Self { votes, colours, across, down }
    }

    fn spread(&mut self) {
        let longer = self.votes.width().max(self.votes.height()) as f32;
        for loss in LOSSES {
            let kept = (1.0 - loss / longer).max(0.0);
            along_rows(&mut self.votes, &self.across, kept);
            along_columns(&mut self.votes, &self.down, kept);
        }
    }

    /// Whether a pixel is of one patch with most of its neighbours.
    fn is_plain(&self, x: usize, y: usize) -> bool {
        let Size { width, height } = self.votes.size();
        let beside = [
            (x > 0).then(|| self.across[(x, y)]),
            (x + 1 < width).then(|| self.across[(x + 1, y)]),
            (y > 0).then(|| self.down[(x, y)]),
            (y + 1 < height).then(|| self.down[(x, y + 1)]),
        ];
        let count = beside.iter().flatten().count() as f32;
        beside.iter().flatten().sum::<f32>() > PLAIN * count
    }
}

/// The patches that reach the upper border, are sky for the most part as was `told`, and may be by their colour; and others of such a
/// colour. The rest may be surfaces of which the network makes nothing, as a smooth face, or what no other view sees.
fn sky(shows_none: &Grid<bool>, told: &Grid<f32>, colours: &Grid<Rgb>) -> Grid<bool> {
    let patches = patches(shows_none);
    let colour = |patch: &Vec<(usize, usize)>| {
        let mean =
            |channel: usize| patch.iter().map(|&place| f64::from(colours[place][channel])).sum::<f64>();
        [0, 1, 2].map(|channel| mean(channel) / patch.len() as f64)
    };
    let may_be_sky = |colour: &[f64; 3]| {
        let [red, green, blue] = *colour;
        red.max(green).max(blue) >= LEAST_BRIGHT && blue - red >= LEAST_BLUE
    };
    let is_known = |patch: &&Vec<(usize, usize)>| {
        let known = patch.iter().filter(|&&place| told[place] < 0.0).count();
        known as f64 >= KNOWN * patch.len() as f64
    };
    let above = patches.iter().filter(|patch| patch.iter().any(|&(_, y)| y == 0)).filter(is_known);
    let of_sky: Vec<[f64; 3]> = above.map(colour).filter(may_be_sky).collect();
    let is_like = |patch: &Vec<(usize, usize)>| {
        let own = colour(patch);
        of_sky.iter().any(|sky| sky.iter().zip(own).all(|(sky, own)| (sky - own).abs() <= SKY))
    };
    let mut sky = Grid::filled(shows_none.size(), false);
    patches.iter().filter(|patch| is_like(patch)).flatten().for_each(|&place| sky[place] = true);
    sky
}

/// The connected pixels of a mask.
fn patches(mask: &Grid<bool>) -> Vec<Vec<(usize, usize)>> {
    let Size { width, height } = mask.size();
    let (mut open, mut patches) = (mask.clone(), Vec::new());
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if !std::mem::take(&mut open[(x, y)]) {
            continue;
        }
        let (mut patch, mut next) = (vec![(x, y)], 0);
        while let Some(&(x, y)) = patch.get(next) {
            next += 1;
            let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            for place in beside.into_iter().filter(|&(x, y)| x < width && y < height) {
                if std::mem::take(&mut open[place]) {
                    patch.push(place);
                }
            }
        }
        patches.push(patch);
    }
    patches
}

/// The first pixel of `from` that lies under pixel `to` of fewer or more.
fn place(to: usize, count: usize, from: usize) -> usize {
    (to * from / count).min(from - 1)
}

/// A grid at another size, each pixel that of the grid which it lies in.
fn sampled(grid: &Grid<f32>, size: Size) -> Grid<f32> {
    Grid::from_fn(size, |x, y| {
        grid[(place(x, size.width, grid.width()), place(y, size.height, grid.height()))]
    })
}

/// A photograph at a smaller size: the means over the pixels under each pixel.
fn reduced(photograph: &Grid<Rgb>, size: Size) -> Grid<Rgb> {
    let span = |at: usize, count: usize, from: usize| {
        let begin = place(at, count, from);
        begin..((at + 1) * from / count).clamp(begin + 1, from)
    };
    let row = |y: usize| {
        let rows = span(y, size.height, photograph.height());
        (0..size.width).map(move |x| {
            let columns = span(x, size.width, photograph.width());
            let mut sums = [0_u32; 3];
            for y in rows.clone() {
                for pixel in &photograph.data()[y * photograph.width()..][columns.clone()] {
                    sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += u32::from(*value));
                }
            }
            let count = (rows.len() * columns.len()) as u32;
            sums.map(|sum| ((sum + count / 2) / count) as u8)
        })
    };
    Grid::from_vec(size, (0..size.height).into_par_iter().flat_map_iter(row).collect())
}

/// How far each pixel is of one patch with the one at this distance before it; 0 at the border.
fn links(colours: &Grid<Rgb>, (dx, dy): (usize, usize)) -> Grid<f32> {
    Grid::from_fn(colours.size(), |x, y| {
        let Some((before_x, before_y)) = x.checked_sub(dx).zip(y.checked_sub(dy)) else { return 0.0 };
        let (here, before) = (colours[(x, y)], colours[(before_x, before_y)]);
        let difference = (0..3).map(|channel| here[channel].abs_diff(before[channel])).max().unwrap_or(0);
        (1.0 - (f32::from(difference) - SAME) / EDGE).clamp(0.0, 1.0)
    })
}

fn along_rows(votes: &mut Grid<f32>, links: &Grid<f32>, kept: f32) {
    let width = votes.width().max(1);
    let rows = votes.data_mut().par_chunks_exact_mut(width).zip(links.data().par_chunks_exact(width));
    rows.for_each(|(votes, links)| {
        for x in 1..width {
            votes[x] += kept * links[x] * (votes[x - 1] - votes[x]);
        }
        for x in (1..width).rev() {
            votes[x - 1] += kept * links[x] * (votes[x] - votes[x - 1]);
        }
    });
}

fn along_columns(votes: &mut Grid<f32>, links: &Grid<f32>, kept: f32) {
    let (width, height) = (votes.width(), votes.height());
    for y in 1..height {
        let (above, here) = votes.data_mut().split_at_mut(y * width);
        take(&mut here[..width], &above[(y - 1) * width..], &links.data()[y * width..][..width], kept);
    }
    for y in (1..height).rev() {
        let (above, here) = votes.data_mut().split_at_mut(y * width);
        take(&mut above[(y - 1) * width..], &here[..width], &links.data()[y * width..][..width], kept);
    }
}

/// A row takes from the one beside it.
fn take(row: &mut [f32], beside: &[f32], links: &[f32], kept: f32) {
    for ((own, beside), link) in row.iter_mut().zip(beside).zip(links) {
        *own += kept * link * (beside - *own);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_core::{Intrinsics, Pinhole, Pose};

    const SIZE: Size = Size::new(480, 320);

    /// The lowest row of the sky is this plus a tenth of the column.
    const ROOF: usize = 160;

    fn is_sky(x: usize, y: usize) -> bool {
        y < ROOF + x / 10
    }

    /// A sky with a slight gradient above a roof of tiles, both with noise.
    fn photograph() -> Grid<Rgb> {
        Grid::from_fn(SIZE, |x, y| {
            let noise = ((x * 7 + y * 13 + x * y % 5) % 4) as u8;
            if is_sky(x, y) {
                [150 + noise, 180, 215 + (y / 8) as u8]
            } else {
                [90 + 40 * ((x / 6 + y / 6) % 2) as u8, 60 + noise, 50]
            }
        })
    }

    const WHOLE: [[f64; 2]; 2] = [[0.0, 0.0], [1.0, 1.0]];

    /// A depth map of a quarter of the size that has depths where `shows` says.
    fn map(shows: impl Fn(usize, usize) -> bool) -> DepthMap {
        let size = Size::new(SIZE.width / 4, SIZE.height / 4);
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 60.0, cy: 40.0 };
        DepthMap {
            camera: Pinhole { size, intrinsics },
            cam_from_world: Pose::identity(),
            depth: Grid::from_fn(size, |x, y| if shows(4 * x, 4 * y) { 2.0 } else { 0.0 }),
            confidence: Grid::filled(size, 1.0),
            coarse_confidence: None,
        }
    }

    #[test]
    fn the_sky_beside_a_roof_is_sky_and_the_roof_stays() {
        // Known only from 50 pixels above the roof.
        let found = surfaces((&map(|x, y| y + 50 >= ROOF + x / 10), WHOLE), &photograph()).unwrap();
        for y in 0..SIZE.height {
            for x in 0..SIZE.width {
                let from_border = (y as f64 - (ROOF + x / 10) as f64).abs();
                assert!(from_border < 4.0 || found[(x, y)] != is_sky(x, y), "{x} {y}");
            }
        }
    }

    #[test]
    fn a_plain_wall_of_which_a_corner_is_doubted_stays() {
        let wall = Grid::filled(SIZE, [200; 3]);
        assert!(surfaces((&map(|x, y| x >= 40 || y >= 40), WHOLE), &wall).is_none());
    }

    #[test]
    fn what_is_dark_or_warm_is_no_sky() {
        for (colour, is_sky) in [([40, 40, 60], false), ([200, 170, 140], false), ([120, 150, 200], true)] {
            let found = surfaces((&map(|_, _| false), WHOLE), &Grid::filled(SIZE, colour));
            let all = found.map(|found| found.data().iter().all(|&shows| !shows));
            assert_eq!(all, is_sky.then_some(true), "{colour:?}");
        }
    }

    #[test]
    fn where_there_is_texture_photographs_decide() {
        let textured = Grid::from_fn(SIZE, |x, y| [((x / 2 + y / 2) % 2 * 60) as u8; 3]);
        assert!(surfaces((&map(|_, _| false), WHOLE), &textured).is_none());
        assert!(surfaces((&map(|_, _| true), WHOLE), &photograph()).is_none());
    }
    /// A gap in the roof shows the sky, a smooth spot of another colour is no sky although the network has no depth there.
    #[test]
    fn sky_is_what_reaches_the_upper_border_and_what_has_its_colour() {
        let is_gap = |x: usize, y: usize| (100..180).contains(&x) && (240..290).contains(&y);
        let is_spot = |x: usize, y: usize| (300..380).contains(&x) && (240..290).contains(&y);
        let plain = photograph();
        let photograph = Grid::from_fn(SIZE, |x, y| match () {
            () if is_gap(x, y) => [165, 190, 240],
            () if is_spot(x, y) => [190, 120, 70],
            () => plain[(x, y)],
        });
        let map = map(|x, y| !is_sky(x, y) && !is_gap(x, y) && !is_spot(x, y));
        let found = surfaces((&map, WHOLE), &photograph).unwrap();
        assert!(!found[(20, 20)] && !found[(140, 265)] && found[(340, 265)] && found[(240, 265)]);
    }

    #[test]
    fn what_lies_outside_of_the_part_tells_nothing() {
        let left = map(|x, _| x < SIZE.width / 2);
        assert!(surfaces((&left, [[0.0, 0.0], [0.5, 1.0]]), &Grid::filled(SIZE, [200; 3])).is_none());
    }
}
