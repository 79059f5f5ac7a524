//! The scene file `.mvs`: `MVSI`, a version, then lists, each preceded by its length (u64). They are platforms
//! with cameras and poses, images, points with the images that see them, normals, colours and, from version 1
//! on, lines and a transform. What follows the points is written but not read.

use std::io::{self, Write};
use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Camera, CloudPoint, Intrinsics, Lens, Pinhole, Pose, Size, SparsePoint, View};

use super::{calibration, f32_bytes, f64_bytes, rotation_and_centre};
use crate::bytes::ByteReader;
use crate::locate::{Located, locate, places, renumbered, sorted_by_name};
use crate::masks::Masks;
use crate::sizes::sizes;
use crate::{IoError, Loaded, Place, atomic, broken};

/// The version that is written. Later ones only add fields for which vamvs has no data, such as band and mask
/// names and view scores.
const VERSION: u32 = 3;

/// The last version that is read.
const LAST_VERSION: u32 = 7;

/// The index that stands for "none".
const NONE: u32 = u32::MAX;

/// A point with the numbers of the views that see it.
pub type ObservedPoint = (CloudPoint, Vec<u32>);

/// Reads a scene. Photographs are looked up in `images` or, without it, relative to the file; they must be
/// undistorted. Images without a pose are left out.
///
/// # Errors
/// If the file cannot be read or is malformed, is not an interface file (`MVSI`) but another type of OpenMVS
/// archive, has no image with a pose, or half of the photographs are missing or of the poses cannot be used; views of fewer are left
/// out, with a warning.
pub fn read_scene(mvs: &Path, images: Option<&Path>) -> Result<Loaded, IoError> {
    let mut file = ByteReader::open(mvs)?;
    if &file.take::<4>("kind of the file")? != b"MVSI" {
        let problem = "expected an interface file that begins with \"MVSI\"; export one with OpenMVS's --archive-type -1";
        return Err(file.unsupported(0, problem));
    }
    let version = file.u32("version")?;
    file.u32("reserved")?;
    if version > LAST_VERSION {
        return Err(file.unsupported(4, format!("expected version {LAST_VERSION} or less, found {version}")));
    }
    let mut reader = SceneReader { file, version };
    let platforms = reader.list(24, "platforms", SceneReader::platform)?;
    let listed = reader.list(20, "images", SceneReader::image)?;
    let points = reader.list(20, "points", |reader| reader.point(listed.len()))?;
    let (points, without_place) = broken::finite_points(points, |point| &point.x_in_world, mvs)?;
    let all = listed.len();
    let listed: Vec<_> = listed.into_iter().map(|image| Some(image).filter(MvsImage::has_pose)).collect();
    let points = renumbered(points, &places(&listed));
    let posed: Vec<MvsImage> = listed.into_iter().flatten().collect();
    if posed.is_empty() {
        return Err(IoError::malformed(mvs, Place::Whole, "expected images with poses, found none"));
    }
    let named: Vec<String> = posed.iter().map(|image| image.name.clone()).collect();
    let Located { folder, names, mut warnings } = locate(mvs, &named, images)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let stated: Vec<_> = posed.iter().map(|image| image.camera(&platforms)?.size).collect();
    let sizes = sizes(&folder, &names, &stated)?;
    let view = |(image, (name, size)): (&MvsImage, _)| image.view(mvs, &platforms, name, size);
    let views = posed.iter().zip(names.into_iter().zip(sizes)).map(view);
    let (views, broken) = broken::leave_out(views.collect())?;
    let points = renumbered(points, &places(&views));
    let left_out = all - posed.len();
    let warning = format!("{left_out} of {all} images have no pose and are left out");
    warnings.extend((left_out > 0).then_some(warning));
    warnings.extend(broken::warning(&broken, all));
    warnings.extend(without_place);
    let scene = sorted_by_name(views.into_iter().flatten().collect(), points);
    Ok(Loaded { scene, images: folder, masks: Masks::None, warnings, broken })
}

/// Writes a scene of undistorted views and of points. Each view is its photograph's path relative to the file, its
/// camera and its pose, camera from world.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write_scene(
    path: &Path,
    views: &[(String, Pinhole, Pose)],
    points: &[ObservedPoint],
) -> Result<(), IoError> {
    atomic::write(path, |out| {
        out.write_all(b"MVSI")?;
        out.write_all(&[VERSION.to_le_bytes(), [0; 4]].concat())?;
        write_list(out, views, |out, (_, camera, pose)| write_platform(out, camera, pose))?;
        write_count(out, views.len())?;
        for (view, (name, ..)) in (0u32..).zip(views) {
            write_text(out, name)?;
            // Indices of platform, camera and pose, and the image's own number.
            out.write_all(&[view, 0, 0, view].map(u32::to_le_bytes).concat())?;
        }
        write_points(out, points)?;
        // Three empty lists, of lines, their normals and their colours; then the transform, the identity.
        (0..3).try_for_each(|_| write_count(out, 0))?;
        let identity: [f64; 16] = std::array::from_fn(|i| f64::from(u8::from(i % 5 == 0)));
        out.write_all(&f64_bytes(&identity))
    })
}

fn write_platform(out: &mut dyn Write, camera: &Pinhole, cam_from_world: &Pose) -> io::Result<()> {
    let identity = rotation_and_centre(&Pose::identity());
    write_text(out, "")?;
    write_count(out, 1)?;
    write_text(out, "")?;
    out.write_all(&[camera.size.width, camera.size.height].map(|side| (side as u32).to_le_bytes()).concat())?;
    out.write_all(&f64_bytes(&calibration(&camera.intrinsics)))?;
    out.write_all(&[f64_bytes(&identity.0), f64_bytes(&identity.1)].concat())?;
    let (rotation, centre) = rotation_and_centre(cam_from_world);
    write_count(out, 1)?;
    out.write_all(&[f64_bytes(&rotation), f64_bytes(&centre)].concat())
}

fn write_points(out: &mut dyn Write, points: &[ObservedPoint]) -> io::Result<()> {
    write_list(out, points, |out, (point, views)| {
        out.write_all(&f32_bytes(&point.x_in_world.map(|value| value as f32)))?;
        write_list(out, views, |out, view| {
            out.write_all(&[view.to_le_bytes(), point.confidence.to_le_bytes()].concat())
        })
    })?;
    write_list(out, points, |out, (point, _)| out.write_all(&f32_bytes(&point.normal)))?;
    write_list(out, points, |out, (point, _)| {
        let [red, green, blue] = point.colour;
        out.write_all(&[blue, green, red])
    })
}

fn write_list<T>(
    out: &mut dyn Write,
    entries: &[T],
    write_entry: impl Fn(&mut dyn Write, &T) -> io::Result<()>,
) -> io::Result<()> {
    write_count(out, entries.len())?;
    entries.iter().try_for_each(|entry| write_entry(out, entry))
}

fn write_count(out: &mut dyn Write, count: usize) -> io::Result<()> {
    out.write_all(&(count as u64).to_le_bytes())
}

fn write_text(out: &mut dyn Write, text: &str) -> io::Result<()> {
    write_count(out, text.len())?;
    out.write_all(text.as_bytes())
}

struct Platform {
    cameras: Vec<MvsCamera>,
    poses: Vec<MvsPose>,
}

struct MvsCamera {
    /// The image's size; if `None`, K is in units of the image's longer side, see [`in_pixels`].
    size: Option<Size>,
    k: Matrix3<f64>,
    cam_from_platform: MvsPose,
}

/// A pose, or what is wrong with it.
type MvsPose = Result<Pose, String>;

struct MvsImage {
    name: String,
    platform: u32,
    camera: u32,
    pose: u32,
}

impl MvsImage {
    fn has_pose(&self) -> bool {
        self.pose != NONE
    }

    fn camera<'a>(&self, platforms: &'a [Platform]) -> Option<&'a MvsCamera> {
        platforms.get(self.platform as usize)?.cameras.get(self.camera as usize)
    }

    fn view(&self, mvs: &Path, platforms: &[Platform], name: &str, size: Size) -> Result<View, IoError> {
        let malformed =
            |problem: String| IoError::malformed(mvs, Place::Whole, format!("image {name:?}: {problem}"));
        let platform = platforms.get(self.platform as usize);
        let platform_from_world = platform.and_then(|platform| platform.poses.get(self.pose as usize));
        let (Some(camera), Some(platform_from_world)) = (self.camera(platforms), platform_from_world) else {
            return Err(malformed("its platform, camera or pose does not exist".to_owned()));
        };
        let intrinsics =
            Intrinsics::try_from_matrix(&camera.k).map_err(|error| malformed(error.to_string()))?;
        let intrinsics = match camera.size {
            Some(_) => intrinsics.cropped(-0.5, -0.5),
            None => in_pixels(&intrinsics, size),
        };
        let camera_in_pixels = Camera { size, intrinsics, lens: Lens::None };
        let pose = |pose: &MvsPose| {
            pose.clone().map_err(|problem| {
                malformed(format!(
                    "expected a pose, a rotation and a centre, but {problem}; export the scene again"
                ))
            })
        };
        let cam_from_world = pose(&camera.cam_from_platform)?.compose(&pose(platform_from_world)?);
        Ok(View { id: 0, name: name.to_owned(), camera: camera_in_pixels, cam_from_world, depth_range: None })
    }
}

/// Intrinsics that are stored in units of the image's longer side. OpenMVS has done so in two ways: with its own pixel
/// centres, at integers, so that a principal point in the middle of the longer side is 0.5; and, in newer versions, with 0.5
/// subtracted, so that it is 0.
fn in_pixels(stored: &Intrinsics, size: Size) -> Intrinsics {
    let side = size.longer_side() as f64;
    let along_it = if size.width >= size.height { stored.cx } else { stored.cy };
    let shift = if along_it < 0.25 { 0.5 * side } else { 0.5 };
    stored.scaled(side, side).cropped(-shift, -shift)
}

struct SceneReader {
    file: ByteReader,
    version: u32,
}

impl SceneReader {
    /// Reads a list of entries of at least `entry_bytes` bytes each.
    fn list<T>(
        &mut self,
        entry_bytes: u64,
        what: &str,
        mut entry: impl FnMut(&mut Self) -> Result<T, IoError>,
    ) -> Result<Vec<T>, IoError> {
        let count = self.file.count(entry_bytes, what)?;
        (0..count).map(|_| entry(self)).collect()
    }

    fn text(&mut self, what: &str) -> Result<String, IoError> {
        let position = self.file.position();
        let bytes = self.list(1, what, |reader| Ok(reader.file.take::<1>(what)?[0]))?;
        String::from_utf8(bytes).map_err(|_| self.file.malformed(position, format!("{what}: expected UTF-8")))
    }

    fn platform(&mut self) -> Result<Platform, IoError> {
        self.text("platform name")?;
        Ok(Platform {
            cameras: self.list(8 + 21 * 8, "cameras", Self::camera)?,
            poses: self.list(12 * 8, "poses", Self::pose)?,
        })
    }

    fn camera(&mut self) -> Result<MvsCamera, IoError> {
        self.text("camera name")?;
        if self.version > 3 {
            self.text("band name")?;
        }
        let mut size = None;
        if self.version > 0 {
            let (width, height) = (self.file.u32("image width")?, self.file.u32("image height")?);
            size = (width > 0 && height > 0).then(|| Size::new(width as usize, height as usize));
        }
        let k = Matrix3::from_row_slice(&self.file.f64s::<9>("calibration")?);
        Ok(MvsCamera { size, k, cam_from_platform: self.pose()? })
    }

    /// Reads a rotation and a centre.
    fn pose(&mut self) -> Result<MvsPose, IoError> {
        let rotation = Matrix3::from_row_slice(&self.file.f64s::<9>("rotation")?);
        let centre = Vector3::from(self.file.f64s::<3>("centre")?);
        Ok(Pose::try_new(rotation, -(rotation * centre)).map_err(|error| error.to_string()))
    }

    fn image(&mut self) -> Result<MvsImage, IoError> {
        let name = self.text("image name")?;
        if self.version > 4 {
            self.text("mask name")?;
        }
        let [platform, camera, pose] = [
            self.file.u32("image's platform")?,
            self.file.u32("image's camera")?,
            self.file.u32("image's pose")?,
        ];
        if self.version > 2 {
            self.file.u32("image number")?;
        }
        if self.version > 6 {
            self.file.take::<12>("depth range")?;
            self.list(24, "view scores", |reader| reader.file.take::<24>("view score"))?;
        }
        Ok(MvsImage { name, platform, camera, pose })
    }

    fn point(&mut self, images: usize) -> Result<SparsePoint, IoError> {
        let bytes: [u8; 12] = self.file.take("point")?;
        let coordinate = |i: usize| f64::from(f32::from_le_bytes(std::array::from_fn(|j| bytes[4 * i + j])));
        let x_in_world = Vector3::from_fn(|i, _| coordinate(i));
        let views = self.list(8, "views of a point", |reader| {
            let position = reader.file.position();
            let image = reader.file.u32("view of a point")?;
            reader.file.u32("confidence of a view")?;
            if image as usize >= images {
                let problem = format!("view of a point: expected an image below {images}, found {image}");
                return Err(reader.file.malformed(position, problem));
            }
            Ok(image as usize)
        })?;
        Ok(SparsePoint { x_in_world, views })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_principal_point_in_units_of_the_longer_side_is_read_in_both_ways() {
        let stored = |cx, cy| Intrinsics { fx: 1.25, fy: 1.25, cx, cy };
        let centred = |width, height| Intrinsics { fx: 10.0, fy: 10.0, cx: 0.5 * width, cy: 0.5 * height };
        // The middle of 8×6 pixels is at 3.5 and 2.5 where the first pixel's centre is at 0.
        let size = Size::new(8, 6);
        assert_eq!(in_pixels(&stored(3.5 / 8.0, 2.5 / 8.0), size), centred(8.0, 6.0));
        assert_eq!(in_pixels(&stored(0.0, 3.0 / 8.0 - 0.5), size), centred(8.0, 6.0));
        let upright = Size::new(2, 8);
        assert_eq!(in_pixels(&stored(0.5 / 8.0, 3.5 / 8.0), upright), centred(2.0, 8.0));
        assert_eq!(in_pixels(&stored(1.0 / 8.0 - 0.5, 0.0), upright), centred(2.0, 8.0));
    }
}
