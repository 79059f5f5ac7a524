//! Bundler's `bundle.out` v0.3 with its list of images.
//!
//! A camera is `f k1 k2`, R and t, camera from world. Its frame has x to the right and y up; it looks along
//! −z. With p = −(x, y)/z, a point of that frame is seen f (1 + k₁|p|² + k₂|p|⁴) p pixels from the image's
//! centre, y up. The list names the images in the order of the cameras, one per line.

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Camera, Intrinsics, Lens, Pose, Size, SparsePoint, View};

use crate::locate::{Located, locate, places, renumbered, sorted_by_name};
use crate::masks::Masks;
use crate::point_line::read_point;
use crate::sizes::stored_sizes;
use crate::text::{TextReader, WordReader};
use crate::{IoError, Loaded, Place, broken};

/// Reads the scene of the file `bundle`. Cameras with focal length 0 were not registered and are left out.
///
/// The list of images is `NAME.list.txt` (for `NAME.bundle.out` or `NAME.out`) or else `list.txt`. It is
/// looked up first in the file's folder, then in the folder above. Photographs are looked up in `images` or,
/// without it, relative to the list.
///
/// # Errors
/// If a file cannot be read or is malformed, there is no list of images or it has another length than the
/// list of cameras, or half of the photographs are missing or of the cameras cannot be used; views of fewer are left out, with a
/// warning.
pub fn read_scene(bundle: &Path, images: Option<&Path>) -> Result<Loaded, IoError> {
    let list = list_of(bundle)?;
    let named = read_list(&list)?;
    let Bundle { cameras, points } = read_bundle(bundle, named.len())?;
    let (points, without_place) = broken::finite_points(points, |point| &point.x_in_world, bundle)?;
    let (all, points) = (cameras.len(), renumbered(points, &places(&cameras)));
    let registered: Vec<_> =
        named.into_iter().zip(cameras).filter_map(|(name, camera)| Some((name, camera?))).collect();
    if registered.is_empty() {
        let problem = "expected registered cameras, found none with a focal length other than 0";
        return Err(IoError::malformed(bundle, Place::Whole, problem));
    }
    let unregistered = all - registered.len();
    let (kept, broken) =
        broken::leave_out(registered.into_iter().map(|(name, camera)| Ok((name, camera?))).collect())?;
    let points = renumbered(points, &places(&kept));
    let kept: Vec<(String, BundleCamera)> = kept.into_iter().flatten().collect();
    let names: Vec<String> = kept.iter().map(|(name, _)| name.clone()).collect();
    let Located { folder, names, mut warnings } = locate(&list, &names, images)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let sizes = stored_sizes(&folder, &names)?;
    let views = kept.iter().zip(names.into_iter().zip(sizes));
    let views = views.map(|((_, camera), (name, size))| camera.view(name, size)).collect();
    warnings.extend(broken::warning(&broken, all));
    warnings.extend(without_place);
    let warning = format!("{unregistered} of {all} cameras were not registered and are left out");
    warnings.extend((unregistered > 0).then_some(warning));
    Ok(Loaded { scene: sorted_by_name(views, points), images: folder, masks: Masks::None, warnings, broken })
}

/// The file's content. Cameras that were not registered are `None`, others may be broken; the points' views count them all.
struct Bundle {
    cameras: Vec<Option<Result<BundleCamera, IoError>>>,
    points: Vec<SparsePoint>,
}

struct BundleCamera {
    focal: f64,
    k: [f64; 2],
    cam_from_world: Pose,
}

impl BundleCamera {
    /// The view, with the principal point at the image's centre.
    fn view(&self, name: &str, size: Size) -> View {
        let Size { width, height } = size;
        let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
        let intrinsics = Intrinsics { fx: self.focal, fy: self.focal, cx, cy };
        let lens = Lens::Rational { k: [self.k[0], self.k[1], 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
        let lens = if lens.distorts() { lens } else { Lens::None };
        let camera = Camera { size, intrinsics, lens };
        let cam_from_world = self.cam_from_world;
        View { id: 0, name: name.to_owned(), camera, cam_from_world, depth_range: None }
    }
}

fn list_of(bundle: &Path) -> Result<PathBuf, IoError> {
    let name = bundle.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".bundle.out").or(name.strip_suffix(".out")).unwrap_or(&name);
    let beside = |list: &str| bundle.with_file_name(list);
    let above = |list: &str| bundle.parent().unwrap_or(Path::new("")).join("..").join(list);
    let own = format!("{stem}.list.txt");
    let candidates = [beside(&own), beside("list.txt"), above(&own), above("list.txt")];
    candidates.into_iter().find(|list| list.is_file()).ok_or_else(|| {
        let problem =
            format!("expected its list of images {own} or list.txt beside it or in the folder above");
        IoError::malformed(bundle, Place::Whole, problem)
    })
}

/// The image names of a list. A name may be followed by `0 FOCAL`, as Bundler writes it.
fn read_list(path: &Path) -> Result<Vec<String>, IoError> {
    let text = fs::read_to_string(path).map_err(IoError::system("read", path))?;
    let text = text.trim_start_matches('\u{feff}');
    let name = |line: &str| {
        let mut parts = line.rsplitn(3, char::is_whitespace);
        let mut number = || parts.next().is_some_and(|part| part.parse::<f64>().is_ok());
        let numbers = number() && number();
        parts.next().filter(|_| numbers).unwrap_or(line).trim().to_owned()
    };
    Ok(text.lines().map(str::trim).filter(|line| !line.is_empty()).map(name).collect())
}

fn read_bundle(path: &Path, listed: usize) -> Result<Bundle, IoError> {
    let mut reader = TextReader::open(path)?;
    let header = reader.next_line()?;
    if let Some(line) = header.filter(|line| line.text.trim() != "# Bundle file v0.3") {
        let found: String = line.text.chars().take(40).collect();
        return Err(line.unsupported(format!("expected \"# Bundle file v0.3\", found {found:?}")));
    }
    let mut words = WordReader::new(reader);
    let (cameras, points): (usize, usize) =
        (words.number("number of cameras")?, words.number("number of points")?);
    if cameras != listed {
        return Err(words.malformed(format!("{cameras} cameras, but the list of images has {listed}")));
    }
    let cameras = (0..cameras).map(|_| read_camera(&mut words)).collect::<Result<_, _>>()?;
    let points = (0..points).map(|_| read_point(&mut words, listed, "view list"));
    Ok(Bundle { cameras, points: points.collect::<Result<_, _>>()? })
}

/// A camera, or what is wrong with its numbers; `None` if it was not registered.
fn read_camera(words: &mut WordReader) -> Result<Option<Result<BundleCamera, IoError>>, IoError> {
    let [focal, k1, k2] = words.numbers("focal length and distortion")?;
    let rotation = Matrix3::from_row_slice(&words.numbers::<9>("rotation")?);
    let translation = Vector3::from(words.numbers::<3>("translation")?);
    if focal == 0.0 {
        return Ok(None);
    }
    let camera = camera([focal, k1, k2], rotation, translation);
    Ok(Some(camera.map_err(|problem| words.malformed(problem))))
}

fn camera(
    [focal, k1, k2]: [f64; 3],
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
) -> Result<BundleCamera, String> {
    if !(focal > 0.0 && [focal, k1, k2].iter().all(|value| value.is_finite())) {
        return Err(format!("expected a focal length and distortions, found {focal} {k1} {k2}"));
    }
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let cam_from_world =
        Pose::try_new(flip * rotation, flip * translation).map_err(|error| error.to_string())?;
    Ok(BundleCamera { focal, k: [k1, k2], cam_from_world })
}
