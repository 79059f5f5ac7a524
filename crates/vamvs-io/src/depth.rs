//! Depth maps, with the format chosen by the extension: `.pfm`, 16-bit grey `.png`, `.exr` and `.npy`.

use std::path::Path;

use ::image::DynamicImage;
use vamvs_core::{Grid, Size, depth_map};

use crate::{IoError, Place, exr, image, npy, pfm};

/// Largest PNG value that is a depth. 0 and 65535 both mean "no depth".
const LARGEST: u16 = u16::MAX - 1;

/// The extensions of depth maps, in lower case.
pub const EXTENSIONS: [&str; 4] = ["pfm", "npy", "exr", "png"];

/// Reads a depth map in scene units; pixels without a depth are 0.
///
/// `png_step` is the depth, in scene units, of one step of a 16-bit PNG (0.001 if the PNG is in
/// millimetres and the scene in metres). The other formats do not use it.
///
/// # Errors
/// If the file cannot be read, or is not in the format that its extension names.
pub fn read(path: &Path, png_step: f64) -> Result<Grid<f32>, IoError> {
    match Format::of(path)? {
        Format::Pfm => pfm::read_depth(path),
        Format::Png => read_png(path, png_step),
        Format::Exr => Ok(valid(exr::read(path)?)),
        Format::Npy => Ok(valid(npy::read(path)?)),
    }
}

/// Reads a confidence map, 0 to 1, whose numbers are not changed. A PNG of 8 or 16 bits has its largest value for 1.
///
/// # Errors
/// As [`read`].
pub fn read_confidence(path: &Path) -> Result<Grid<f32>, IoError> {
    match Format::of(path)? {
        Format::Pfm => pfm::read(path),
        Format::Exr => exr::read(path),
        Format::Npy => npy::read(path),
        Format::Png => {
            let grey = image::decode(path)?.into_luma16();
            let size = Size::new(grey.width() as usize, grey.height() as usize);
            Ok(Grid::from_vec(size, grey.into_raw()).map(|&value| f32::from(value) / f32::from(u16::MAX)))
        }
    }
}

/// The size of a depth map or confidence map. Of a PFM file the header is read, of others all.
///
/// # Errors
/// As [`read`].
pub fn stored_size(path: &Path) -> Result<Size, IoError> {
    match Format::of(path)? {
        Format::Pfm => pfm::stored_size(path, 1),
        Format::Png | Format::Exr | Format::Npy => Ok(read_confidence(path)?.size()),
    }
}

/// Numbers that are no depths become 0.
fn valid(mut depth: Grid<f32>) -> Grid<f32> {
    depth.data_mut().iter_mut().filter(|depth| !depth_map::is_valid(**depth)).for_each(|depth| *depth = 0.0);
    depth
}

/// Writes a depth map in scene units.
///
/// `png_step` is the depth, in scene units, of one step of a 16-bit PNG. The other formats do not use it.
///
/// # Errors
/// If the file cannot be written, or a depth of a PNG is not 1 to 65534 steps; then nothing has changed.
pub fn write(path: &Path, depth: &Grid<f32>, png_step: f64) -> Result<(), IoError> {
    match Format::of(path)? {
        Format::Pfm => pfm::write(path, depth),
        Format::Png => image::save_png_gray16(path, &quantized(path, depth, png_step)?),
        Format::Exr => exr::write(path, depth),
        Format::Npy => npy::write(path, depth),
    }
}

/// The file beside PNGs that holds the depth of one grey level, scene units.
pub const PNG_STEP_FILE: &str = "png-step.txt";

/// What [`PNG_STEP_FILE`] beside a depth map says; `None` if there is none, or the depth map is no PNG.
///
/// # Errors
/// If the file cannot be read, or holds no depth above 0.
pub fn png_step_beside(path: &Path) -> Result<Option<f64>, IoError> {
    let file = path.with_file_name(PNG_STEP_FILE);
    if !matches!(Format::of(path)?, Format::Png) || !file.is_file() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(&file).map_err(IoError::system("read", &file))?;
    let step = text.trim().parse().ok().filter(|step: &f64| step.is_finite() && *step > 0.0);
    let problem = "expected the depth of one grey level, above 0";
    step.map(Some).ok_or_else(|| IoError::malformed(&file, Place::Whole, problem))
}

/// Whether a depth can be written to a 16-bit PNG with steps of `png_step`; pixels without depth can.
#[must_use]
pub fn fits_png(depth: f32, png_step: f64) -> bool {
    !depth_map::is_valid(depth) || steps(depth, png_step).is_some()
}

/// The smallest step of a 16-bit PNG, 1, 2 or 5 times a power of ten, with which the depth `farthest` fits; 1 if that is no
/// depth.
#[must_use]
pub fn fitting_png_step(farthest: f64) -> f64 {
    if !(farthest > 0.0 && farthest.is_finite()) {
        return 1.0;
    }
    let least = farthest / f64::from(LARGEST);
    let exponent = least.log10().floor() as i32;
    let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| {
        // A division by an exact power of ten rounds to the literal 0.001; a product with 10⁻³ may not.
        if exponent < 0 { digit / 10f64.powi(-exponent) } else { digit * 10f64.powi(exponent) }
    });
    steps.into_iter().find(|&step| step >= least).unwrap_or(steps[3])
}

enum Format {
    Pfm,
    Png,
    Exr,
    Npy,
}

impl Format {
    fn of(path: &Path) -> Result<Self, IoError> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "pfm" => Ok(Self::Pfm),
            "png" => Ok(Self::Png),
            "exr" => Ok(Self::Exr),
            "npy" => Ok(Self::Npy),
            other => {
                let problem =
                    format!("expected a depth map's extension, .pfm, .png, .exr or .npy, found {other:?}");
                Err(IoError::unsupported(path, Place::Whole, problem))
            }
        }
    }
}

fn read_png(path: &Path, step: f64) -> Result<Grid<f32>, IoError> {
    let grey = match image::decode(path)? {
        DynamicImage::ImageLuma16(grey) => grey,
        other => {
            let problem = format!("expected 16-bit grey pixels of a depth map, found {:?}", other.color());
            return Err(IoError::unsupported(path, Place::Whole, problem));
        }
    };
    let size = Size::new(grey.width() as usize, grey.height() as usize);
    Ok(Grid::from_vec(size, grey.into_raw()).map(|&value| depth_of(value, step)))
}

fn depth_of(value: u16, step: f64) -> f32 {
    if value > LARGEST { 0.0 } else { (f64::from(value) * step) as f32 }
}

fn quantized(path: &Path, depth: &Grid<f32>, step: f64) -> Result<Grid<u16>, IoError> {
    let mut values = Vec::with_capacity(depth.size().area());
    for &depth in depth.data() {
        let value = if depth_map::is_valid(depth) { steps(depth, step) } else { Some(0) };
        values.push(value.ok_or_else(|| does_not_fit(path, depth, step))?);
    }
    Ok(Grid::from_vec(depth.size(), values))
}

fn steps(depth: f32, step: f64) -> Option<u16> {
    let value = (f64::from(depth) / step).round();
    (value >= 1.0 && value <= f64::from(LARGEST)).then_some(value as u16)
}

fn does_not_fit(path: &Path, depth: f32, step: f64) -> IoError {
    let problem = format!(
        "depth {depth} at {step} per step: expected 1 to {LARGEST} steps; choose another step, or write .pfm"
    );
    IoError::unsupported(path, Place::Whole, problem)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_formats_give_back_what_they_got() {
        let folder = tempfile::tempdir().unwrap();
        let depth = Grid::from_vec(Size::new(3, 2), vec![0.0, 0.001, 1.5, 2.25, 65.534, 0.0]);
        for name in ["d.pfm", "d.PNG", "d.exr", "d.npy"] {
            let path = folder.path().join(name);
            write(&path, &depth, 0.001).unwrap();
            assert_eq!(stored_size(&path).unwrap(), depth.size());
            assert_eq!(read(&path, 0.001).unwrap(), depth, "{name}");
        }
    }

    #[test]
    fn steps_are_round_and_the_farthest_depth_fits() {
        for (farthest, expected) in
            [(65.534, 0.001), (65.6, 0.002), (2.0, 5e-5), (500.0, 0.01), (1e7, 200.0), (0.0, 1.0)]
        {
            assert_eq!(fitting_png_step(farthest), expected, "{farthest}");
        }
    }

    #[test]
    fn the_step_beside_a_png_is_that_of_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let [png, pfm, file] = ["d.png", "d.pfm", PNG_STEP_FILE].map(|name| folder.path().join(name));
        assert_eq!(png_step_beside(&png).unwrap(), None);
        let write = |text: &str| crate::atomic::write(&file, |out| out.write_all(text.as_bytes())).unwrap();
        write("0.0005\n");
        assert_eq!((png_step_beside(&png).unwrap(), png_step_beside(&pfm).unwrap()), (Some(0.0005), None));
        for wrong in ["", "0", "-1", "NaN", "1 mm"] {
            write(wrong);
            let error = png_step_beside(&png).unwrap_err().to_string();
            assert!(error.contains(PNG_STEP_FILE), "{wrong:?}: {error}");
        }
    }

    #[test]
    fn numpy_arrays_have_their_header_and_rows_from_the_top() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.npy");
        write(&path, &Grid::from_vec(Size::new(3, 1), vec![1.0, 2.0, 3.0]), 1.0).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let (header, values) = bytes.split_at(128);
        assert!(header.starts_with(b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, "));
        assert!(header.ends_with(b" \n"));
        assert_eq!(values, [1f32, 2.0, 3.0].map(f32::to_le_bytes).concat());
    }

    #[test]
    fn pixels_without_depth_become_zero() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.png");
        let grey = Grid::from_vec(Size::new(3, 1), vec![0, 65535, 65534]);
        image::save_png_gray16(&path, &grey).unwrap();
        assert_eq!(read(&path, 2.0).unwrap().data(), [0.0, 0.0, 131_068.0]);
        let invalid = Grid::from_vec(Size::new(4, 1), vec![f32::NAN, f32::INFINITY, -1.0, 4.0]);
        for name in ["e.pfm", "e.png", "e.exr", "e.npy"] {
            let path = folder.path().join(name);
            write(&path, &invalid, 2.0).unwrap();
            assert_eq!(read(&path, 2.0).unwrap().data(), [0.0, 0.0, 0.0, 4.0]);
        }
    }

    #[test]
    fn depths_that_do_not_fit_and_other_pictures_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.png");
        for depth in [70.0, 0.0001] {
            let error = write(&path, &Grid::filled(Size::new(1, 1), depth), 0.001).unwrap_err();
            assert!(error.to_string().contains("per step"), "{error}");
            assert!(!path.exists());
        }
        image::save_png_rgb(&path, &Grid::filled(Size::new(2, 2), [1, 2, 3])).unwrap();
        assert!(read(&path, 1.0).unwrap_err().to_string().contains("Rgb8"));
        let error = read(&folder.path().join("d.tif"), 1.0).unwrap_err().to_string();
        assert!(error.contains(".pfm"), "{error}");
    }
}
