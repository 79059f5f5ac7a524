//! The first depth map at twice its resolution: which coarse pixel a pixel continues.

use rayon::prelude::*;

use crate::CorrError;
use crate::convolution::Convolution;
use crate::map::{Map, Row};
use crate::plane_map::row_near;
use crate::pyramid::{CHANNELS, positive};
use crate::sweep::GROUPS;
use crate::weights::{Shape, Weights};
use crate::wide::{add, exp};

/// Planes between two depths beyond which they are just different.
pub const REACH: f32 = 4.0;

/// Channels of what is seen around a pixel.
const LOOKED: usize = 16;

/// These, and for each of the nine coarse pixels its distance in depth, its likeness, and its share by bilinear interpolation.
const INPUTS: usize = LOOKED + 3 * 9;

/// Which of the nine coarse pixels around a pixel is of the same surface (as in RAFT, Teed and Deng, ECCV 2020).
#[derive(Debug)]
pub struct Enlarge {
    /// What is seen around a pixel.
    pub look: Convolution,
    /// Of that, and of what tells the nine coarse pixels around it from each other.
    pub weigh: Convolution,
    /// The logarithms of their shares, beside those of bilinear interpolation.
    pub choose: Convolution,
}

impl Enlarge {
    pub(crate) fn new(weights: &Weights) -> Result<Self, CorrError> {
        let layer = |part: &str, inputs, outputs, side| {
            weights.bare(&format!("enlarge_net.{part}"), Shape::image(inputs, outputs, side), true)
        };
        Ok(Self {
            look: layer("look", CHANNELS, LOOKED, 3)?,
            weigh: layer("weigh", INPUTS, 32, 1)?,
            choose: layer("choose", 32, 9, 1)?,
        })
    }

    /// Shares of the 3×3 coarse pixels around each pixel, rows first, an image with nine channels: from the coarse depth in plane
    /// coordinates and the features of the reference view at both resolutions.
    pub fn shares(&self, u: &Map, coarse: &Map, fine: &Map) -> Map {
        let looked = self.look.run(fine, positive);
        let (coarse_lengths, fine_lengths) = (lengths(coarse), lengths(fine));
        let bilinear = [0, 1].map(|y| [0, 1].map(|x| bilinear(x, y)));
        let inputs = Map::by_rows(fine.sides(), INPUTS, |Row { y, .. }, to| {
            let pixels = to.as_chunks_mut::<INPUTS>().0;
            for (x, to) in pixels.iter_mut().enumerate() {
                to[..LOOKED].copy_from_slice(&looked.line(y)[x * LOOKED..][..LOOKED]);
                let own = &fine.line(y)[x * CHANNELS..][..CHANNELS];
                let middle = u.line(y / 2)[x / 2];
                for k in 0..9 {
                    let (row, column) = (row_near(y / 2, k / 3, u.height), row_near(x / 2, k % 3, u.width));
                    let other = &coarse.line(row)[column * CHANNELS..][..CHANNELS];
                    let product = dot(own, other);
                    let length =
                        fine_lengths[y * fine.width + x] * coarse_lengths[row * coarse.width + column];
                    to[LOOKED + k] = (u.line(row)[column] - middle).clamp(-REACH, REACH) / REACH;
                    to[LOOKED + 9 + k] = product / length;
                    to[LOOKED + 18 + k] = bilinear[y % 2][x % 2][k];
                }
            }
        });
        let weighed = self.weigh.run(&inputs, positive);
        self.choose.run(&weighed, |Row { y, .. }, values| {
            for (x, shares) in values.as_chunks_mut::<9>().0.iter_mut().enumerate() {
                add(shares, &bilinear[y % 2][x % 2]);
                let largest = shares.iter().fold(f32::NEG_INFINITY, |largest, value| largest.max(*value));
                shares.iter_mut().for_each(|value| *value = exp(*value - largest));
                let sum: f32 = shares.iter().sum();
                shares.iter_mut().for_each(|value| *value /= sum);
            }
        })
    }
}

/// The logarithms of the shares of bilinear interpolation, plus a hundredth, of the pixel (x, y) of a block of two by two.
#[must_use]
pub fn bilinear(x: usize, y: usize) -> [f32; 9] {
    const SIDES: [[f32; 3]; 2] = [[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]];
    std::array::from_fn(|k| (SIDES[y][k / 3] * SIDES[x][k % 3] + 0.01).ln())
}

/// The length of each pixel's features, at least 1e-12.
fn lengths(map: &Map) -> Vec<f32> {
    let length = |pixel: &[f32]| dot(pixel, pixel).sqrt().max(1e-12);
    map.values.par_chunks(CHANNELS).map(length).collect()
}

/// The sum of the products of a pixel's features with another's.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; GROUPS];
    for (a, b) in a.as_chunks::<GROUPS>().0.iter().zip(b.as_chunks::<GROUPS>().0) {
        for lane in 0..GROUPS {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum()
}
