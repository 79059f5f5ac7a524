//! Reads a scene of camera files, images with the same stems, and an optional `pair.txt`.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use vamvs_core::{Camera, Lens, Scene, Size, View};

use super::cam::{Cam, Options, read_cam};
use super::pair::{Pairs, read_pairs};
use crate::masks::Masks;
use crate::sizes::stored_sizes;
use crate::{IoError, Loaded, Place, broken, folder, names};

/// The end of camera files' names.
const SUFFIX: &str = "_cam.txt";

/// Reads the scene of all camera files `STEM_cam.txt` in `cams`, each with the image `STEM.*` in `images`.
///
/// A view's number is the last run of digits in its stem (`00000012`, `frame-12`). If these numbers are
/// missing or not unique, it is the index in the order of names. Without `pairs`, a `pair.txt` in `cams` or in
/// the folder above is read; if there is none, [`Scene::pairs`] is `None`.
///
/// # Errors
/// If half of the camera files cannot be read or are malformed (views of fewer are left out, with a warning), half of the images
/// are missing, one is not unique, or there are no camera files.
pub fn read_scene(
    cams: &Path,
    images: &Path,
    pairs: Option<&Path>,
    options: &Options,
) -> Result<Loaded, IoError> {
    let cam_folder = cams;
    let all = cam_files(cam_folder)?;
    let (read, broken) = broken::leave_out(all.values().map(|path| read_cam(path, options)).collect())?;
    let all_ids = view_ids(all.keys());
    let (mut ids, mut cam_files, mut cams) = (Vec::new(), BTreeMap::new(), Vec::new());
    for ((&id, (stem, path)), cam) in all_ids.iter().zip(all).zip(read) {
        let Some(cam) = cam else { continue };
        ids.push(id);
        cam_files.insert(stem, path);
        cams.push(cam);
    }
    let found = folder::images(images)?;
    let (names, mut warnings) = match_images(images, &cam_files, &found)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let sizes = stored_sizes(images, &names)?;
    warnings.extend(broken::warning(&broken, all_ids.len()));
    warnings.extend(warn_of_depth_lines(&cam_files, &cams));
    warnings.extend(fit_to_photographs(cam_folder, &mut cams, &sizes));
    let mut views = Vec::with_capacity(names.len());
    for ((path, cam), (&name, (&size, &id))) in
        cam_files.values().zip(&cams).zip(names.iter().zip(sizes.iter().zip(&ids)))
    {
        warnings.extend(off_centre(path, cam, size));
        views.push(view(id, name, cam, size));
    }
    warnings.extend(folder::warn_of_unused(&found, names.iter().copied()));
    let pair_file = pairs.map(Path::to_owned).or_else(|| pair_file_near(cam_folder));
    let pairs = pair_file.as_deref().map(|path| read_pairs(path, &ids)).transpose()?;
    let unknown = pairs.iter().flat_map(|pairs| &pairs.unknown).find(|number| !all_ids.contains(number));
    if let (Some(path), Some(unknown)) = (&pair_file, unknown)
        && !are_of_stems(cam_files.keys(), &ids)
    {
        // The file may count from 1, and all its numbers mean other views.
        let last = all_ids.len() - 1;
        let problem = format!(
            "expected numbers from 0 to {last}, in the order of the camera files, whose names have no numbers of their own; found {unknown}"
        );
        return Err(IoError::malformed(path, Place::Whole, problem));
    }
    warnings.extend(pair_file.zip(pairs.as_ref()).and_then(|(path, pairs)| warn_of_unknown(&path, pairs)));
    let scene = Scene { views, points: Vec::new(), pairs: pairs.map(|pairs| pairs.sources) };
    Ok(Loaded { scene, images: images.to_owned(), masks: Masks::None, warnings, broken })
}

fn view(id: u32, name: &str, cam: &Cam, size: Size) -> View {
    View {
        id,
        name: name.to_owned(),
        camera: Camera { size, intrinsics: cam.intrinsics, lens: Lens::None },
        cam_from_world: cam.cam_from_world,
        depth_range: cam.depth_range,
    }
}

/// The camera files of a folder by stem.
fn cam_files(cams: &Path) -> Result<BTreeMap<String, PathBuf>, IoError> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(cams).map_err(IoError::system("list", cams))? {
        let path = entry.map_err(IoError::system("list", cams))?.path();
        let stem = path.file_name().and_then(|name| name.to_str()?.strip_suffix(SUFFIX));
        if let Some(stem) = stem.map(str::to_owned) {
            files.insert(stem, path);
        }
    }
    if files.is_empty() {
        let problem = format!("expected camera files named STEM{SUFFIX}, found none");
        return Err(IoError::malformed(cams, Place::Whole, problem));
    }
    Ok(files)
}

/// The image of each camera, in the order of the cameras: the one with the same stem, or the only one with nearly the same; and
/// warnings about that. An image that is missing is called like its camera.
fn match_images(
    folder: &Path,
    cam_files: &BTreeMap<String, PathBuf>,
    found: &BTreeSet<String>,
) -> Result<(Vec<String>, Vec<String>), IoError> {
    let mut by_stem: BTreeMap<&str, &str> = BTreeMap::new();
    for name in found {
        let stem = name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem);
        if let Some(other) = by_stem.insert(stem, name)
            && cam_files.contains_key(stem)
        {
            let problem = format!("expected one image for the camera {stem:?}, found {other:?} and {name:?}");
            return Err(IoError::malformed(folder, Place::Whole, problem));
        }
    }
    let (mut missing, mut renamed) = (Vec::new(), Vec::new());
    let mut images = Vec::with_capacity(cam_files.len());
    for stem in cam_files.keys() {
        images.push(match (by_stem.get(stem.as_str()), names::near(found, stem)) {
            (Some(name), _) => (*name).to_owned(),
            (None, Some(near)) => {
                renamed.push((stem.clone(), near.to_owned()));
                near.to_owned()
            }
            (None, None) => {
                missing.push(stem.as_str());
                stem.clone()
            }
        });
    }
    expect_known_format(folder, &missing)?;
    let mut warnings: Vec<String> =
        folder::warn_of_those_missing(folder, &missing, cam_files.len())?.into_iter().collect();
    warnings.extend(names::warn_of_renamed(folder, &renamed));
    Ok((images, warnings))
}

/// A warning about depth lines that were guessed or not used: the first one's, and how many there are.
fn warn_of_depth_lines(cam_files: &BTreeMap<String, PathBuf>, cams: &[Cam]) -> Option<String> {
    let mut warned =
        cam_files.values().zip(cams).filter_map(|(path, cam)| Some((path, cam.warning.as_ref()?)));
    let (path, warning) = warned.next()?;
    let others = match warned.count() {
        0 => String::new(),
        count => format!(" (and {count} more)"),
    };
    Some(format!("{}: {warning}{others}", path.display()))
}

/// Principal points that lie this much off the middle, as a factor, are those of photographs of another size.
const ANOTHER_SIZE: f64 = 1.2;

/// How far single ones may be from the common factor, and the share of the views that must have it.
const COMMON: (f64, f64) = (1.05, 0.8);

/// Scales cameras that were made for photographs of another size: their principal points lie away from the middle by one
/// common factor in both directions in most views. Returns a warning.
fn fit_to_photographs(folder: &Path, cams: &mut [Cam], sizes: &[Size]) -> Option<String> {
    let factors = |(cam, size): (&Cam, &Size)| {
        [2.0 * cam.intrinsics.cx / size.width as f64, 2.0 * cam.intrinsics.cy / size.height as f64]
    };
    let all: Vec<[f64; 2]> = cams.iter().zip(sizes).map(factors).collect();
    let mut sorted: Vec<f64> = all.iter().flatten().copied().collect();
    sorted.sort_by(f64::total_cmp);
    let factor = sorted.get(sorted.len() / 2).copied().filter(|factor| *factor > 0.0)?;
    let is_common =
        |factors: &&[f64; 2]| factors.iter().all(|one| (1.0 / COMMON.0..=COMMON.0).contains(&(one / factor)));
    let common = all.iter().filter(is_common).count() as f64 >= COMMON.1 * all.len() as f64;
    if !common || (1.0 / ANOTHER_SIZE..=ANOTHER_SIZE).contains(&factor) {
        return None;
    }
    for cam in cams.iter_mut() {
        cam.intrinsics = cam.intrinsics.scaled(1.0 / factor, 1.0 / factor);
    }
    let Size { width, height } = sizes[0];
    let made = [width, height].map(|side| (side as f64 * factor).round());
    Some(format!(
        "{}: the cameras were made for photographs of about {}×{} pixels (principal points lie at {factor:.3} of the middle), and were scaled to those of {width}×{height}; intrinsics of the photographs' own size avoid this",
        folder.display(),
        made[0],
        made[1]
    ))
}

/// Fails if a file of a missing image is there but of a format that cannot be read.
fn expect_known_format(folder: &Path, missing: &[&str]) -> Result<(), IoError> {
    let Some(first) = missing.first() else { return Ok(()) };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files = entries.map(|entry| entry.path()).filter(|path| path.is_file());
    let Some(path) = files.find(|path| path.file_stem().is_some_and(|stem| stem == *first)) else {
        return Ok(());
    };
    let problem = "expected an image as JPEG, PNG, TIFF, BMP or WebP, found another extension: convert it";
    Err(IoError::unsupported(&path, Place::Whole, problem))
}

/// The view number of each stem: its last run of digits. If a stem has none, or they are not unique or do not fit
/// 32 bits, all numbers are indices in the given order.
pub fn view_ids<'a>(stems: impl Iterator<Item = &'a String> + Clone) -> Vec<u32> {
    let numbers: Option<Vec<u32>> = stems.clone().map(|stem| last_number(stem)).collect();
    let unique = |ids: &Vec<u32>| ids.iter().collect::<HashSet<_>>().len() == ids.len();
    numbers.filter(unique).unwrap_or_else(|| (0..).zip(stems).map(|(order, _)| order).collect())
}

/// Whether the numbers that [`view_ids`] gives are those of the stems, not indices.
fn are_of_stems(stems: impl Iterator<Item = impl AsRef<str>>, ids: &[u32]) -> bool {
    stems.zip(ids).all(|(stem, &id)| last_number(stem.as_ref()) == Some(id))
}

fn last_number(stem: &str) -> Option<u32> {
    let is_digit = |c: char| c.is_ascii_digit();
    stem.split(|c| !is_digit(c)).rfind(|run| !run.is_empty())?.parse().ok()
}

fn pair_file_near(cams: &Path) -> Option<PathBuf> {
    let beside = cams.join("..").join("pair.txt");
    [cams.join("pair.txt"), beside].into_iter().find(|path| path.is_file())
}

/// A warning that a `pair.txt` names views without cameras, if it does.
fn warn_of_unknown(path: &Path, pairs: &Pairs) -> Option<String> {
    let (first, count) = (pairs.unknown.first()?, pairs.unknown.len());
    Some(format!("{}: {count} of the views have no camera file and are not used ({first} …)", path.display()))
}

/// A warning if the principal point is outside the image, which means that the camera file was probably made for
/// another image size.
fn off_centre(path: &Path, cam: &Cam, size: Size) -> Option<String> {
    let (cx, cy) = (cam.intrinsics.cx, cam.intrinsics.cy);
    let inside = (0.0..size.width as f64).contains(&cx) && (0.0..size.height as f64).contains(&cy);
    (!inside).then(|| {
        let path = path.display();
        format!("{path}: the principal point ({cx}, {cy}) is outside of the {size} image; is the camera file for another image size?")
    })
}
