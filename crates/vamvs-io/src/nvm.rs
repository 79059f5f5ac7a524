//! VisualSFM's `.nvm`, version 3.
//!
//! A camera is the image's name, focal length in pixels, rotation (a quaternion, camera from world), centre
//! and one radial coefficient r, which maps distorted to undistorted positions: a point seen at d, in focal
//! lengths from the image's centre, is at u = (1 + r|d|²) d without distortion.

use std::path::Path;

use nalgebra::Vector3;
use vamvs_core::{Camera, Intrinsics, Lens, Pose, Size, SparsePoint, View};

use crate::colmap::model::pose;
use crate::locate::{Located, locate, places, renumbered, sorted_by_name};
use crate::masks::Masks;
use crate::point_line::read_point;
use crate::sizes::stored_sizes;
use crate::text::{TextReader, WordReader};
use crate::{IoError, Loaded, Place, broken};

/// Reads the first model of the file `nvm`. Photographs are looked up in `images` or, without it, relative to the
/// file.
///
/// # Errors
/// If the file cannot be read or is malformed, holds no cameras, or half of the photographs are missing or of the cameras cannot be
/// used; views of fewer are left out, with a warning.
pub fn read_scene(nvm: &Path, images: Option<&Path>) -> Result<Loaded, IoError> {
    let Nvm { fixed, cameras, points, more } = read_nvm(nvm)?;
    if cameras.is_empty() {
        return Err(IoError::malformed(nvm, Place::Whole, "expected cameras, found none"));
    }
    let all = cameras.len();
    let (cameras, broken) = broken::leave_out(cameras)?;
    let (points, without_place) = broken::finite_points(points, |point| &point.x_in_world, nvm)?;
    let points = renumbered(points, &places(&cameras));
    let cameras: Vec<NvmCamera> = cameras.into_iter().flatten().collect();
    let named: Vec<String> = cameras.iter().map(|camera| camera.name.clone()).collect();
    let Located { folder, names, mut warnings } = locate(nvm, &named, images)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let sizes = stored_sizes(&folder, &names)?;
    let views = cameras.iter().zip(names.into_iter().zip(sizes));
    let views = views.map(|(camera, (name, size))| camera.view(name, size, fixed)).collect();
    let several = || format!("{}: it holds several models; only the first is read", nvm.display());
    warnings.extend(more.then(several));
    warnings.extend(broken::warning(&broken, all));
    warnings.extend(without_place);
    Ok(Loaded { scene: sorted_by_name(views, points), images: folder, masks: Masks::None, warnings, broken })
}

struct Nvm {
    /// The intrinsics of all cameras (`FixedK`), if the file has them.
    fixed: Option<Intrinsics>,
    /// Some may be broken; the points' views count them too.
    cameras: Vec<Result<NvmCamera, IoError>>,
    points: Vec<SparsePoint>,
    /// Whether more models follow.
    more: bool,
}

struct NvmCamera {
    name: String,
    focal: f64,
    cam_from_world: Pose,
    radial: f64,
}

impl NvmCamera {
    fn view(&self, name: &str, size: Size, fixed: Option<Intrinsics>) -> View {
        let Size { width, height } = size;
        let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
        let intrinsics = fixed.unwrap_or(Intrinsics { fx: self.focal, fy: self.focal, cx, cy });
        let camera = Camera { size, intrinsics, lens: lens(self.radial) };
        let cam_from_world = self.cam_from_world;
        View { id: 0, name: name.to_owned(), camera, cam_from_world, depth_range: None }
    }
}

/// The rational lens that maps an undistorted position u to the distorted d with u = (1 + r|d|²) d.
///
/// With t = r|u|², the solution is the series d/u = 1 − t + 3t² − 12t³ + 55t⁴ − 273t⁵ + 1428t⁶ …. Its Padé
/// approximant of degrees 3 and 3 has the form of [`Lens::Rational`]. The approximant's relative error is
/// below 2·10⁻⁵ for t from −0.09 to 0.2 and below 10⁻⁴ from −0.1 to 0.3. Real lenses seldom exceed this range,
/// and below −4/27 there is no solution.
fn lens(r: f64) -> Lens {
    if r == 0.0 {
        return Lens::None;
    }
    let powers = [r, r * r, r * r * r];
    let coefficient = |numerator: f64, power: usize| numerator / 13.0 * powers[power];
    let [n1, n2, n3] = [(113.0, 0), (243.0, 1), (85.0, 2)].map(|(n, power)| coefficient(n, power));
    let [d1, d2, d3] = [(126.0, 0), (330.0, 1), (193.0, 2)].map(|(d, power)| coefficient(d, power));
    Lens::Rational { k: [n1, n2, n3, d1, d2, d3], p: [0.0; 2] }
}

fn read_nvm(path: &Path) -> Result<Nvm, IoError> {
    let mut reader = TextReader::open(path)?;
    let fixed = read_header(&mut reader)?;
    let mut words = WordReader::new(reader);
    let count: usize = words.number("number of cameras")?;
    let cameras = (0..count).map(|_| read_camera(&mut words)).collect::<Result<_, _>>()?;
    let points: usize = words.optional_number("number of points")?.unwrap_or(0);
    let points = (0..points)
        .map(|_| read_point(&mut words, count, "list of measurements"))
        .collect::<Result<_, _>>()?;
    let more = words.next_word()?.is_some_and(|next| next.parse::<usize>().is_ok_and(|cameras| cameras > 0));
    Ok(Nvm { fixed, cameras, points, more })
}

/// Reads the line `NVM_V3`, which may go on with `FixedK fx cx fy cy`; these are returned.
fn read_header(reader: &mut TextReader) -> Result<Option<Intrinsics>, IoError> {
    let Some(line) = reader.next_line()? else { return Ok(None) };
    let mut words = line.words();
    let kind: String = words.word("kind of the file")?.chars().take(40).collect();
    if kind != "NVM_V3" {
        return Err(line.unsupported(format!("expected \"NVM_V3\", found {kind:?}")));
    }
    if words.next() != Some("FixedK") {
        return Ok(None);
    }
    let [fx, cx, fy, cy] = words.numbers("FixedK")?;
    let fixed =
        Intrinsics::try_new(fx, fy, cx, cy).map_err(|error| line.malformed(format!("FixedK: {error}")))?;
    Ok(Some(fixed))
}

/// A camera, or what is wrong with its numbers.
fn read_camera(words: &mut WordReader) -> Result<Result<NvmCamera, IoError>, IoError> {
    // VisualSFM writes a space in a name as a quotation mark.
    let name = words.next_word()?.map(|word| word.replace('"', " "));
    let name = name.ok_or_else(|| words.malformed("image name: missing, the file ends here"))?;
    let numbers = words.numbers("camera")?;
    Ok(camera(&name, numbers).map_err(|problem| words.malformed(format!("camera {name:?}: {problem}"))))
}

fn camera(name: &str, numbers: [f64; 10]) -> Result<NvmCamera, String> {
    let [focal, w, x, y, z, c0, c1, c2, radial, _zero] = numbers;
    if !(focal > 0.0 && focal.is_finite() && radial.is_finite()) {
        return Err(format!("expected a focal length and a distortion, found {focal} and {radial}"));
    }
    let rotation = pose([w, x, y, z], [0.0; 3])?.rotation;
    let translation = -(rotation * Vector3::new(c0, c1, c2));
    let cam_from_world = Pose::try_new(rotation, translation).map_err(|error| error.to_string())?;
    Ok(NvmCamera { name: name.to_owned(), focal, cam_from_world, radial })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn the_lens_undoes_the_measurement_distortion() {
        for (r, radius) in [(-0.2, 0.6), (0.3, 0.7), (0.05, 1.2), (-0.05, 1.0)] {
            for step in 1..=20 {
                let bent = Vector2::new(0.6, 0.8) * (radius * f64::from(step) / 20.0);
                let straight = bent * (1.0 + r * bent.norm_squared());
                let error = (lens(r).distort(&straight).unwrap() - bent).norm();
                assert!(error < 2e-5 * bent.norm(), "r {r}, |d| {}: {error}", bent.norm());
            }
        }
        assert_eq!(lens(0.0), Lens::None);
    }
}
