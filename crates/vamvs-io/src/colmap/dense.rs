//! COLMAP's dense workspace: `images/`, `sparse/`, and in `stereo/` depth and normal maps of the undistorted
//! images, `fusion.cfg` and `patch-match.cfg`.
//!
//! A map is `W&H&C&` in ASCII, then little-endian float32, channel after channel, each as rows from top to
//! bottom. Depths of 0 or less mean "no depth"; normals are in the camera's frame.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use vamvs_core::{Grid, Size, depth_map};

use crate::bytes::ByteReader;
use crate::{IoError, atomic};

/// Longest accepted header, in bytes.
const LONGEST_HEADER: usize = 64;

/// Which of an image's two depth or normal maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapKind {
    /// `photometric`: as estimated, before the geometric consistency check.
    Photometric,
    /// `geometric`: the geometrically consistent or, in vamvs's own workspaces, the confident pixels.
    Geometric,
}

/// The path of an image's depth map in the workspace.
#[must_use]
pub fn depth_map_path(workspace: &Path, image: &str, kind: MapKind) -> PathBuf {
    map_path(workspace, "depth_maps", image, kind)
}

/// The path of an image's normal map in the workspace.
#[must_use]
pub fn normal_map_path(workspace: &Path, image: &str, kind: MapKind) -> PathBuf {
    map_path(workspace, "normal_maps", image, kind)
}

fn map_path(workspace: &Path, folder: &str, image: &str, kind: MapKind) -> PathBuf {
    let kind = match kind {
        MapKind::Photometric => "photometric",
        MapKind::Geometric => "geometric",
    };
    workspace.join("stereo").join(folder).join(format!("{image}.{kind}.bin"))
}

/// Reads a depth map; values that are not finite and positive become 0.
///
/// # Errors
/// If the file cannot be read, has more than one channel, or its length is not what its header announces.
pub fn read_depth_map(path: &Path) -> Result<Grid<f32>, IoError> {
    let (size, mut values) = read(path, 1)?;
    for depth in &mut values {
        *depth = if depth_map::is_valid(*depth) { *depth } else { 0.0 };
    }
    Ok(Grid::from_vec(size, values))
}

/// Reads a normal map, in the camera's frame; its values are not changed.
///
/// # Errors
/// If the file cannot be read, does not have three channels, or its length is not what its header announces.
pub fn read_normal_map(path: &Path) -> Result<Grid<[f32; 3]>, IoError> {
    let (size, values) = read(path, 3)?;
    let area = size.area();
    let normal = |pixel: usize| [0, 1, 2].map(|channel| values[channel * area + pixel]);
    Ok(Grid::from_vec(size, (0..area).map(normal).collect()))
}

/// Writes a depth map.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write_depth_map(path: &Path, depth: &Grid<f32>) -> Result<(), IoError> {
    atomic::write(path, |out| {
        write_header(out, depth.size(), 1)?;
        write_plane(out, depth.data().iter().copied())
    })
}

/// Writes a normal map, in the camera's frame.
///
/// # Errors
/// If the file cannot be written; then nothing has changed.
pub fn write_normal_map(path: &Path, normals: &Grid<[f32; 3]>) -> Result<(), IoError> {
    atomic::write(path, |out| {
        write_header(out, normals.size(), 3)?;
        (0..3).try_for_each(|channel| write_plane(out, normals.data().iter().map(|normal| normal[channel])))
    })
}

/// Writes `stereo/fusion.cfg` and `stereo/patch-match.cfg` for the images of these names. The folder `stereo` must
/// exist.
///
/// # Errors
/// If a file cannot be written.
pub fn write_configurations(workspace: &Path, images: &[String]) -> Result<(), IoError> {
    let stereo = workspace.join("stereo");
    atomic::write(&stereo.join("fusion.cfg"), |out| {
        images.iter().try_for_each(|image| writeln!(out, "{image}"))
    })?;
    atomic::write(&stereo.join("patch-match.cfg"), |out| {
        images.iter().try_for_each(|image| writeln!(out, "{image}\n__auto__, 20"))
    })
}

fn write_header(out: &mut dyn Write, size: Size, channels: usize) -> io::Result<()> {
    write!(out, "{}&{}&{channels}&", size.width, size.height)
}

fn write_plane(out: &mut dyn Write, values: impl Iterator<Item = f32>) -> io::Result<()> {
    let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
    out.write_all(&bytes)
}

/// The size and values of a map, which must have `channels` channels.
fn read(path: &Path, channels: usize) -> Result<(Size, Vec<f32>), IoError> {
    let mut file = ByteReader::open(path)?;
    let [width, height, found] = read_header(&mut file)?;
    if found != channels {
        return Err(file.malformed(0, format!("expected a map of {channels} channels, found {found}")));
    }
    let size = Size::new(width, height);
    let count = width.checked_mul(height).and_then(|area| area.checked_mul(channels));
    let count = count.filter(|&count| count > 0);
    let count = count.ok_or_else(|| file.malformed(0, format!("expected a size of pixels, found {size}")))?;
    Ok((size, file.rest_as_f32s(count, "values")?))
}

/// Width, height and channels.
fn read_header(file: &mut ByteReader) -> Result<[usize; 3], IoError> {
    let mut header = String::new();
    while header.matches('&').count() < 3 && header.len() < LONGEST_HEADER {
        let [byte] = file.take("header")?;
        header.push(char::from(byte));
    }
    let numbers: Option<Vec<usize>> =
        header.strip_suffix('&').and_then(|header| header.split('&').map(|word| word.parse().ok()).collect());
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        let found: String = header.chars().take(20).collect();
        file.malformed(0, format!("expected a header like 640&480&1&, found {found:?}"))
    })
}
