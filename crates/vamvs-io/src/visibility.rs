//! Visibility of a reference view's pixels in other views: an 8-bit grey PNG with one tile per view, from top to bottom.
//!
//! Ground truth ([`read`]) has a tile of the size of the reference view's image for each view of a scene, in their order. A
//! pixel is 0 if it shows no surface, 85 if its surface projects outside the other view's image, 170 if the surface is
//! occluded in the other view, 255 if the other view sees it. A network's prediction ([`read_predicted`]) has a tile for
//! each source view, which may be smaller than the image.

use std::path::Path;

use ::image::DynamicImage;
use vamvs_core::{Grid, Size, Visibility};

use crate::{IoError, Place, image};

/// Reads the tiles of a reference view whose image has `size`, one for each of `views` views.
///
/// # Errors
/// If the file cannot be decoded, is not an 8-bit grey image as wide as `size` and `views` times as high, or has
/// other values than these four.
pub fn read(path: &Path, size: Size, views: usize) -> Result<Vec<Grid<Visibility>>, IoError> {
    let stacked = decode_grey(path)?;
    if stacked.size() != Size::new(size.width, size.height * views) {
        let found = stacked.size();
        let problem =
            format!("expected a tile of {size} for each of {views} views from top to bottom, found {found}");
        return Err(IoError::malformed(path, Place::Whole, problem));
    }
    let tile = |grey: &[u8]| grey.iter().map(|&grey| from_grey(path, grey)).collect::<Result<_, _>>();
    let tiles = stacked.data().chunks_exact(size.area());
    tiles.map(|grey| Ok(Grid::from_vec(size, tile(grey)?))).collect()
}

/// Writes the tiles of a reference view, one for each view in the order of the views.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
///
/// # Panics
/// If there are no tiles, or they are not all of one size.
pub fn write(path: &Path, tiles: &[Grid<Visibility>]) -> Result<(), IoError> {
    let size = tiles.first().expect("a scene has views").size();
    assert!(tiles.iter().all(|tile| tile.size() == size), "tiles of one view have one size");
    let grey = tiles.iter().flat_map(|tile| tile.data()).map(|&visibility| to_grey(visibility)).collect();
    let stacked = Size::new(size.width, size.height * tiles.len());
    image::save_png_gray8(path, &Grid::from_vec(stacked, grey))
}

/// Writes how likely each source view sees what a reference view's pixels show, as a network predicts it: an 8-bit grey
/// PNG with one tile per source view, from top to bottom, 0 for invisible to 255 for visible.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
///
/// # Panics
/// If there are no tiles, or they are not all of one size.
pub fn write_predicted(path: &Path, tiles: &[Grid<f32>]) -> Result<(), IoError> {
    let size = tiles.first().expect("a depth map has source views").size();
    assert!(tiles.iter().all(|tile| tile.size() == size), "tiles of one view have one size");
    let grey = |&share: &f32| (255.0 * share.clamp(0.0, 1.0)).round() as u8;
    let stacked = Size::new(size.width, size.height * tiles.len());
    image::save_png_gray8(
        path,
        &Grid::from_vec(stacked, tiles.iter().flat_map(|tile| tile.data()).map(grey).collect()),
    )
}

/// Reads the `count` tiles that [`write_predicted`] wrote; the values are in [0, 1].
///
/// # Errors
/// If the file cannot be decoded, is not an 8-bit grey image, or its height is not a multiple of `count`.
pub fn read_predicted(path: &Path, count: usize) -> Result<Vec<Grid<f32>>, IoError> {
    let stacked = decode_grey(path)?;
    let Size { width, height } = stacked.size();
    if count == 0 || height % count != 0 {
        let problem =
            format!("expected {count} tiles of one size from top to bottom, found {width}×{height} pixels");
        return Err(IoError::malformed(path, Place::Whole, problem));
    }
    let size = Size::new(width, height / count);
    let share = |grey: &u8| f32::from(*grey) / 255.0;
    let tile = |grey: &[u8]| Grid::from_vec(size, grey.iter().map(share).collect());
    Ok(stacked.data().chunks_exact(size.area()).map(tile).collect())
}

fn decode_grey(path: &Path) -> Result<Grid<u8>, IoError> {
    match image::decode(path)? {
        DynamicImage::ImageLuma8(grey) => {
            let size = Size::new(grey.width() as usize, grey.height() as usize);
            Ok(Grid::from_vec(size, grey.into_raw()))
        }
        other => {
            let problem = format!("expected an 8-bit grey image, found {:?}", other.color());
            Err(IoError::malformed(path, Place::Whole, problem))
        }
    }
}

fn to_grey(visibility: Visibility) -> u8 {
    match visibility {
        Visibility::None => 0,
        Visibility::OutOfView => 85,
        Visibility::Occluded => 170,
        Visibility::Visible => 255,
    }
}

fn from_grey(path: &Path, grey: u8) -> Result<Visibility, IoError> {
    match grey {
        0 => Ok(Visibility::None),
        85 => Ok(Visibility::OutOfView),
        170 => Ok(Visibility::Occluded),
        255 => Ok(Visibility::Visible),
        _ => {
            let problem = format!("expected the grey values 0, 85, 170 and 255, found {grey}");
            Err(IoError::malformed(path, Place::Whole, problem))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Visibility; 4] =
        [Visibility::None, Visibility::OutOfView, Visibility::Occluded, Visibility::Visible];

    fn tiles(size: Size, count: usize) -> Vec<Grid<Visibility>> {
        (0..count).map(|tile| Grid::from_fn(size, |x, y| ALL[(x + 2 * y + 3 * tile) % 4])).collect()
    }

    #[test]
    fn tiles_come_back_in_their_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("visibility.png");
        let tiles = tiles(Size::new(5, 3), 4);
        write(&path, &tiles).unwrap();
        assert_eq!(image::stored_size(&path).unwrap(), Size::new(5, 12));
        assert_eq!(read(&path, Size::new(5, 3), 4).unwrap(), tiles);
        assert_eq!(decode_grey(&path).unwrap().row(3)[..2], [255, 0], "the second tile is below the first");
    }

    #[test]
    fn tiles_of_another_size_or_number_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("visibility.png");
        write(&path, &tiles(Size::new(5, 3), 2)).unwrap();
        for (size, views) in
            [(Size::new(4, 3), 2), (Size::new(5, 4), 2), (Size::new(5, 3), 1), (Size::new(5, 3), 3)]
        {
            let error = read(&path, size, views).unwrap_err().to_string();
            assert!(
                error.contains(&format!("{size} for each of {views}")) && error.contains("5×6"),
                "{error}"
            );
        }
    }

    #[test]
    fn other_greys_and_other_images_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("visibility.png");
        let size = Size::new(2, 1);
        image::save_png_gray8(&path, &Grid::from_vec(size, vec![255, 84])).unwrap();
        assert!(read(&path, size, 1).unwrap_err().to_string().contains("found 84"));
        image::save_png_gray16(&path, &Grid::filled(size, 255)).unwrap();
        assert!(read(&path, size, 1).unwrap_err().to_string().contains("8-bit grey"));
        image::save_png_rgb(&path, &Grid::filled(size, [255; 3])).unwrap();
        assert!(read(&path, size, 1).unwrap_err().to_string().contains("8-bit grey"));
    }

    #[test]
    fn predicted_tiles_come_back_to_half_a_grey_level() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.png");
        let tile =
            |first: f32| Grid::from_fn(Size::new(5, 3), |x, y| first + 0.07 * x as f32 + 0.01 * y as f32);
        write_predicted(&path, &[tile(0.0), tile(0.6)]).unwrap();
        for (read, written) in read_predicted(&path, 2).unwrap().iter().zip([tile(0.0), tile(0.6)]) {
            assert_eq!(read.size(), written.size());
            assert!(
                read.data()
                    .iter()
                    .zip(written.data())
                    .all(|(read, written)| (read - written).abs() < 0.5 / 254.0)
            );
        }
        let error = read_predicted(&path, 4).unwrap_err().to_string();
        assert!(error.contains("expected 4 tiles") && error.contains("5×6"), "{error}");
    }
}
