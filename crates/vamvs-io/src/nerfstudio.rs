//! nerfstudio's `transforms.json`, also as written by instant-ngp and in the NeRF data sets.
//!
//! Camera fields are global or per frame; those of the frame take precedence. They are `fl_x fl_y cx cy w h`
//! or `camera_angle_x`, and the distortion: `k1 k2 k3 p1 p2` of a perspective camera or `k1 … k4` of a
//! fisheye; a photograph of all directions has none. A missing size is read from the image file.
//! `transform_matrix` is world from camera, with the camera in OpenGL's axes (x right, y up, z backwards).

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Vector3};
use serde_json::{Map, Value};
use vamvs_core::face::{Rows, Side, Surroundings, of_wide_fisheye};
use vamvs_core::{Camera, Intrinsics, Lens, Pose, Size, View};

use crate::locate::{Located, locate, sorted_by_name};
use crate::masks::Masks;
use crate::sizes::sizes;
use crate::text::BYTE_ORDER_MARK;
use crate::trackless::give_points;
use crate::{IoError, Loaded, Place, broken, faces, ply};

/// Longest accepted side of an image, in pixels.
const LONGEST_SIDE: f64 = (1 << 20) as f64;

/// Reads the scene of `transforms`, the file or the folder of a `transforms.json`.
///
/// Masks are looked up relative to the file, and so are photographs unless `images` is given; then they are
/// looked up there. The points of `ply_file_path` are stored without the views that saw them: a point counts as seen
/// by each view in whose image it lies and in which no other point occludes it. At most 20 000 points are kept.
/// A pose with a uniform scale is normalised, with a warning.
///
/// # Errors
/// If the file cannot be read, the cameras of half of the frames cannot be used (a field is missing or of the wrong type, a camera model is not
/// supported, a pose is not a rigid transform; views of fewer are left out, with a warning), half of the photographs are missing, or a
/// mask is missing.
pub fn read_scene(transforms: &Path, images: Option<&Path>) -> Result<Loaded, IoError> {
    let path = if transforms.is_dir() { transforms.join("transforms.json") } else { transforms.to_owned() };
    let shared = read_object(&path)?;
    let frames = frames(&path, &shared)?;
    let named: Vec<String> = frames.iter().map(Fields::file_path).collect::<Result<_, _>>()?;
    let Located { folder, names, mut warnings } = locate(&path, &named, images)?;
    let stated: Vec<Option<Size>> = frames.iter().map(stated_size).collect::<Result<_, _>>()?;
    let sizes = sizes(&folder, &names.iter().map(String::as_str).collect::<Vec<_>>(), &stated)?;
    let views =
        frames.iter().zip(names.iter().zip(sizes)).map(|(frame, (name, size))| view(frame, name, size));
    let (views, broken) = broken::leave_out(views.collect())?;
    let (views, scales): (Vec<View>, Vec<f64>) = views.into_iter().flatten().unzip();
    warnings.extend(broken::warning(&broken, frames.len()));
    warnings.extend(warn_of_scales(&path, &scales));
    let masks = masks(&path, &frames, &names)?;
    let mut scene = faces::cut(sorted_by_name(views, Vec::new()));
    if let Some(file) = sparse_file(&path, &shared) {
        let file_name = file.display();
        warnings.push(if file.is_file() {
            let points: Vec<_> = ply::read_positions(&file)?.into_iter().map(Vector3::from).collect();
            give_points(&mut scene, &points, &file)
        } else {
            format!(
                "{}: ply_file_path: {file_name} is not a file; without sparse points depth ranges come from the cameras: add the file, or give --depth-range",
                path.display()
            )
        });
    }
    Ok(Loaded { scene, images: folder, masks, warnings, broken })
}

/// The fields of a frame. A field that the frame lacks is taken from those that all frames share.
struct Fields<'a> {
    path: &'a Path,
    /// The frame's index and file, for error messages.
    what: String,
    own: &'a Map<String, Value>,
    shared: &'a Map<String, Value>,
}

impl Fields<'_> {
    fn get(&self, key: &str) -> Option<&Value> {
        self.own.get(key).or_else(|| self.shared.get(key)).filter(|value| !value.is_null())
    }

    fn number(&self, key: &str) -> Result<Option<f64>, IoError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let number = value.as_f64().filter(|number| number.is_finite());
        number.map(Some).ok_or_else(|| self.wrong(key, "a number", value))
    }

    fn number_or_zero(&self, key: &str) -> Result<f64, IoError> {
        Ok(self.number(key)?.unwrap_or(0.0))
    }

    fn text(&self, key: &str) -> Result<Option<&str>, IoError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        value.as_str().map(Some).ok_or_else(|| self.wrong(key, "a string", value))
    }

    fn file_path(&self) -> Result<String, IoError> {
        let path = self.text("file_path")?.filter(|path| !path.is_empty());
        path.map(str::to_owned).ok_or_else(|| self.malformed("expected a file_path, found none"))
    }

    fn wrong(&self, key: &str, expected: &str, found: &Value) -> IoError {
        let found: String = found.to_string().chars().take(60).collect();
        self.malformed(&format!("{key}: expected {expected}, found {found}"))
    }

    fn malformed(&self, problem: &str) -> IoError {
        IoError::malformed(self.path, Place::Whole, format!("{}: {problem}", self.what))
    }

    fn unsupported(&self, problem: &str) -> IoError {
        IoError::unsupported(self.path, Place::Whole, format!("{}: {problem}", self.what))
    }
}

fn read_object(path: &Path) -> Result<Map<String, Value>, IoError> {
    let text = std::fs::read(path).map_err(IoError::system("open", path))?;
    let text = with_words_quoted(text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&text));
    let value: Value = serde_json::from_slice(&text)
        .map_err(|error| IoError::malformed(path, Place::Line(error.line()), error))?;
    match value {
        Value::Object(fields) => Ok(fields),
        Value::Array(list) if list.iter().any(|item| item.get("transform").is_some()) => {
            let problem = "expected the transforms.json of a data set, found a list of poses as `ns-export cameras` writes it: it has no focal \
                           lengths, and its poses are in the units of the training; take the transforms.json that the training read";
            Err(IoError::unsupported(path, Place::Whole, problem))
        }
        _ => Err(IoError::malformed(path, Place::Whole, "expected an object with frames")),
    }
}

/// The text with the words `NaN`, `Infinity` and `-Infinity`, which Python writes and JSON does not have, in quotation marks: a field
/// that is one of them is not a number, and not missing either.
fn with_words_quoted(text: &[u8]) -> Vec<u8> {
    const WORDS: [&[u8]; 3] = [b"NaN", b"Infinity", b"-Infinity"];
    let (mut kept, mut rest, mut in_string) = (Vec::with_capacity(text.len()), text, false);
    while let Some(&byte) = rest.first() {
        let word = WORDS.into_iter().find(|word| !in_string && rest.starts_with(word));
        let mark: &[u8] = if word.is_some() { b"\"" } else { b"" };
        let length = match (word, byte) {
            (Some(word), _) => word.len(),
            // An escaped character, which may be a quotation mark.
            (None, b'\\') => rest.len().min(2),
            (None, _) => 1,
        };
        in_string ^= byte == b'"';
        [mark, &rest[..length], mark].into_iter().for_each(|part| kept.extend_from_slice(part));
        rest = &rest[length..];
    }
    kept
}

fn frames<'a>(path: &'a Path, shared: &'a Map<String, Value>) -> Result<Vec<Fields<'a>>, IoError> {
    let malformed = |problem: String| IoError::malformed(path, Place::Whole, problem);
    let list = shared.get("frames").and_then(Value::as_array).filter(|frames| !frames.is_empty());
    let list = list.ok_or_else(|| malformed("expected a list of frames, found none".to_owned()))?;
    let fields = |(index, frame): (usize, &'a Value)| {
        let own = frame.as_object().ok_or_else(|| malformed(format!("frame {index}: expected an object")))?;
        let name = own.get("file_path").and_then(Value::as_str).unwrap_or("no file_path");
        Ok(Fields { path, what: format!("frame {index} ({name})"), own, shared })
    };
    list.iter().enumerate().map(fields).collect()
}

/// A view, and the scale of its pose's matrix, by which that was divided.
fn view(frame: &Fields, name: &str, size: Size) -> Result<(View, f64), IoError> {
    let camera = match panorama(frame)? {
        Some(rows) => Surroundings::Panorama { size, rows }.face(Side::Front),
        None => {
            let lens = lens(frame)?;
            of_wide_fisheye(Camera { size, intrinsics: intrinsics(frame, size)?, lens })
        }
    };
    let (cam_from_world, scale) = pose(frame)?;
    Ok((View { id: 0, name: name.to_owned(), camera, cam_from_world, depth_range: None }, scale))
}

/// A warning that matrices had a scale, if one had.
fn warn_of_scales(path: &Path, scales: &[f64]) -> Option<String> {
    let first = scales.iter().find(|scale| **scale != 1.0)?;
    let count = scales.iter().filter(|scale| **scale != 1.0).count();
    Some(format!(
        "{}: the transform_matrix of {count} frames has a uniform scale ({first:.4}), which was taken out of the rotation; positions stay as they are",
        path.display()
    ))
}

fn stated_size(frame: &Fields) -> Result<Option<Size>, IoError> {
    let (Some(width), Some(height)) = (frame.number("w")?, frame.number("h")?) else { return Ok(None) };
    let side = |side: f64| (1.0..=LONGEST_SIDE).contains(&side) && side.fract() == 0.0;
    if side(width) && side(height) {
        return Ok(Some(Size::new(width as usize, height as usize)));
    }
    Err(frame.malformed(&format!("w and h: expected the image's size in pixels, found {width}×{height}")))
}

fn intrinsics(frame: &Fields, size: Size) -> Result<Intrinsics, IoError> {
    let (width, height) = (size.width as f64, size.height as f64);
    let focal = |length: &str, angle: &str, side: f64| -> Result<Option<f64>, IoError> {
        let has_own_angle = frame.own.contains_key(angle) && !frame.own.contains_key(length);
        if let (Some(focal), false) = (frame.number(length)?, has_own_angle) {
            return Ok(Some(focal));
        }
        let Some(radians) = frame.number(angle)? else { return Ok(None) };
        if radians > 0.0 && radians < PI {
            return Ok(Some(0.5 * side / (0.5 * radians).tan()));
        }
        Err(frame.malformed(&format!("{angle}: expected an angle between 0 and π radians, found {radians}")))
    };
    let fx = focal("fl_x", "camera_angle_x", width)?
        .ok_or_else(|| frame.malformed("expected fl_x or camera_angle_x, found neither"))?;
    let fy = focal("fl_y", "camera_angle_y", height)?.unwrap_or(fx);
    let cx = frame.number("cx")?.unwrap_or(0.5 * width);
    let cy = frame.number("cy")?.unwrap_or(0.5 * height);
    Intrinsics::try_new(fx, fy, cx, cy).map_err(|error| frame.malformed(&error.to_string()))
}

fn lens(frame: &Fields) -> Result<Lens, IoError> {
    let is_fisheye = frame.get("is_fisheye").and_then(Value::as_bool).unwrap_or(false);
    let model = frame.text("camera_model")?.unwrap_or(if is_fisheye { "OPENCV_FISHEYE" } else { "OPENCV" });
    if let Some(key) = ["ftheta_p0", "ftheta_p1"].into_iter().find(|key| frame.get(key).is_some()) {
        return Err(frame.unsupported(&format!(
            "{key}: expected a perspective camera with k1 k2 k3 p1 p2, or OPENCV_FISHEYE with k1 to k4, found an f-theta lens; undistort the images"
        )));
    }
    let number = |key| frame.number_or_zero(key);
    let (k, p) =
        ([number("k1")?, number("k2")?, number("k3")?, number("k4")?], [number("p1")?, number("p2")?]);
    let lens = match model {
        "OPENCV_FISHEYE" if p == [0.0; 2] => Lens::Fisheye { k },
        "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" if k[3] == 0.0 => {
            Lens::Rational { k: [k[0], k[1], k[2], 0.0, 0.0, 0.0], p }
        }
        _ => {
            return Err(frame.unsupported(&format!(
                "expected a perspective camera with k1 k2 k3 p1 p2, or OPENCV_FISHEYE with k1 to k4, found {model} with k {k:?}, p {p:?}; undistort the images"
            )));
        }
    };
    Ok(if lens.distorts() { lens } else { Lens::None })
}

/// What the rows of a photograph of all directions are; `None` for other photographs. nerfstudio's EQUIRECTANGULAR is called latlong by
/// instant-ngp, whose `equirectangular` is the projection of equal area.
fn panorama(frame: &Fields) -> Result<Option<Rows>, IoError> {
    let is = |key: &str| frame.get(key).and_then(Value::as_bool).unwrap_or(false);
    if frame.text("camera_model")? == Some("EQUIRECTANGULAR") || is("latlong") {
        return Ok(Some(Rows::Latitude));
    }
    Ok(is("equirectangular").then_some(Rows::SineOfLatitude))
}

/// The pose, camera from world, and the uniform scale that its rotation had, 1 if none. OpenGL's camera looks along −z with y
/// up, ours along +z with y down.
fn pose(frame: &Fields) -> Result<(Pose, f64), IoError> {
    let problem = |problem: &str| frame.malformed(&format!("transform_matrix: {problem}"));
    let value = frame.own.get("transform_matrix").unwrap_or(&Value::Null);
    let rows = matrix_rows(value).ok_or_else(|| {
        let found: String = value.to_string().chars().take(60).collect();
        problem(&format!("expected 3 or 4 rows of 4 numbers, found {found}"))
    })?;
    let world_from_gl = Matrix3::from_fn(|row, column| rows[row][column]);
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let centre = Vector3::from_fn(|row, _| rows[row][3]);
    let determinant = world_from_gl.determinant();
    if determinant < 0.0 {
        return Err(problem(&format!(
            "a mirror image, not a rotation (determinant {determinant:.6}): its axes are left-handed; export with right-handed ones"
        )));
    }
    // Rounding is no scale.
    let scale = Some(determinant.cbrt()).filter(|scale| scale.is_normal() && (scale - 1.0).abs() > 1e-3);
    let scale = scale.unwrap_or(1.0);
    let world_from_cam = Pose::try_new(world_from_gl / scale * flip, centre);
    Ok((world_from_cam.map_err(|error| problem(&error.to_string()))?.inverse(), scale))
}

/// The first three rows of a 3×4 or 4×4 matrix.
fn matrix_rows(value: &Value) -> Option<[[f64; 4]; 3]> {
    let rows = value.as_array().filter(|rows| (3..=4).contains(&rows.len()))?;
    let mut matrix = [[0.0; 4]; 3];
    for (to, row) in matrix.iter_mut().zip(rows) {
        let row = row.as_array().filter(|row| row.len() == 4)?;
        for (to, value) in to.iter_mut().zip(row) {
            *to = value.as_f64()?;
        }
    }
    Some(matrix)
}

fn masks(path: &Path, frames: &[Fields], names: &[String]) -> Result<Masks, IoError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut files = BTreeMap::new();
    for (frame, name) in frames.iter().zip(names) {
        let Some(mask) = frame.text("mask_path")? else { continue };
        let mask = folder.join(mask.replace('\\', "/"));
        if !mask.is_file() {
            return Err(frame.malformed(&format!("mask_path: {} is not a file", mask.display())));
        }
        files.insert(name.clone(), mask);
    }
    Ok(if files.is_empty() { Masks::None } else { Masks::Files(files) })
}

/// The file that `ply_file_path` names.
fn sparse_file(path: &Path, shared: &Map<String, Value>) -> Option<PathBuf> {
    let named = shared.get("ply_file_path").and_then(Value::as_str)?;
    Some(path.parent().unwrap_or(Path::new("")).join(named.replace('\\', "/")))
}
