//! Textures with a size in the world, and the specular coats over them.

use std::path::PathBuf;
use std::sync::Arc;

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use vamvs_core::{Grid, Rgb, Size};

use super::AssetError;
use crate::Material;
use crate::pattern::{Motif, Pattern};

/// Width and height of patterns on large surfaces, pixels.
const LARGE_SIDE: usize = 512;

/// Width and height of patterns on small surfaces, pixels.
const SMALL_SIDE: usize = 256;

/// Extent from which on a surface is large, metres.
const LARGE: f32 = 0.4;

/// Number of photographs from which the texture of a large surface is chosen.
const CANDIDATES: usize = 4;

/// Width and height of plain patterns, pixels: they show hardly any detail.
const PLAIN_SIDE: usize = 128;

/// What kind of procedural pattern a surface may have. Photographs are not restricted by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Look {
    /// Any pattern; the surface may also be almost textureless.
    Any,
    /// Any pattern but plain.
    Rich,
    /// Like bare ground: nothing regular.
    Earth,
    /// Like outdoor walls: bricks, tiles, stone, plaster.
    Masonry,
}

impl Look {
    fn motifs(self) -> &'static [Motif] {
        match self {
            Self::Any | Self::Rich => &Motif::ALL[1..],
            Self::Earth => &[Motif::Clouds, Motif::Speckles, Motif::Marble],
            Self::Masonry => &[Motif::Bricks, Motif::Tiles, Motif::Speckles, Motif::Clouds],
        }
    }
}

/// A texture and the size in metres (width, height) at which it repeats.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    pub picture: Arc<Grid<Rgb>>,
    pub size: [f32; 2],
}

impl Surface {
    /// Almost one colour, for surfaces about `extent` metres large.
    pub fn plain(extent: f32, rng: &mut Pcg64) -> Self {
        let picture = Pattern::random(Motif::Plain, rng).draw(PLAIN_SIDE);
        Self { picture: Arc::new(picture), size: [0.5 * extent; 2] }
    }

    /// A random pattern of that look, for surfaces about `extent` metres large.
    pub fn pattern(look: Look, extent: f32, rng: &mut Pcg64) -> Self {
        let motif = *look.motifs().choose(rng).expect("there are motifs");
        let side = if extent < LARGE { SMALL_SIDE } else { LARGE_SIDE };
        let picture = Pattern::random(motif, rng).draw(side);
        Self { picture: Arc::new(picture), size: [extent * log_uniform(0.3..1.0, rng); 2] }
    }

    /// A random photograph, joined with its mirror images so that it repeats without a seam, for surfaces
    /// about `extent` metres large. On large ones, where repetition shows, it is the most even of a few
    /// ([`unevenness`]).
    pub fn photograph(files: &[PathBuf], extent: f32, rng: &mut Pcg64) -> Result<Self, AssetError> {
        let count = if extent < LARGE { 1 } else { CANDIDATES };
        let candidates: Vec<&PathBuf> = (0..count).filter_map(|_| files.choose(rng)).collect();
        let pictures: Vec<Grid<Rgb>> =
            candidates.par_iter().map(|file| vamvs_io::image::load_rgb(file)).collect::<Result<_, _>>()?;
        let evenest = pictures.iter().min_by(|a, b| unevenness(a).total_cmp(&unevenness(b)));
        let picture = mirrored(evenest.expect("there are photographs"));
        let width = extent * log_uniform(0.5..1.5, rng);
        let aspect = picture.height() as f32 / picture.width() as f32;
        Ok(Self { picture: Arc::new(picture), size: [width, width * aspect] })
    }

    /// The texture under a random coat, for texture coordinates in metres.
    pub fn material(self, rng: &mut Pcg64) -> Material {
        coated(self.picture, self.size.map(|side| 1.0 / side), rng)
    }
}

/// A texture under a random coat: half of them matt, one in ten glossy.
pub(crate) fn coated(albedo: Arc<Grid<Rgb>>, tiling: [f32; 2], rng: &mut Pcg64) -> Material {
    let (specular, roughness) = match rng.random_range(0..10) {
        0..5 => (0.0, 1.0),
        5..9 => (0.04, rng.random_range(0.3..0.7)),
        _ => (0.05, rng.random_range(0.1..0.3)),
    };
    Material { albedo, tiling, tint: [1.0; 3], specular, roughness }
}

/// A random number in the range, uniform in its logarithm.
pub(crate) fn log_uniform(range: std::ops::Range<f32>, rng: &mut Pcg64) -> f32 {
    range.start * (range.end / range.start).powf(rng.random())
}

/// How much of a picture's contrast is coarse: the share (0 to 1) of the variance of its brightness that lies
/// between the means of the cells of a 4 × 4 grid.
fn unevenness(picture: &Grid<Rgb>) -> f64 {
    let mut cells = [[0.0; 3]; 16];
    for y in 0..picture.height() {
        for (x, pixel) in picture.row(y).iter().enumerate() {
            let brightness = pixel.iter().map(|&value| f64::from(value)).sum::<f64>();
            let cell = &mut cells[4 * (4 * y / picture.height()) + 4 * x / picture.width()];
            *cell = [cell[0] + 1.0, cell[1] + brightness, cell[2] + brightness * brightness];
        }
    }
    let [count, sum, squares] = [0, 1, 2].map(|i| cells.iter().map(|cell| cell[i]).sum::<f64>());
    let mean_square = sum * sum / count;
    let between = cells.iter().map(|[n, sum, _]| sum * sum / n.max(1.0)).sum::<f64>() - mean_square;
    between / (squares - mean_square).max(1.0)
}

fn mirrored(picture: &Grid<Rgb>) -> Grid<Rgb> {
    let (width, height) = (picture.width(), picture.height());
    let fold = |i: usize, side: usize| i.min(2 * side - 1 - i);
    Grid::from_fn(Size::new(2 * width, 2 * height), |x, y| picture[(fold(x, width), fold(y, height))])
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn mirror_images_join_at_all_sides() {
        let picture = mirrored(&Grid::from_fn(Size::new(3, 2), |x, y| [x as u8, y as u8, 0]));
        let row: Vec<u8> = picture.row(0).iter().map(|c| c[0]).collect();
        assert_eq!(row, [0, 1, 2, 2, 1, 0]);
        assert_eq!(picture.row(3), picture.row(0));
    }

    #[test]
    fn even_pictures_vary_only_in_small() {
        let of =
            |f: fn(usize, usize) -> u8| unevenness(&Grid::from_fn(Size::new(64, 48), |x, y| [f(x, y); 3]));
        assert_eq!(of(|x, y| 255 * ((x + y) % 2) as u8), 0.0);
        assert_eq!(of(|_, _| 100), 0.0);
        assert_eq!(of(|x, _| if x < 32 { 0 } else { 200 }), 1.0);
        // Halves whose means differ by 100, with detail of ± 50: half of the variance is coarse.
        assert_eq!(of(|x, y| if y < 24 { 0 } else { 100 } + 100 * ((x + y) % 2) as u8), 0.5);
    }

    #[test]
    fn log_uniform_numbers_have_their_median_in_the_geometric_middle() {
        let mut rng = Pcg64::seed_from_u64(1);
        let below = (0..1000).filter(|_| log_uniform(0.25..4.0, &mut rng) < 1.0).count();
        assert!((450..550).contains(&below));
    }
}
