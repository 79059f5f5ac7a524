//! Visibility of a reference view's pixels in all views of a scene: an 8-bit grey PNG with one tile per view,
//! from top to bottom in the order of the views. Each tile has the size of the reference view's image.
//!
//! A pixel is 0 if it shows no surface, 85 if its surface projects outside the other view's image, 170 if the
//! surface is occluded in the other view, 255 if the other view sees it.

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
}
