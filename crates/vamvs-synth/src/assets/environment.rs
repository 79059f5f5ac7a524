//! Reads environment maps from files, and normalises their brightness.

use std::f32::consts::PI;
use std::path::Path;
use std::sync::Arc;

use image::ImageReader;
use rand::RngExt;
use rand_pcg::Pcg64;
use vamvs_core::{Grid, Size};

use super::AssetError;
use crate::Environment;
use crate::colour::luminance;

/// Larger environment maps are reduced to this width, pixels: lighting needs no more.
const MOST_WIDTH: u32 = 2048;

/// Reads an equirectangular map of linear radiance. Negative and non-finite values become 0. A map whose upper
/// half is dark is an error.
pub(super) fn load(path: &Path) -> Result<Grid<[f32; 3]>, AssetError> {
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    let decoded = reader.map_err(AssetError::system(path))?.decode();
    let mut map = decoded.map_err(|source| AssetError::Environment { path: path.to_owned(), source })?;
    if map.width() > MOST_WIDTH {
        map = map.thumbnail(MOST_WIDTH, MOST_WIDTH);
    }
    let map = map.into_rgb32f();
    let size = Size::new(map.width() as usize, map.height() as usize);
    let clean = |value: f32| if value.is_finite() { value.max(0.0) } else { 0.0 };
    let grid = Grid::from_vec(size, map.into_raw().as_chunks::<3>().0.to_vec()).map(|c| c.map(clean));
    if irradiance(&grid) > 0.0 {
        return Ok(grid);
    }
    Err(AssetError::DarkEnvironment { path: path.to_owned() })
}

/// `map` turned at random about z, with the strength that lights level ground with an irradiance of π.
pub(super) fn normalised(map: Grid<[f32; 3]>, rng: &mut Pcg64) -> Environment {
    let strength = PI / irradiance(&map);
    Environment { map: Arc::new(map), rotation: rng.random_range(0.0..std::f64::consts::TAU), strength }
}

/// The irradiance (as luminance) of level ground: the integral of the upper half's luminance, weighted by the
/// cosine of the angle to the zenith.
fn irradiance(map: &Grid<[f32; 3]>) -> f32 {
    let (width, height) = (map.width(), map.height());
    let row = |y: usize| {
        // A row is a ring around the zenith. Between zenith angles a and b, solid angle times cosine is
        // π (sin² b − sin² a).
        let ring = |y: usize| (PI * y as f32 / height as f32).min(0.5 * PI).sin().powi(2);
        let weight = PI * (ring(y + 1) - ring(y)) / width as f32;
        weight * map.row(y).iter().map(|&pixel| luminance(pixel)).sum::<f32>()
    };
    (0..height).map(row).sum()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use vamvs_io::atomic;

    use super::*;

    #[test]
    fn a_uniform_sky_gives_pi() {
        for height in [1, 2, 7, 64] {
            let sky = Grid::filled(Size::new(2 * height, height), [1.0_f32; 3]);
            assert!((irradiance(&sky) - PI).abs() < 1e-4);
            let half = Grid::from_fn(sky.size(), |_, y| [if 2 * y < height { 4.0 } else { 9.0 }; 3]);
            let strength = normalised(half, &mut Pcg64::seed_from_u64(0)).strength;
            assert!(height % 2 == 1 || (strength - 0.25).abs() < 1e-5, "the lower half does not count");
        }
    }

    /// A Radiance file of two pixels, (1, 2, 0.5) and black.
    const RADIANCE: &[u8] = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x40\x80\x20\x82\0\0\0\0";

    #[test]
    fn radiance_files_are_read_and_bad_ones_named() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            atomic::write(&path, |out| out.write_all(bytes)).unwrap();
            path
        };
        let map = load(&write("good.hdr", RADIANCE)).unwrap();
        assert_eq!(map.data(), [[1.0, 2.0, 0.5], [0.0; 3]]);
        let error = load(&write("cut.hdr", &RADIANCE[..RADIANCE.len() - 6])).unwrap_err();
        assert!(error.to_string().contains("cut.hdr"), "{error}");
        let black = [&RADIANCE[..RADIANCE.len() - 8], &[0; 8]].concat();
        let error = load(&write("black.hdr", &black)).unwrap_err();
        assert!(error.to_string().contains("black.hdr"), "{error}");
    }
}
