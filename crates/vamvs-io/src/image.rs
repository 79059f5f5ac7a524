//! Decodes photographs with EXIF orientation and alpha, matches them with their cameras, resizes and saves
//! images.
//!
//! **EXIF orientation.** A camera model was calibrated either on the pixels as stored (COLMAP, which
//! ignores the orientation tag) or on an upright copy. The camera's size decides: if the stored size is
//! the camera's, the pixels are used as stored; if only the rotated size is, they are rotated. Where both
//! sizes are equal (no rotation, a half turn, a square image), the pixels are used as stored.

use std::fs::{self, File};
use std::io::{self, BufReader, Cursor, Read, Write};
use std::path::Path;

use ::image::codecs::jpeg::JpegEncoder;
use ::image::codecs::png::PngEncoder;
use ::image::imageops::{self, FilterType};
use ::image::metadata::Orientation;
use ::image::{
    ColorType, DynamicImage, ExtendedColorType, ImageBuffer, ImageDecoder, ImageEncoder, ImageFormat,
    ImageReader, Limits,
};
use vamvs_core::{Camera, Grid, Rgb, Size};

use crate::{IoError, Place, atomic, jpeg};

/// Extensions of the formats that are decoded, in lower case.
pub(crate) const EXTENSIONS: [&str; 7] = ["jpg", "jpeg", "png", "tif", "tiff", "bmp", "webp"];

/// Limit, in bytes, of a decoded image and of an image file (358 million pixels of 8-bit RGB).
const MAX_BYTES: u64 = 1 << 30;

/// Largest relative difference between the aspect ratios of an image and its camera that is accepted.
const ASPECT_TOLERANCE: f64 = 0.01;

/// Smallest alpha at which a pixel is used.
const OPAQUE: u8 = 128;

/// How values of 16 bits become 8: linearly, from 0 at `low` to 255 at `high`, cut off beyond.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// The value that becomes 0.
    pub low: u16,
    /// The value that becomes 255, above `low`.
    pub high: u16,
}

impl Stretch {
    fn of(self, value: u16) -> u8 {
        let (value, length) = (value.clamp(self.low, self.high) - self.low, self.high - self.low);
        ((u32::from(value) * 255 + u32::from(length) / 2) / u32::from(length)) as u8
    }
}

/// A decoded photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedImage {
    /// The colours. Grey is repeated in all three channels, 16 bits are reduced to 8, alpha is dropped.
    pub rgb: Grid<Rgb>,
    /// Which pixels are at least half opaque; `None` if all are.
    pub alpha_mask: Option<Grid<bool>>,
    /// Whether the EXIF orientation was applied.
    pub exif_rotated: bool,
    /// A note for the user if the camera was resized to the image.
    pub note: Option<String>,
}

/// Decodes an image as its pixels are stored.
///
/// # Errors
/// If the file cannot be read, is truncated or corrupt, is none of JPEG, PNG, TIFF, BMP and WebP, or
/// would decode to more than 1 GiB.
pub fn load(path: &Path) -> Result<LoadedImage, IoError> {
    Ok(convert(decode(path)?, false, None))
}

/// The colours of an image as its pixels are stored.
///
/// # Errors
/// As [`load`].
pub fn load_rgb(path: &Path) -> Result<Grid<Rgb>, IoError> {
    Ok(load(path)?.rgb)
}

/// Decodes the image of `camera` and returns it with the camera at the image's size.
///
/// The EXIF orientation is applied if the image agrees with the camera only then (see the module's text). An
/// image of another size with the same aspect ratio (within 1 %) keeps its size; the camera is resized, and
/// a note says so.
///
/// `longer_side` tells how many pixels of the longer side of an image of a size are needed. A JPEG that has at least
/// twice as many is decoded at 1/2, 1/4 or 1/8 of its size where that divides both sides; the camera is that of the
/// whole image all the same. `stretch` applies to images of 16 bits; without it their upper 8 bits are taken.
///
/// # Errors
/// As [`load`], and if the image has neither the size nor the aspect ratio of the camera.
pub fn load_for_camera(
    path: &Path,
    camera: &Camera,
    longer_side: &dyn Fn(Size) -> usize,
    stretch: Option<Stretch>,
) -> Result<(LoadedImage, Camera), IoError> {
    let Decoded { mut image, stored, orientation } = decode_at_least(path, longer_side)?;
    let Some(size) = fitting_size(stored, orientation, camera.photograph_size()) else {
        let (path, expected) = (path.to_owned(), camera.photograph_size());
        return Err(IoError::SizeMismatch { path, image: stored, of: "camera", expected });
    };
    let rotate = size != stored;
    if rotate {
        image.apply_orientation(orientation);
    }
    let mut loaded = convert(image, rotate, stretch);
    let stated = camera.photograph_size();
    loaded.note = (size != stated).then(|| resized_note(path, size, stated));
    Ok((loaded, camera.of_photograph(size)))
}

/// The stored or the upright size of an image (upright by its EXIF orientation): the one that equals the
/// camera's size, or else the one that has the camera's aspect ratio; the stored one if both do.
fn fitting_size(stored: Size, orientation: Orientation, camera: Size) -> Option<Size> {
    let sideways = turns_sideways(orientation);
    let upright = if sideways { Size::new(stored.height, stored.width) } else { stored };
    let find = |fits: fn(Size, Size) -> bool| [stored, upright].into_iter().find(|&size| fits(size, camera));
    find(|size, camera| size == camera).or_else(|| find(aspect_agrees))
}

fn resized_note(path: &Path, image: Size, camera: Size) -> String {
    format!(
        "{}: the photograph has {image} pixels, its camera is for {camera}: the camera was scaled to the photograph",
        path.display()
    )
}

/// The size of an image as stored, in pixels, read from its header.
///
/// # Errors
/// If the file cannot be read, is not an image of a known format, or has no pixels.
pub fn stored_size(path: &Path) -> Result<Size, IoError> {
    let open = || File::open(path).map(BufReader::new).map_err(IoError::system("open", path));
    let read = IoError::system("read", path);
    let reader = ImageReader::new(open()?).with_guessed_format().map_err(read)?;
    if reader.format() == Some(ImageFormat::Jpeg)
        && let Ok(Some(size)) = jpeg::size(&mut open()?)
    {
        return require_pixels(path, size);
    }
    let dimensions = reader.into_dimensions();
    let (width, height) = dimensions.map_err(|error| match beginning(path) {
        Ok(bytes) => unreadable(path, &bytes, error),
        Err(error) => error,
    })?;
    require_pixels(path, Size::new(width as usize, height as usize))
}

fn require_pixels(path: &Path, size: Size) -> Result<Size, IoError> {
    if size.area() > 0 {
        return Ok(size);
    }
    Err(IoError::malformed(path, Place::Whole, format!("expected an image with pixels, found {size}")))
}

/// The image resized to `size` by cubic (Catmull-Rom) interpolation, with a low-pass filter where it is
/// reduced.
#[must_use]
pub fn resize(image: &Grid<Rgb>, size: Size) -> Grid<Rgb> {
    let [width, height, to_width, to_height] =
        [image.width(), image.height(), size.width, size.height].map(|side| side as u32);
    let view: ImageBuffer<::image::Rgb<u8>, &[u8]> =
        ImageBuffer::from_raw(width, height, image.data().as_flattened())
            .expect("a grid holds one value a pixel");
    let resized = imageops::resize(&view, to_width, to_height, FilterType::CatmullRom);
    rgb_grid(size, resized.into_raw())
}

/// Saves an 8-bit colour PNG.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn save_png_rgb(path: &Path, image: &Grid<Rgb>) -> Result<(), IoError> {
    save_png(path, image.data().as_flattened(), image.size(), ExtendedColorType::Rgb8)
}

/// Saves an 8-bit grey PNG.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn save_png_gray8(path: &Path, image: &Grid<u8>) -> Result<(), IoError> {
    save_png(path, image.data(), image.size(), ExtendedColorType::L8)
}

/// Saves a 16-bit grey PNG.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn save_png_gray16(path: &Path, image: &Grid<u16>) -> Result<(), IoError> {
    let bytes: Vec<u8> = image.data().iter().flat_map(|value| value.to_ne_bytes()).collect();
    save_png(path, &bytes, image.size(), ExtendedColorType::L16)
}

/// The bytes of an 8-bit colour PNG.
#[must_use]
pub fn png_rgb(image: &Grid<Rgb>) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode_png(&mut bytes, image.data().as_flattened(), image.size(), ExtendedColorType::Rgb8)
        .expect("memory takes all that is written, and a grid holds one value a pixel");
    bytes
}

/// The bytes of a JPEG of `quality`, 1 to 100.
#[must_use]
pub fn jpeg_rgb(image: &Grid<Rgb>, quality: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode(
            image.data().as_flattened(),
            image.width() as u32,
            image.height() as u32,
            ExtendedColorType::Rgb8,
        )
        .expect("memory takes all that is written, and a grid holds one value a pixel");
    bytes
}

fn save_png(path: &Path, bytes: &[u8], size: Size, color: ExtendedColorType) -> Result<(), IoError> {
    atomic::write(path, |out: &mut dyn Write| encode_png(out, bytes, size, color))
}

fn encode_png(out: &mut dyn Write, bytes: &[u8], size: Size, color: ExtendedColorType) -> io::Result<()> {
    PngEncoder::new(out)
        .write_image(bytes, size.width as u32, size.height as u32, color)
        .map_err(io::Error::other)
}

/// Decodes a file by the format of its content; the extension is ignored.
pub(crate) fn decode(path: &Path) -> Result<DynamicImage, IoError> {
    Ok(decode_at_least(path, &|_| usize::MAX)?.image)
}

/// Decodes a file; a JPEG at a reduced size if its longer side then still has as many pixels as `longer_side` asks of
/// an image of its size.
fn decode_at_least(path: &Path, longer_side: &dyn Fn(Size) -> usize) -> Result<Decoded, IoError> {
    let bytes = read_limited(path)?;
    let format = ::image::guess_format(&bytes).map_err(|error| unreadable(path, &bytes, error))?;
    if format == ImageFormat::Jpeg && !jpeg::is_complete(&bytes) {
        let problem = "expected an end-of-image marker, found the end of the file; the JPEG is truncated";
        return Err(IoError::malformed(path, Place::Byte(bytes.len() as u64), problem));
    }
    let decoded =
        decode_bytes(&bytes, format, longer_side).map_err(|error| unreadable(path, &bytes, error))?;
    require_pixels(path, decoded.stored)?;
    Ok(decoded)
}

/// An image, perhaps at a reduced size, with what its file says of it.
struct Decoded {
    image: DynamicImage,
    stored: Size,
    orientation: Orientation,
}

fn decode_bytes(
    bytes: &[u8],
    format: ImageFormat,
    longer_side: &dyn Fn(Size) -> usize,
) -> ::image::ImageResult<Decoded> {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_BYTES);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits.clone());
    let mut decoder = reader.into_decoder()?;
    limits.reserve(decoder.total_bytes())?;
    let (width, height) = decoder.dimensions();
    let stored = Size::new(width as usize, height as usize);
    let orientation = decoder.orientation()?;
    let reduced = (format == ImageFormat::Jpeg).then(|| jpeg::reduced(bytes, stored, longer_side(stored)));
    let image = match reduced.flatten() {
        Some(image) => image,
        None => DynamicImage::from_decoder(decoder)?,
    };
    Ok(Decoded { image, stored, orientation })
}

fn read_limited(path: &Path) -> Result<Vec<u8>, IoError> {
    let about = fs::metadata(path).map_err(IoError::system("open", path))?;
    if !about.is_file() {
        let problem = "expected an image file, found something else, such as a folder or a pipe";
        return Err(IoError::unsupported(path, Place::Whole, problem));
    }
    let length = about.len();
    if length > MAX_BYTES {
        let problem = format!("expected an image file of at most {MAX_BYTES} bytes, found {length}");
        return Err(IoError::unsupported(path, Place::Whole, problem));
    }
    fs::read(path).map_err(IoError::system("read", path))
}

/// The error of a file that cannot be decoded: what it is, if that is known, and what to do.
fn unreadable(path: &Path, bytes: &[u8], source: ::image::ImageError) -> IoError {
    let is_unsupported = matches!(source, ::image::ImageError::Unsupported(_));
    let found = match foreign_format(bytes) {
        Some(format) => format,
        None if is_unsupported && (bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*")) => {
            "a TIFF of other values than 8 or 16 bits of grey or of red, green and blue (floating point, more bands), or a raw photograph"
        }
        None => return refused(path)(source),
    };
    let problem = format!(
        "expected JPEG, PNG, TIFF, BMP or WebP, found {found}: convert the photographs, as with `magick mogrify -format jpg *`; their \
         names may keep the old extensions in the scene"
    );
    IoError::unsupported(path, Place::Whole, problem)
}

/// The name of a format of photographs that is not read.
fn foreign_format(bytes: &[u8]) -> Option<&'static str> {
    let brand = bytes.get(4..8).filter(|kind| *kind == b"ftyp").and_then(|_| bytes.get(8..12));
    match brand {
        Some(b"heic" | b"heix" | b"heim" | b"heis" | b"hevc" | b"hevx" | b"mif1" | b"msf1") => Some("HEIC"),
        Some(b"avif" | b"avis") => Some("AVIF"),
        Some(b"crx ") => Some("a raw photograph (CR3)"),
        Some(_) => Some("a video"),
        None if bytes.starts_with(b"\xff\x0a") || bytes.starts_with(b"\0\0\0\x0cJXL ") => Some("JPEG XL"),
        None if bytes.starts_with(b"\0\0\0\x0cjP  ") => Some("JPEG 2000"),
        None if bytes.starts_with(b"FUJIFILMCCD-RAW") => Some("a raw photograph (RAF)"),
        None if bytes.get(8..10) == Some(b"CR") => Some("a raw photograph (CR2)"),
        None if bytes.starts_with(b"GIF8") => Some("GIF"),
        None if bytes.starts_with(b"v/1\x01") => Some("OpenEXR"),
        None => None,
    }
}

/// The first bytes of a file.
fn beginning(path: &Path) -> Result<Vec<u8>, IoError> {
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(64).read_to_end(&mut bytes));
    read.map_err(IoError::system("read", path))?;
    Ok(bytes)
}

fn refused(path: &Path) -> impl FnOnce(::image::ImageError) -> IoError {
    move |source| IoError::Image { path: path.to_owned(), source }
}

fn convert(image: DynamicImage, exif_rotated: bool, stretch: Option<Stretch>) -> LoadedImage {
    let size = size_of(&image);
    let alpha_mask = image.color().has_alpha().then(|| alpha_mask(&image)).flatten();
    let bytes = match stretch.filter(|_| has_16_bits(image.color())) {
        Some(stretch) => image.into_rgb16().into_raw().into_iter().map(|value| stretch.of(value)).collect(),
        None => image.into_rgb8().into_raw(),
    };
    LoadedImage { rgb: rgb_grid(size, bytes), alpha_mask, exif_rotated, note: None }
}

fn has_16_bits(colour: ColorType) -> bool {
    matches!(colour, ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16)
}

/// An even sample of at most about `most` of an image's values, all channels alike, if they have 16 bits; of others the file's beginning
/// alone is read.
///
/// # Errors
/// As [`load`].
pub fn values_of_16_bits(path: &Path, most: usize) -> Result<Option<Vec<u16>>, IoError> {
    let file = File::open(path).map(BufReader::new).map_err(IoError::system("open", path))?;
    let reader = ImageReader::new(file).with_guessed_format().map_err(IoError::system("read", path))?;
    if !has_16_bits(reader.into_decoder().map_err(refused(path))?.color_type()) {
        return Ok(None);
    }
    let values = decode(path)?.into_rgb16().into_raw();
    let step = values.len().div_ceil(most.max(1)).max(1);
    // Steps of whole pixels and one channel: all channels come in turn.
    let step = if step.is_multiple_of(3) { step + 1 } else { step };
    Ok(Some(values.into_iter().step_by(step).collect()))
}

fn alpha_mask(image: &DynamicImage) -> Option<Grid<bool>> {
    let mask: Vec<bool> = image.to_rgba8().pixels().map(|pixel| pixel.0[3] >= OPAQUE).collect();
    (!mask.iter().all(|&counts| counts)).then(|| Grid::from_vec(size_of(image), mask))
}

/// A grid in the memory of its bytes.
fn rgb_grid(size: Size, bytes: Vec<u8>) -> Grid<Rgb> {
    Grid::from_vec(size, bytemuck::cast_slice_box(bytes.into_boxed_slice()).into_vec())
}

pub(crate) fn size_of(image: &DynamicImage) -> Size {
    Size::new(image.width() as usize, image.height() as usize)
}

fn turns_sideways(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(orientation, Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH)
}

/// Whether two sizes may be those of one image at different resolutions: their aspect ratios differ by at
/// most 1 %.
pub(crate) fn aspect_agrees(a: Size, b: Size) -> bool {
    let ratio = (a.width * b.height) as f64 / (a.height * b.width) as f64;
    (ratio - 1.0).abs() <= ASPECT_TOLERANCE
}
