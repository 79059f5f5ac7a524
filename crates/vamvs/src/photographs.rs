//! The photographs of a scene as the network wants them: undistorted, reduced or enlarged.

use std::path::{Path, PathBuf};

use vamvs_core::undistort::Undistortion;
use vamvs_core::{Camera, Grid, Photo, Pinhole, Scene, Size, View};
use vamvs_io::image;
use vamvs_io::masks::{self, Masks};

use crate::{DepthOptions, VamvsError};

/// Reads photographs of a scene one by one.
#[derive(Clone, Debug)]
pub struct Photographs {
    images: PathBuf,
    masks: Masks,
    max_size: usize,
    enlarge: f64,
    /// The darkest and the brightest grey value that a pixel of a thing has.
    brightness: [u8; 2],
}

impl Photographs {
    /// Photographs in `images`, with their masks (0 = ignore), at the size that the options ask for.
    #[must_use]
    pub fn new(images: &Path, masks: Masks, options: &DepthOptions) -> Self {
        let DepthOptions { max_size, enlarge, min_brightness, max_brightness, .. } = *options;
        let brightness = [min_brightness, max_brightness];
        Self { images: images.to_owned(), masks, max_size, enlarge, brightness }
    }

    /// The same photographs, reduced to `max_size` pixels on the longer side.
    #[must_use]
    pub fn reduced_to(&self, max_size: usize) -> Self {
        Self { max_size, ..self.clone() }
    }

    /// Pixels on the longer side to which photographs are reduced.
    #[must_use]
    pub fn max_size(&self) -> usize {
        self.max_size
    }

    /// How many times larger photographs may become.
    #[cfg(feature = "net")]
    pub(crate) fn enlarge(&self) -> f64 {
        self.enlarge
    }

    /// Grey values below and above which a pixel is backdrop.
    #[cfg(feature = "net")]
    pub(crate) fn brightness(&self) -> [u8; 2] {
        self.brightness
    }

    /// What of the options beside the size changes photographs: enlargement, and the darkest and brightest grey value.
    pub(crate) fn shape(&self) -> (f64, [u8; 2]) {
        (self.enlarge, self.brightness)
    }

    /// The folder of photographs.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.images
    }

    /// How many views of the scene have a mask.
    #[must_use]
    pub fn masked(&self, scene: &Scene) -> usize {
        scene.views.iter().filter(|view| self.mask_path(view).is_some()).count()
    }

    /// The image file of a view.
    #[must_use]
    pub fn path(&self, view: &View) -> PathBuf {
        self.images.join(&view.name)
    }

    /// The mask file of a view, if there is one.
    #[must_use]
    pub fn mask_path(&self, view: &View) -> Option<PathBuf> {
        self.masks.find(&view.name)
    }

    /// The undistorted camera at working size.
    #[must_use]
    pub fn working_camera(&self, camera: &Camera) -> Pinhole {
        Undistortion::new(camera).pinhole().resized(self.working_size(camera.size))
    }

    /// Reads, undistorts and resizes a view's photograph, with its mask: file, alpha channel, what undistortion
    /// leaves empty, and what is too dark or too bright, together. The second value is a note for the user.
    ///
    /// # Errors
    /// If a file cannot be read or its size contradicts the camera's.
    pub fn load(&self, view: &View) -> Result<(Photo, Option<String>), VamvsError> {
        let (loaded, camera) = image::load_for_camera(&self.path(view), &view.camera)?;
        let mask = match self.mask_path(view) {
            Some(path) => Some(masks::load(&path, camera.size)?),
            None => None,
        };
        let mask = both(mask, loaded.alpha_mask);
        let undistortion = Undistortion::new(&camera);
        let mask = undistortion.mask(mask.as_ref());
        let size = self.working_size(camera.size);
        let image = resized(undistortion.image(&loaded.rgb), size);
        let foreground = (self.brightness != [0, 255]).then(|| foreground(&image, self.brightness));
        let photo = Photo {
            camera: undistortion.pinhole().resized(size),
            cam_from_world: view.cam_from_world,
            mask: both(mask.map(|mask| mask.resized_nearest(size)), foreground),
            image,
        };
        Ok((photo, loaded.note.map(|note| format!("{}: {note}", view.name))))
    }

    fn working_size(&self, size: Size) -> Size {
        let longer = size.width.max(size.height) as f64;
        let ratio = self.enlarge.min(self.max_size as f64 / longer);
        let side = |side: usize| (side as f64 * ratio).round().max(1.0) as usize;
        Size::new(side(size.width), side(size.height))
    }
}

/// The working cameras of all views of a scene.
#[must_use]
pub fn working_cameras(photographs: &Photographs, scene: &Scene) -> Vec<Pinhole> {
    scene.views.iter().map(|view| photographs.working_camera(&view.camera)).collect()
}

fn resized(image: Grid<vamvs_core::Rgb>, size: Size) -> Grid<vamvs_core::Rgb> {
    if image.size() == size { image } else { image::resize(&image, size) }
}

/// Pixels of which some channel has `least` or more, and some has `most` or less.
fn foreground(image: &Grid<vamvs_core::Rgb>, [least, most]: [u8; 2]) -> Grid<bool> {
    image.map(|rgb| rgb.iter().any(|&channel| channel >= least) && rgb.iter().any(|&channel| channel <= most))
}

fn both(a: Option<Grid<bool>>, b: Option<Grid<bool>>) -> Option<Grid<bool>> {
    match (a, b) {
        (Some(mut a), Some(b)) => {
            a.data_mut().iter_mut().zip(b.data()).for_each(|(a, b)| *a &= b);
            Some(a)
        }
        (a, b) => a.or(b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_photographs_are_reduced_and_small_ones_enlarged_up_to_the_size_asked_for() {
        let sized = |enlarge: f64, size: Size| {
            let options = DepthOptions { max_size: 1280, enlarge, ..DepthOptions::default() };
            Photographs::new(Path::new("images"), Masks::None, &options).working_size(size)
        };
        assert_eq!(sized(1.0, Size::new(3000, 2000)), Size::new(1280, 853));
        assert_eq!(sized(1.0, Size::new(480, 640)), Size::new(480, 640));
        assert_eq!(sized(2.0, Size::new(3000, 2000)), Size::new(1280, 853));
        assert_eq!(sized(2.0, Size::new(480, 640)), Size::new(960, 1280));
        assert_eq!(sized(2.0, Size::new(800, 600)), Size::new(1280, 960));
    }
}
