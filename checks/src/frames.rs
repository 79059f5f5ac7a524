//! RGB-D frames of 7-Scenes (Shotton et al. 2013) in the layout of tsdf-fusion-python: `frame-N.color.jpg`,
//! `frame-N.depth.png` (16 bits, millimetres), `frame-N.pose.txt` (`world_from_cam`) and `camera-intrinsics.txt`.
//!
//! The files' poses and intrinsics are those of the depth camera. The photographs come from a second camera next
//! to it; they are not aligned with the depth maps, although they share names. The second camera's intrinsics and
//! offset below were calibrated: they minimise the mean grey-value difference of pixels that are warped from frame
//! to frame by the sensor's depth, over 66 pairs of frames. The difference is 7.6 of 255, against 10.8 with the
//! depth camera's intrinsics. Principal point and offset are poorly separated, and they absorb the small rotation
//! between the cameras.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use nalgebra::{Matrix3, Matrix4, Vector2, Vector3};
use vamvs_core::depth_map::is_valid;
use vamvs_core::lift::lift;
use vamvs_core::{Grid, Intrinsics, Pinhole, Pose, Size};
use vamvs_io::depth;

use crate::convert::{Layout, numbers};

/// Size of photographs and depth maps, pixels.
const SIZE: Size = Size::new(640, 480);

/// The camera of the photographs.
const COLOUR: Pinhole =
    Pinhole { size: SIZE, intrinsics: Intrinsics { fx: 514.4, fy: 514.4, cx: 298.0, cy: 234.3 } };

/// The depth camera's centre in the frame of the photographs' camera, metres. The axes of both are taken as parallel.
const DEPTH_IN_COLOUR: Vector3<f64> = Vector3::new(0.039, 0.0, 0.0);

/// Unit of the sensor's depth maps, metres.
const DEPTH_STEP: f64 = 0.001;

/// One frame in this many is taken, so that there is a baseline between views.
const FRAME_STEP: usize = 5;

/// Writes every [`FRAME_STEP`]-th frame in `from`, `most` at most, as a scene in MVSNet's layout in `to`.
pub fn convert(from: &Path, to: &Path, most: usize) -> Result<Layout> {
    let layout = Layout::create(to)?;
    for name in names(from)?.iter().step_by(FRAME_STEP).take(most) {
        let colour_from_world = colour_from_depth().compose(&depth_from_world(from, name)?);
        layout.add(
            name,
            &from.join(format!("{name}.color.jpg")),
            &COLOUR.intrinsics.matrix(),
            &colour_from_world,
        )?;
    }
    Ok(layout)
}

/// The sensor's depth of a frame, reprojected into the photograph's camera at `size`: depth z, metres. Where several
/// measurements project to a pixel the nearest counts; 0 where none does.
pub fn sensor_depth(folder: &Path, name: &str, size: Size) -> Result<Grid<f32>> {
    let sensor = depth::read(&folder.join(format!("{name}.depth.png")), DEPTH_STEP)?;
    let depth_camera = Pinhole { size: sensor.size(), intrinsics: depth_intrinsics(folder)? };
    let colour_camera = COLOUR.resized(size);
    let mut seen = Grid::filled(size, f32::INFINITY);
    for (index, &depth) in sensor.data().iter().enumerate().filter(|(_, depth)| is_valid(**depth)) {
        let (x, y) = (index % sensor.width(), index / sensor.width());
        let in_depth_cam =
            lift(&depth_camera, &Vector2::new(x as f64 + 0.5, y as f64 + 0.5), f64::from(depth));
        let in_colour_cam = colour_from_depth().transform(&in_depth_cam);
        if let Some(at) = colour_camera.project_inside(&in_colour_cam) {
            let nearest = &mut seen[(at.x as usize, at.y as usize)];
            *nearest = nearest.min(in_colour_cam.z as f32);
        }
    }
    Ok(seen.map(|&depth| if is_valid(depth) { depth } else { 0.0 }))
}

fn colour_from_depth() -> Pose {
    Pose { rotation: Matrix3::identity(), translation: DEPTH_IN_COLOUR }
}

/// Reads the depth camera's intrinsics. The file's principal point, (320, 240) of 640×480 pixels, is the middle of
/// the image if pixel centres are at half-integers; so it is taken without a shift.
fn depth_intrinsics(folder: &Path) -> Result<Intrinsics> {
    let file = folder.join("camera-intrinsics.txt");
    let k = Matrix3::from_row_slice(&numbers::<9>(&file)?);
    Intrinsics::try_from_matrix(&k).with_context(|| file.display().to_string())
}

fn depth_from_world(folder: &Path, name: &str) -> Result<Pose> {
    let file = folder.join(format!("{name}.pose.txt"));
    let matrix = Matrix4::from_row_slice(&numbers::<16>(&file)?);
    let (rotation, translation) = (matrix.fixed_view::<3, 3>(0, 0), matrix.fixed_view::<3, 1>(0, 3));
    let world_from_depth = Pose::try_new(rotation.into(), translation.into());
    Ok(world_from_depth.with_context(|| file.display().to_string())?.inverse())
}

/// The names of the frames, `frame-N`, sorted.
fn names(folder: &Path) -> Result<Vec<String>> {
    let entries = fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let files = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> =
        files.filter_map(|file| file.strip_suffix(".color.jpg").map(str::to_owned)).collect();
    names.sort();
    ensure!(!names.is_empty(), "{} has no frame-N.color.jpg", folder.display());
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vamvs_io::{atomic, image, mvsnet};

    fn text(path: &Path, text: &str) {
        atomic::write(path, |out| out.write_all(text.as_bytes())).unwrap();
    }

    /// A folder with one frame: the depth camera at (7, 8, 9) looks along the world's x axis.
    fn frame() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| folder.path().join(name);
        image::save_png_rgb(&file("photograph.png"), &Grid::filled(SIZE, [9; 3])).unwrap();
        fs::rename(file("photograph.png"), file("frame-000000.color.jpg")).unwrap();
        text(&file("camera-intrinsics.txt"), "585 0 320\n0 585 240\n0 0 1\n");
        text(&file("frame-000000.pose.txt"), "0 0 1 7\n1 0 0 8\n0 1 0 9\n0 0 0 1\n");
        folder
    }

    #[test]
    fn poses_are_turned_round_and_moved_to_the_photographs_camera() {
        let (folder, to) = (frame(), tempfile::tempdir().unwrap());
        let layout = convert(folder.path(), to.path(), 5).unwrap();
        let options = mvsnet::Options::default();
        let views = mvsnet::read_scene(&layout.cams, &layout.images, None, &options).unwrap().scene.views;
        assert_eq!(views.len(), 1);
        // The photographs' camera is offset along the depth camera's x axis, which is the world's y axis.
        let centre = Vector3::new(7.0, 8.0 - DEPTH_IN_COLOUR.x, 9.0);
        assert!((views[0].cam_from_world.centre() - centre).norm() < 1e-12);
        assert!((views[0].cam_from_world.forward() - Vector3::x()).norm() < 1e-12);
        assert_eq!(views[0].camera.intrinsics, COLOUR.intrinsics);
        assert_eq!(views[0].depth_range, None);
    }

    #[test]
    fn the_sensors_depth_is_carried_to_the_photographs_pixels_nearest_first() {
        let folder = frame();
        let far = |x: usize, _: usize| if x == 400 { 1.0 } else { 2.0 };
        depth::write(&folder.path().join("frame-000000.depth.png"), &Grid::from_fn(SIZE, far), DEPTH_STEP)
            .unwrap();
        let seen = sensor_depth(folder.path(), "frame-000000", SIZE).unwrap();
        let x_in_colour_cam = (400.5 - 320.0) / 585.0 + DEPTH_IN_COLOUR.x;
        let near = (COLOUR.intrinsics.fx * x_in_colour_cam + COLOUR.intrinsics.cx) as usize;
        assert_eq!(seen[(near, 240)], 1.0);
        assert_eq!(seen[(near - 20, 240)], 2.0);
        assert_eq!(seen[(0, 240)], 0.0, "the photograph shows more than the sensor");
    }
}
