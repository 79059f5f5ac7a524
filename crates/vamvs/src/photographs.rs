//! The photographs of a scene as the network needs them: undistorted, reduced or enlarged.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use vamvs_core::undistort::Undistortion;
use vamvs_core::{Camera, Grid, Photo, Pinhole, Rgb, Scene, Size, View};
use vamvs_io::image::{self, Stretch};
use vamvs_io::masks::{self, Masks};

use crate::{DepthOptions, Stretching, VamvsError};

/// A program's own photographs, in memory or anywhere else.
pub trait PhotoSource: Send + Sync {
    /// The photograph of a view; must be the same each time.
    ///
    /// # Errors
    /// If there is none; then the view is left out.
    fn picture(&self, view: &View) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>>;
}

/// A photograph as its camera took it, lens distortion included.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The image, of the size of the camera's photograph ([`Camera::photograph_size`]).
    pub image: Grid<Rgb>,
    /// Pixels that count (`true`), of the same size; `None` if all do.
    pub mask: Option<Grid<bool>>,
}

/// Where photographs are.
#[derive(Clone)]
pub(crate) enum Origin {
    Files { images: PathBuf, masks: Masks },
    Program(Arc<dyn PhotoSource>),
}

/// A photograph as it was taken, its camera, and a note for the user.
struct Taken {
    picture: Picture,
    camera: Camera,
    note: Option<String>,
}

/// A photograph is enlarged for the network only if that is by this factor at least.
const LEAST_ENLARGEMENT: f64 = 1.2;

/// Reads photographs of a scene one by one.
#[derive(Clone, Debug)]
pub struct Photographs {
    origin: Origin,
    /// Longer side of the photographs that the network sees, pixels.
    max_size: usize,
    /// Longer side of the photographs that depth maps are refined to, pixels.
    full_size: usize,
    /// Largest factor by which photographs are enlarged.
    enlarge: f64,
    /// The same for what the network sees, where that is more.
    enlarge_for_network: f64,
    /// The darkest and the brightest grey value that is not masked as backdrop.
    brightness: [u8; 2],
    /// How photographs of 16 bits become 8.
    stretch: Option<Stretch>,
}

/// The most photographs, evenly spread, and values of each, that tell how all are stretched.
const STRETCHED_BY: (usize, usize) = (16, 20_000);

/// The share of the values that is cut off at each end by a stretch.
const CUT_OFF: f64 = 0.001;

/// Photographs whose values span more than this are not stretched.
const WIDE: u16 = u16::MAX / 2;

impl Photographs {
    /// Photographs in `images`, with their masks (0 = ignore), at the size that the options ask for: that at which the
    /// network sees them.
    #[must_use]
    pub fn new(images: &Path, masks: Masks, options: &DepthOptions) -> Self {
        Self::of(Origin::Files { images: images.to_owned(), masks }, options)
    }

    /// The program's own photographs, at the size that the options ask for.
    #[must_use]
    pub fn from_source(source: Arc<dyn PhotoSource>, options: &DepthOptions) -> Self {
        Self::of(Origin::Program(source), options)
    }

    pub(crate) fn of(origin: Origin, options: &DepthOptions) -> Self {
        let DepthOptions {
            max_size: full_size, network_size, enlarge, min_brightness, max_brightness, ..
        } = *options;
        let brightness = [min_brightness, max_brightness];
        let max_size = full_size.min(network_size);
        let stretch = match options.stretch {
            Stretching::Between { low, high } => Some(Stretch { low, high }),
            Stretching::Auto | Stretching::None => None,
        };
        Self { origin, max_size, full_size, enlarge, enlarge_for_network: enlarge, brightness, stretch }
    }

    /// The same photographs, of which those of 16 bits are stretched as the options say; with [`Stretching::Auto`], between the
    /// values that nearly all of those of `views` lie between, if they are close together, which a warning tells.
    #[must_use]
    pub fn stretched(self, views: &[View], options: &DepthOptions) -> (Self, Option<String>) {
        let Origin::Files { images, .. } = &self.origin else { return (self, None) };
        if options.stretch != Stretching::Auto {
            return (self, None);
        }
        let (most, values) = STRETCHED_BY;
        let step = views.len().div_ceil(most).max(1);
        let paths = views.iter().step_by(step).map(|view| images.join(view.file()));
        // What cannot be read is told when it is wanted.
        let sampled = |path: PathBuf| image::values_of_16_bits(&path, values).ok().flatten();
        let mut values: Vec<u16> = paths.filter_map(sampled).flatten().collect();
        values.sort_unstable();
        let cut = (CUT_OFF * values.len() as f64) as usize;
        let (Some(&low), Some(&high)) = (values.get(cut), values.iter().rev().nth(cut)) else {
            return (self, None);
        };
        if low >= high || high - low > WIDE {
            return (self, None);
        }
        let note = format!(
            "the photographs have 16 bits, of which they use {low} to {high}: all are stretched to 8 bits alike (--stretch)"
        );
        (Self { stretch: Some(Stretch { low, high }), ..self }, Some(note))
    }

    /// The same photographs, reduced to `max_size` pixels on the longer side.
    #[must_use]
    pub fn reduced_to(&self, max_size: usize) -> Self {
        Self { max_size, ..self.clone() }
    }

    /// The same photographs, at the size to which depth maps are refined.
    #[must_use]
    pub fn full(&self) -> Self {
        Self { max_size: self.full_size, ..self.as_they_are() }
    }

    /// The same photographs, of which the network sees smaller ones enlarged by up to `factor`.
    #[must_use]
    pub(crate) fn enlarged_for_network(self, factor: f64) -> Self {
        Self { enlarge_for_network: factor.max(self.enlarge), ..self }
    }

    /// The same photographs, none enlarged for the network alone.
    #[must_use]
    pub(crate) fn as_they_are(&self) -> Self {
        Self { enlarge_for_network: self.enlarge, ..self.clone() }
    }

    /// By how much a photograph of a camera is enlarged for the network alone: 1 if it is not.
    pub(crate) fn enlarged_by(&self, camera: &Camera) -> f64 {
        let [seen, own] = [self, &self.as_they_are()].map(|photographs| photographs.ratio(camera.size));
        seen / own
    }

    /// Longer side to which photographs are reduced for refined depth maps, pixels.
    pub(crate) fn full_size(&self) -> usize {
        self.full_size
    }

    /// Longer side to which photographs are reduced for the network, pixels.
    #[must_use]
    pub fn max_size(&self) -> usize {
        self.max_size
    }

    /// Largest factors by which photographs are enlarged: of all, and of what the network sees.
    pub(crate) fn enlarge(&self) -> [f64; 2] {
        [self.enlarge, self.enlarge_for_network]
    }

    /// How grey values are taken: the darkest and the brightest that are not masked as backdrop, and the stretch of 16 bits.
    pub(crate) fn tones(&self) -> ([u8; 2], Option<Stretch>) {
        (self.brightness, self.stretch)
    }

    /// The options that change photographs, apart from their size: enlargement, the darkest and
    /// brightest grey value, and the stretch of 16 bits.
    pub(crate) fn shape(&self) -> (f64, [u8; 2], Option<Stretch>) {
        (self.enlarge, self.brightness, self.stretch)
    }

    /// The folder of photographs, if they are files.
    #[must_use]
    pub fn folder(&self) -> Option<&Path> {
        match &self.origin {
            Origin::Files { images, .. } => Some(images),
            Origin::Program(_) => None,
        }
    }

    /// The masks, if they are files.
    #[must_use]
    pub fn masks(&self) -> &Masks {
        match &self.origin {
            Origin::Files { masks, .. } => masks,
            Origin::Program(_) => &Masks::None,
        }
    }

    /// Adds a view's photograph and mask to a hash, or the error if they cannot be read: then the
    /// view is left out later.
    pub(crate) fn hash(&self, view: &View, hasher: &mut blake3::Hasher) {
        match &self.origin {
            Origin::Files { images, masks } => {
                let files = [Some(images.join(view.file())), masks.find(&view.file())];
                files.iter().flatten().for_each(|file| hash_file(file, hasher));
            }
            Origin::Program(source) => match source.picture(view) {
                Ok(Picture { image, mask }) => {
                    hasher.update(image.data().as_flattened());
                    if let Some(mask) = mask {
                        hasher.update(mask.map(|&counts| u8::from(counts)).data());
                    }
                }
                Err(error) => {
                    hasher.update(error.to_string().as_bytes());
                }
            },
        }
    }

    /// Whether there may be a photograph of the view: false only for a file that is not there.
    pub(crate) fn may_have(&self, view: &View) -> bool {
        self.folder().is_none_or(|images| images.join(view.file()).is_file())
    }

    /// The paths, sizes and times of last change of a view's photograph and mask; `None` if they are not files or cannot be
    /// found.
    pub(crate) fn stamp(&self, view: &View) -> Option<String> {
        let Origin::Files { images, masks } = &self.origin else { return None };
        let stamp = |file: PathBuf| {
            let about = std::fs::metadata(&file).ok()?;
            let changed = about.modified().ok()?.duration_since(std::time::UNIX_EPOCH).ok()?;
            let file = std::path::absolute(&file).ok()?;
            Some(format!(
                "{}: {} bytes, changed {} ns after 1970",
                file.display(),
                about.len(),
                changed.as_nanos()
            ))
        };
        let photograph = stamp(images.join(view.file()))?;
        Some(match masks.find(&view.file()) {
            Some(mask) => format!("{photograph}; mask: {}", stamp(mask)?),
            None => photograph,
        })
    }

    /// The undistorted camera at working size.
    #[must_use]
    pub fn working_camera(&self, camera: &Camera) -> Pinhole {
        Undistortion::new(camera).pinhole().resized(self.working_size(camera.size))
    }

    /// Reads, undistorts and resizes a view's photograph. Its mask combines the mask file, the
    /// alpha channel, what undistortion leaves empty, and what is too dark or too bright. The
    /// second value is a note for the user.
    ///
    /// # Errors
    /// If a file cannot be read or its size contradicts the camera's.
    pub fn load(&self, view: &View) -> Result<(Photo, Option<String>), VamvsError> {
        // An undistorted photograph is sampled at twice the size first.
        let samples = if view.camera.lens.distorts() { 2 } else { 1 };
        let needed = |photograph: Size| {
            let size = view.camera.of_photograph(photograph).size;
            let wanted = samples * self.working_size(size).longer_side();
            (wanted * photograph.longer_side()).div_ceil(size.longer_side())
        };
        let Taken { picture: Picture { image, mask }, camera, note } =
            self.origin.taken(view, &needed, self.stretch)?;
        let undistortion = Undistortion::new(&camera);
        let size = self.working_size(camera.size);
        let mask = undistortion.resized(camera.photograph_size(), size).mask(mask.as_ref());
        let image = undistorted(&undistortion, &camera, image, size);
        let foreground = (self.brightness != [0, 255]).then(|| foreground(&image, self.brightness));
        let photo = Photo {
            camera: undistortion.pinhole().resized(size),
            cam_from_world: view.cam_from_world,
            mask: both(mask, foreground),
            image,
        };
        Ok((photo, note))
    }

    /// The size of a photograph that is reduced or enlarged.
    pub(crate) fn working_size(&self, size: Size) -> Size {
        let ratio = self.ratio(size);
        let side = |side: usize| (side as f64 * ratio).round().max(1.0) as usize;
        Size::new(side(size.width), side(size.height))
    }

    /// Working size over the size of the photograph.
    fn ratio(&self, size: Size) -> f64 {
        let most = self.max_size as f64 / size.longer_side() as f64;
        let (own, enlarged) = (self.enlarge.min(most), self.enlarge_for_network.min(most));
        if enlarged < LEAST_ENLARGEMENT * own { own } else { enlarged }
    }
}

impl Origin {
    /// The picture of a view, of which as many pixels of the longer side are needed as `longer_side` says for a size.
    fn taken(
        &self,
        view: &View,
        longer_side: &dyn Fn(Size) -> usize,
        stretch: Option<Stretch>,
    ) -> Result<Taken, VamvsError> {
        match self {
            Self::Files { images, masks } => {
                let (loaded, camera) =
                    image::load_for_camera(&images.join(view.file()), &view.camera, longer_side, stretch)?;
                let mask = masks
                    .find(&view.file())
                    .map(|path| masks::load(&path, camera.photograph_size()))
                    .transpose()?;
                let picture = Picture { image: loaded.rgb, mask: both(mask, loaded.alpha_mask) };
                Ok(Taken { picture, camera, note: loaded.note })
            }
            Self::Program(source) => {
                let picture = source.picture(view).map_err(VamvsError::Photo)?;
                let expected = view.camera.photograph_size();
                expect_size("image", picture.image.size(), expected)?;
                picture.mask.iter().try_for_each(|mask| expect_size("mask", mask.size(), expected))?;
                Ok(Taken { picture, camera: view.camera, note: None })
            }
        }
    }
}

impl fmt::Debug for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Files { images, masks } => write!(f, "{} with {masks:?}", images.display()),
            Self::Program(_) => f.write_str("the program's own"),
        }
    }
}

fn expect_size(what: &str, found: Size, expected: Size) -> Result<(), VamvsError> {
    let text = || format!("expected {what} of the camera's size {expected}, got one of {found}");
    if found == expected { Ok(()) } else { Err(VamvsError::Request(text())) }
}

/// Adds the contents of a file to a hash, or the error if it cannot be read.
pub(crate) fn hash_file(path: &Path, hasher: &mut blake3::Hasher) {
    let read = std::fs::File::open(path).and_then(|file| hasher.update_reader(file).map(drop));
    if let Err(error) = read {
        hasher.update(error.to_string().as_bytes());
    }
}

/// The working cameras of all views of a scene.
#[must_use]
pub fn working_cameras(photographs: &Photographs, scene: &Scene) -> Vec<Pinhole> {
    let mut last: Option<(Camera, Pinhole)> = None;
    let working = |view: &View| match last {
        // Many views share a camera, and choosing the undistorted field of view takes some time.
        Some((camera, pinhole)) if camera == view.camera => pinhole,
        _ => last.insert((view.camera, photographs.working_camera(&view.camera))).1,
    };
    scene.views.iter().map(working).collect()
}

/// The undistorted photograph at `size`. A large one is first reduced, without aliasing, to twice
/// that size, so that at most four times the pixels of the result are undistorted.
fn undistorted(undistortion: &Undistortion, camera: &Camera, image: Grid<Rgb>, size: Size) -> Grid<Rgb> {
    if !undistortion.changes() {
        return resized(image, size);
    }
    // What the photograph, which may have been decoded at a part of its size, shows of the undistorted one.
    let shown = camera.of_photograph(image.size()).size;
    let twice = Size::new(2 * size.width, 2 * size.height);
    let is_large = twice.width < shown.width && twice.height < shown.height;
    let to = if is_large { twice } else { shown };
    let reduced = |side: usize, to: usize, shown: usize| (side * to).div_ceil(shown);
    let from = Size::new(
        reduced(image.width(), to.width, shown.width),
        reduced(image.height(), to.height, shown.height),
    );
    resized(undistortion.resized(from, to).image(&resized(image, from)), size)
}

fn resized(image: Grid<Rgb>, size: Size) -> Grid<Rgb> {
    if image.size() == size { image } else { image::resize(&image, size) }
}

/// Pixels with at least one channel ≥ `least` and at least one ≤ `most`.
fn foreground(image: &Grid<Rgb>, [least, most]: [u8; 2]) -> Grid<bool> {
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
    use vamvs_core::{Intrinsics, Lens};

    /// Undistorting at twice the size gives what undistorting the whole photograph gives.
    #[test]
    fn a_large_photograph_is_undistorted_as_if_whole() {
        let intrinsics = Intrinsics { fx: 900.0, fy: 900.0, cx: 600.0, cy: 400.0 };
        let lens = Lens::Rational { k: [-0.15, 0.02, 0.0, 0.0, 0.0, 0.0], p: [0.001, 0.0] };
        let camera = Camera { size: Size::new(1200, 800), intrinsics, lens };
        // Waves of 30 pixels, and edges.
        let grey = |x: usize, y: usize| {
            let wave = 60.0 * (x as f64 / 4.8).sin() * (y as f64 / 5.1).cos();
            (128.0 + wave + if (x / 90 + y / 70).is_multiple_of(2) { 50.0 } else { -50.0 }) as u8
        };
        let photograph = Grid::from_fn(camera.size, |x, y| [grey(x, y); 3]);
        let undistortion = Undistortion::new(&camera);
        let size = Size::new(300, 200);
        let expected = resized(undistortion.image(&photograph), size);
        let errors = |photograph: Grid<Rgb>| {
            let found = undistorted(&undistortion, &camera, photograph, size);
            let pairs = found.data().iter().zip(expected.data());
            let errors: Vec<u8> = pairs.map(|(a, b)| a[0].abs_diff(b[0])).collect();
            let mean = errors.iter().map(|&error| f64::from(error)).sum::<f64>() / errors.len() as f64;
            (mean, errors.iter().filter(|&&error| error > 8).count() as f64 / errors.len() as f64)
        };
        // As a JPEG may be decoded, at half of its size: then it is undistorted at that size.
        let half = resized(photograph.clone(), Size::new(600, 400));
        for (mean, off) in [errors(photograph), errors(half)] {
            assert!(mean < 1.0 && off < 0.01, "mean {mean}, share of errors > 8 of 255: {off}");
        }
    }

    #[test]
    fn large_photographs_are_reduced_and_small_ones_enlarged_up_to_the_size_asked_for() {
        let sized = |enlarge: f64, size: Size| {
            let options = DepthOptions { network_size: 1280, enlarge, ..DepthOptions::default() };
            Photographs::new(Path::new("images"), Masks::None, &options).working_size(size)
        };
        assert_eq!(sized(1.0, Size::new(3000, 2000)), Size::new(1280, 853));
        assert_eq!(sized(1.0, Size::new(480, 640)), Size::new(480, 640));
        assert_eq!(sized(2.0, Size::new(3000, 2000)), Size::new(1280, 853));
        assert_eq!(sized(2.0, Size::new(480, 640)), Size::new(960, 1280));
        assert_eq!(sized(2.0, Size::new(800, 600)), Size::new(1280, 960));
    }

    #[test]
    fn small_photographs_alone_are_enlarged_for_the_network() {
        let of = |enlarge: f64| {
            let options = DepthOptions { network_size: 1024, enlarge, ..DepthOptions::default() };
            Photographs::new(Path::new("images"), Masks::None, &options).enlarged_for_network(2.0)
        };
        let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 160.0, cy: 120.0 };
        // Own longer side; what the network sees, and what depth maps are refined to, as they are and with --enlarge 1.5.
        let expected = [
            (320, [640, 320], [640, 480]),
            (640, [1024, 640], [960, 960]),
            (900, [900, 900], [1024, 1350]),
            (3000, [1024, 2000], [1024, 2000]),
        ];
        for (own, as_it_is, enlarged) in expected {
            let size = Size::new(own, own / 2);
            let camera = Camera { size, intrinsics, lens: Lens::None };
            for (photographs, [seen, refined]) in [(of(1.0), as_it_is), (of(1.5), enlarged)] {
                let width = |photographs: &Photographs| photographs.working_size(size).width;
                assert_eq!([width(&photographs), width(&photographs.full())], [seen, refined], "of {own}");
                let by = photographs.enlarged_by(&camera);
                let smaller = width(&photographs.as_they_are()) as f64;
                assert!(
                    (by - seen as f64 / smaller).abs() < 0.01 && smaller <= refined as f64,
                    "{own}: {by}"
                );
            }
        }
    }
}
