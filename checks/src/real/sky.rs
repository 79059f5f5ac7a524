//! Sky: where it is in a photograph, and how much of a cloud is sky.

use vamvs_core::{CloudPoint, Grid, Rgb, Size};

use super::cameras::Shot;

/// How the sky of a scene is told from what stands before it: it reaches the upper border of the photograph, is bright, and
/// changes slowly.
#[derive(Clone, Copy)]
pub struct SkyRule {
    /// The largest difference of neighbouring pixels in any channel, grey values.
    pub step: u8,
    /// The least brightness, grey values.
    pub least: u8,
    /// The least value of blue minus red, grey values.
    pub blue: i16,
}

/// Pixels next to the border of the sky do not count: a photograph's edges are not sharp.
const MARGIN: usize = 4;

impl SkyRule {
    /// Whether a pixel may be sky by its own colour.
    fn admits(self, [r, g, b]: Rgb) -> bool {
        r.max(g).max(b) >= self.least && i16::from(b) - i16::from(r) >= self.blue
    }

    /// The sky in a photograph: what is connected with sky at its upper border.
    pub fn find(self, photo: &Grid<Rgb>) -> Grid<bool> {
        let Size { width, height } = photo.size();
        let mut sky = Grid::filled(photo.size(), false);
        let mut open: Vec<(usize, usize)> =
            (0..width).filter(|&x| self.admits(photo[(x, 0)])).map(|x| (x, 0)).collect();
        for &place in &open {
            sky[place] = true;
        }
        while let Some((x, y)) = open.pop() {
            let around = [
                (x > 0).then(|| (x - 1, y)),
                (x + 1 < width).then(|| (x + 1, y)),
                (y > 0).then(|| (x, y - 1)),
                (y + 1 < height).then(|| (x, y + 1)),
            ];
            for next in around.into_iter().flatten() {
                let differs = (0..3).any(|c| photo[next][c].abs_diff(photo[(x, y)][c]) > self.step);
                if !sky[next] && !differs && self.admits(photo[next]) {
                    sky[next] = true;
                    open.push(next);
                }
            }
        }
        sky
    }
}

/// The mask without pixels that have another one within [`MARGIN`] rows or columns.
pub fn inside(mask: &Grid<bool>) -> Grid<bool> {
    let Size { width, height } = mask.size();
    let along = |mask: &Grid<bool>, is_row: bool| {
        Grid::from_fn(mask.size(), |x, y| {
            let (at, side) = if is_row { (x, width) } else { (y, height) };
            let ends = (at.saturating_sub(MARGIN), (at + MARGIN).min(side - 1));
            (ends.0..=ends.1).all(|k| mask[if is_row { (k, y) } else { (x, k) }])
        })
    };
    along(&along(mask, true), false)
}

/// The share of a cloud's points that lie in the sky of some view: a surface never does, because a view that looks at its
/// place sees it or something before it.
pub fn share(cloud: &[CloudPoint], views: &[(Shot, Grid<bool>)]) -> f64 {
    let is_sky = |point: &&CloudPoint| {
        views.iter().any(|(shot, sky)| shot.pixel_of(&point.x_in_world).is_some_and(|(pixel, _)| sky[pixel]))
    };
    cloud.iter().filter(is_sky).count() as f64 / cloud.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sky_ends_at_roofs_and_a_bright_wall_below_is_none() {
        let rule = SkyRule { step: 6, least: 130, blue: -8 };
        let photo = Grid::from_fn(Size::new(40, 30), |x, y| match y {
            0..12 => [150, 170, 200 + (x / 4) as u8],
            12..15 => [90, 60, 50],
            _ => [200, 200, 205],
        });
        let sky = rule.find(&photo);
        assert!(sky[(5, 0)] && sky[(39, 11)] && !sky[(5, 12)] && !sky[(5, 20)]);
        let inner = inside(&sky);
        assert!(inner[(20, 3)] && inner[(0, 0)] && inner[(20, 7)] && !inner[(20, 8)]);
    }
}
