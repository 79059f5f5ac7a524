//! `cameras.bin`, `images.bin`, `points3D.bin`: little-endian, each list preceded by its length (u64).

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use nalgebra::Vector2;
use vamvs_core::Camera;

use super::camera;
use super::model::{self, Image, Keypoints, Model, Observation, Point};
use crate::bytes::ByteReader;
use crate::{IoError, atomic};

/// The point id of a keypoint without a triangulated point.
const NO_POINT: u64 = u64::MAX;

/// Least size of a camera in bytes: id, model, width, height and two parameters.
const CAMERA_BYTES: u64 = 4 + 4 + 8 + 8 + 2 * 8;

/// Least size of an image in bytes: id, pose, camera id, the zero byte after its name, number of keypoints.
const IMAGE_BYTES: u64 = 4 + 7 * 8 + 4 + 1 + 8;

/// Size of a keypoint in bytes: x, y, point id.
const OBSERVATION_BYTES: u64 = 3 * 8;

/// Least size of a point in bytes: id, position, colour, error, track length.
const POINT_BYTES: u64 = 8 + 3 * 8 + 3 + 8 + 8;

/// Size of a track's entry in bytes: image id, keypoint's index.
const TRACK_BYTES: u64 = 2 * 4;

/// Reads the binary model in `folder`.
pub(super) fn read(folder: &Path, keypoints: Keypoints) -> Result<Model, IoError> {
    let points = folder.join("points3D.bin");
    let image = |file: &mut ByteReader| read_image(file, keypoints);
    let cameras = read_cameras(&folder.join("cameras.bin"))?;
    let file = folder.join("images.bin");
    let images = read_list(&file, IMAGE_BYTES, "images", image)?;
    let points = match points.is_file() {
        true => read_list(&points, POINT_BYTES, "points", read_point)?,
        false => Vec::new(),
    };
    Model::of_usable(cameras, images, points, &file)
}

/// Writes a binary model into `folder`.
pub(super) fn write(model: &Model, folder: &Path) -> Result<(), IoError> {
    atomic::write(&folder.join("cameras.bin"), |out| {
        out.write_all(&(model.cameras.len() as u64).to_le_bytes())?;
        model.cameras.iter().try_for_each(|(id, camera)| write_camera(out, *id, camera))
    })?;
    atomic::write(&folder.join("images.bin"), |out| write_list(out, &model.images, write_image))?;
    atomic::write(&folder.join("points3D.bin"), |out| write_list(out, &model.points, write_point))
}

fn read_list<T>(
    path: &Path,
    entry_bytes: u64,
    what: &str,
    read_entry: impl Fn(&mut ByteReader) -> Result<T, IoError>,
) -> Result<Vec<T>, IoError> {
    let mut file = ByteReader::open(path)?;
    let count = file.count(entry_bytes, what)?;
    let mut entries = Vec::with_capacity(count);
    for _ in 0..count {
        entries.push(read_entry(&mut file)?);
    }
    Ok(entries)
}

/// The cameras by id, or what is wrong with their numbers.
fn read_cameras(path: &Path) -> Result<BTreeMap<u32, Result<Camera, IoError>>, IoError> {
    let mut file = ByteReader::open(path)?;
    let mut cameras = BTreeMap::new();
    for _ in 0..file.count(CAMERA_BYTES, "cameras")? {
        let position = file.position();
        let (id, camera) = read_camera(&mut file)?;
        if cameras.insert(id, camera).is_some() {
            return Err(file.malformed(position, format!("camera {id} occurs twice")));
        }
    }
    Ok(cameras)
}

/// A camera and its id; what is wrong with its numbers is apart from other errors.
fn read_camera(file: &mut ByteReader) -> Result<(u32, Result<Camera, IoError>), IoError> {
    let position = file.position();
    let id = file.u32("camera id")?;
    let about = |problem: String| format!("camera {id}: {problem}");
    let model = camera::by_id(file.i32("camera model")?)
        .map_err(|problem| file.unsupported(position, about(problem)))?;
    let (width, height) = (file.u64("image width")?, file.u64("image height")?);
    let mut parameters = Vec::with_capacity(model.parameters);
    for _ in 0..model.parameters {
        parameters.push(file.f64("camera parameter")?);
    }
    let camera = camera::size(width, height).and_then(|size| camera::camera(model, size, &parameters));
    Ok((id, camera.map_err(|problem| file.malformed(position, about(problem)))))
}

/// An image; what is wrong with its pose is apart from other errors.
fn read_image(file: &mut ByteReader, keypoints: Keypoints) -> Result<Result<Image, IoError>, IoError> {
    let position = file.position();
    let id = file.u32("image id")?;
    let (quaternion, translation) = (file.f64s("rotation")?, file.f64s("translation")?);
    let camera_id = file.u32("camera id")?;
    let name = file.name("image name")?;
    let cam_from_world = model::pose(quaternion, translation)
        .map_err(|problem| file.malformed(position, format!("image {id} ({name:?}): {problem}")));
    let count = file.count(OBSERVATION_BYTES, "keypoints")?;
    let observations = match keypoints {
        Keypoints::Read => (0..count).map(|_| read_observation(file)).collect::<Result<_, _>>()?,
        Keypoints::Skip => {
            file.skip(count as u64 * OBSERVATION_BYTES, "keypoints")?;
            Vec::new()
        }
    };
    Ok(cam_from_world.map(|cam_from_world| Image { id, name, camera_id, cam_from_world, observations }))
}

fn read_observation(file: &mut ByteReader) -> Result<Observation, IoError> {
    let pixel = Vector2::from(file.f64s::<2>("keypoint")?);
    let point_id = file.u64("point id")?;
    Ok(Observation { pixel, point_id: (point_id != NO_POINT).then_some(point_id) })
}

fn read_point(file: &mut ByteReader) -> Result<Point, IoError> {
    let id = file.u64("point id")?;
    let x_in_world = file.f64s::<3>("position")?.into();
    let rgb = file.take("colour")?;
    let error = file.f64("reprojection error")?;
    let count = file.count(TRACK_BYTES, "track")?;
    let mut track = Vec::with_capacity(count);
    for _ in 0..count {
        track.push((file.u32("track's image id")?, file.u32("track's keypoint")?));
    }
    Ok(Point { id, x_in_world, rgb, error, track })
}

fn write_list<T>(
    out: &mut dyn Write,
    entries: &[T],
    write_entry: impl Fn(&mut dyn Write, &T) -> io::Result<()>,
) -> io::Result<()> {
    out.write_all(&(entries.len() as u64).to_le_bytes())?;
    entries.iter().try_for_each(|entry| write_entry(out, entry))
}

fn write_camera(out: &mut dyn Write, id: u32, camera: &Camera) -> io::Result<()> {
    let (model, parameters) = camera::parameters(camera);
    out.write_all(&id.to_le_bytes())?;
    out.write_all(&model.id.to_le_bytes())?;
    out.write_all(&(camera.size.width as u64).to_le_bytes())?;
    out.write_all(&(camera.size.height as u64).to_le_bytes())?;
    write_f64s(out, &parameters)
}

fn write_image(out: &mut dyn Write, image: &Image) -> io::Result<()> {
    out.write_all(&image.id.to_le_bytes())?;
    write_f64s(out, &model::quaternion(&image.cam_from_world))?;
    write_f64s(out, image.cam_from_world.translation.as_slice())?;
    out.write_all(&image.camera_id.to_le_bytes())?;
    out.write_all(image.name.as_bytes())?;
    out.write_all(&[0])?;
    write_list(out, &image.observations, |out, Observation { pixel, point_id }| {
        write_f64s(out, pixel.as_slice())?;
        out.write_all(&point_id.unwrap_or(NO_POINT).to_le_bytes())
    })
}

fn write_point(out: &mut dyn Write, point: &Point) -> io::Result<()> {
    out.write_all(&point.id.to_le_bytes())?;
    write_f64s(out, point.x_in_world.as_slice())?;
    out.write_all(&point.rgb)?;
    write_f64s(out, &[point.error])?;
    write_list(out, &point.track, |out, (image, keypoint)| {
        out.write_all(&image.to_le_bytes())?;
        out.write_all(&keypoint.to_le_bytes())
    })
}

fn write_f64s(out: &mut dyn Write, values: &[f64]) -> io::Result<()> {
    values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
}
