//! `cameras.txt`, `images.txt` (two lines per image, of which the second may be empty or missing), `points3D.txt`.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

use nalgebra::Vector2;
use vamvs_core::Camera;

use super::camera;
use super::model::{self, Image, Keypoints, Model, Observation, Point};
use crate::text::{Line, TextReader};
use crate::{IoError, atomic};

/// Reads the text model in `folder`.
pub(super) fn read(folder: &Path, keypoints: Keypoints) -> Result<Model, IoError> {
    let points = folder.join("points3D.txt");
    let cameras = read_cameras(&folder.join("cameras.txt"))?;
    let file = folder.join("images.txt");
    let images = read_images(&file, keypoints)?;
    let points = if points.is_file() { read_points(&points)? } else { Vec::new() };
    Model::of_usable(cameras, images, points, &file)
}

/// Writes a text model into `folder`.
pub(super) fn write(model: &Model, folder: &Path) -> Result<(), IoError> {
    atomic::write(&folder.join("cameras.txt"), |out| {
        model.cameras.iter().try_for_each(|(id, camera)| write_camera(out, *id, camera))
    })?;
    atomic::write(&folder.join("images.txt"), |out| {
        model.images.iter().try_for_each(|image| write_image(out, image))
    })?;
    atomic::write(&folder.join("points3D.txt"), |out| {
        model.points.iter().try_for_each(|point| write_point(out, point))
    })
}

/// The cameras by id, or what is wrong with their numbers.
fn read_cameras(path: &Path) -> Result<BTreeMap<u32, Result<Camera, IoError>>, IoError> {
    let mut reader = TextReader::open(path)?;
    let mut cameras = BTreeMap::new();
    while let Some(line) = reader.next_entry()? {
        let (id, camera) = parse_camera(line)?;
        if cameras.insert(id, camera).is_some() {
            return Err(line.malformed(format!("camera {id} occurs twice")));
        }
    }
    Ok(cameras)
}

/// A camera and its id; what is wrong with its numbers is apart from other errors.
fn parse_camera(line: Line) -> Result<(u32, Result<Camera, IoError>), IoError> {
    let mut words = line.words();
    let id: u32 = words.number("camera id")?;
    let about = |problem: String| format!("camera {id}: {problem}");
    let name = words.word("camera model")?;
    let model = camera::by_name(name).map_err(|problem| line.unsupported(about(problem)))?;
    let size = camera::size(words.number("image width")?, words.number("image height")?);
    let mut parameters = Vec::with_capacity(model.parameters);
    for _ in 0..model.parameters {
        parameters.push(words.number("camera parameter")?);
    }
    if let Some(word) = words.next() {
        let expected = model.parameters;
        let problem = about(format!("{name} has {expected} parameters, found {word:?} after them"));
        return Err(line.malformed(problem));
    }
    let camera = size.and_then(|size| camera::camera(model, size, &parameters));
    Ok((id, camera.map_err(|problem| line.malformed(about(problem)))))
}

/// The images, or what is wrong with their poses.
fn read_images(path: &Path, keypoints: Keypoints) -> Result<Vec<Result<Image, IoError>>, IoError> {
    let mut reader = TextReader::open(path)?;
    let mut images: Vec<Result<Image, IoError>> = Vec::new();
    let mut has_keypoints = true;
    while let Some(line) = reader.next_line()? {
        match images.last_mut() {
            Some(image) if !has_keypoints && !is_image(line) => {
                has_keypoints = true;
                let Ok(image) = image else { continue };
                let count = count_observations(line, image)?;
                if keypoints == Keypoints::Read {
                    image.observations = parse_observations(line, count)?;
                }
            }
            _ if line.is_comment() => {}
            _ => {
                images.push(parse_image(line)?);
                has_keypoints = false;
            }
        }
    }
    Ok(images)
}

/// Whether a line where keypoints are expected is the next image's instead: some writers leave the second lines out. Keypoints end with
/// the number of a point, images with a name.
fn is_image(line: Line) -> bool {
    let mut words = line.words();
    let numbers = words.by_ref().take(9).filter(|word| word.parse::<f64>().is_ok()).count();
    let name = words.last();
    numbers == 9 && name.is_some_and(|name| name.parse::<f64>().is_err())
}

/// Reads an image's first line; what is wrong with its pose is apart from other errors. The name is the rest of the line, because
/// it may contain spaces.
fn parse_image(line: Line) -> Result<Result<Image, IoError>, IoError> {
    let mut words = line.words();
    let id = words.number("image id")?;
    let quaternion = words.numbers::<4>("rotation")?;
    let translation = words.numbers::<3>("translation")?;
    let camera_id = words.number("camera id")?;
    let name = words.rest().to_owned();
    Ok(match model::pose(quaternion, translation) {
        Ok(cam_from_world) => Ok(Image { id, name, camera_id, cam_from_world, observations: Vec::new() }),
        Err(problem) => Err(line.malformed(format!("image {id} ({name:?}): {problem}"))),
    })
}

/// The number of keypoints on an image's second line.
fn count_observations(line: Line, image: &Image) -> Result<usize, IoError> {
    let words = line.words().count();
    if words.is_multiple_of(3) {
        return Ok(words / 3);
    }
    let problem = format!(
        "{image}: expected the keypoints `x y point-id …` on the line after the image's (it may be empty), found {words} words"
    );
    Err(line.malformed(problem))
}

fn parse_observations(line: Line, count: usize) -> Result<Vec<Observation>, IoError> {
    let mut words = line.words();
    let mut observations = Vec::with_capacity(count);
    for _ in 0..count {
        let pixel = Vector2::from(words.numbers::<2>("keypoint")?);
        let point_id: i64 = words.number("point id")?;
        observations.push(Observation { pixel, point_id: u64::try_from(point_id).ok() });
    }
    Ok(observations)
}

fn read_points(path: &Path) -> Result<Vec<Point>, IoError> {
    let mut reader = TextReader::open(path)?;
    let mut points = Vec::new();
    while let Some(line) = reader.next_entry()? {
        points.push(parse_point(line)?);
    }
    Ok(points)
}

fn parse_point(line: Line) -> Result<Point, IoError> {
    let mut words = line.words();
    let id = words.number("point id")?;
    let x_in_world = words.numbers::<3>("position")?.into();
    let rgb = [words.number("red")?, words.number("green")?, words.number("blue")?];
    let error = words.number("reprojection error")?;
    let mut track = Vec::new();
    while !words.rest().is_empty() {
        track.push((words.number("track's image id")?, words.number("track's keypoint")?));
    }
    Ok(Point { id, x_in_world, rgb, error, track })
}

fn write_camera(out: &mut dyn Write, id: u32, camera: &Camera) -> io::Result<()> {
    let (model, parameters) = camera::parameters(camera);
    let parameters = join(&parameters);
    writeln!(out, "{id} {} {} {} {parameters}", model.name, camera.size.width, camera.size.height)
}

fn write_image(out: &mut dyn Write, image: &Image) -> io::Result<()> {
    let rotation = join(&model::quaternion(&image.cam_from_world));
    let translation = join(image.cam_from_world.translation.as_slice());
    writeln!(out, "{} {rotation} {translation} {} {}", image.id, image.camera_id, image.name)?;
    for (i, Observation { pixel, point_id }) in image.observations.iter().enumerate() {
        let separator = if i == 0 { "" } else { " " };
        write!(out, "{separator}{} {} ", pixel.x, pixel.y)?;
        match point_id {
            Some(id) => write!(out, "{id}")?,
            None => write!(out, "-1")?,
        }
    }
    writeln!(out)
}

fn write_point(out: &mut dyn Write, point: &Point) -> io::Result<()> {
    let position = join(point.x_in_world.as_slice());
    write!(out, "{} {position} {} {}", point.id, join(&point.rgb), point.error)?;
    point.track.iter().try_for_each(|(image, keypoint)| write!(out, " {image} {keypoint}"))?;
    writeln!(out)
}

fn join(values: &[impl Display]) -> String {
    values.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}
