//! `cargo xtask aerial`: time and memory of planning a run of thousands of photographs, taken on a synthetic flight
//! over hills.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, anyhow, ensure};
use clap::Args;
use nalgebra::{Matrix3, Vector3};
use vamvs_core::{Camera, Grid, Intrinsics, Lens, Pose, Rgb, Scene, Size, SparsePoint, View};
use vamvs_io::colmap::Model;
use vamvs_io::image;

use crate::files::save;
use crate::vamvs::{Taken, binary, measured_lines};

/// Height of the cameras above the mean ground (z = 0), scene units.
const HEIGHT: f64 = 3.0;

/// Distance from one photograph to the next along a flight strip, and from one strip to the next, scene units.
const SPACING: [f64; 2] = [0.5, 1.0];

/// Focal length as a share of the photograph's width: a photograph covers ground that is [`HEIGHT`] wide.
const FOCAL_LENGTH: f64 = 1.0;

/// One in this many of the views that see a point is in the point's track.
const TRACKED: u64 = 2;

/// Layers of noise in the ground's texture. The finest has a grid step of two pixels, each further one four times the
/// step of the one before.
const OCTAVES: u32 = 6;

/// Plan a run of many aerial photographs with `vamvs tasks`, and print its time and memory.
///
/// Writes a COLMAP model and photographs into DIR; an existing model there is used as it is. The first view and
/// those nearest to it, --rendered of them, get a rendered photograph, so that their depth maps can be made too.
/// All other photographs are hard links to one grey image.
#[derive(Args)]
pub struct Aerial {
    /// Folder for the model (sparse), the photographs (images) and the planned run (out).
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Number of photographs.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    views: usize,
    /// Number of sparse points in the model.
    #[arg(long, value_name = "N", default_value_t = 3_000_000)]
    points: usize,
    /// Size of the photographs, pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size, default_value = "4000x3000")]
    size: Size,
    /// Number of rendered photographs.
    #[arg(long, value_name = "N", default_value_t = 0)]
    rendered: usize,
    /// Network that the tasks run.
    #[arg(long, value_name = "NAME", default_value = "vis-corr")]
    weights: String,
}

impl Aerial {
    pub fn run(&self) -> Result<()> {
        let (model, images) = (self.folder.join("sparse"), self.folder.join("images"));
        let (done, asked) = (self.folder.join("scene.txt"), self.scene_options());
        match fs::read_to_string(&done) {
            Ok(made) => {
                ensure!(made == asked, "{} holds another scene ({made}): remove it", self.folder.display());
            }
            Err(_) => {
                fs::create_dir_all(&model)?;
                fs::create_dir_all(&images)?;
                let scene = self.scene();
                self.write_photographs(&scene, &images)?;
                Model::from_scene(&scene).write_binary(&model)?;
                save(&done, &asked)?;
            }
        }
        let mut command = Command::new(binary()?);
        command.arg("tasks").arg("--colmap").arg(&model).arg("--images").arg(&images);
        command.args(["--weights", &self.weights]).arg("--out").arg(self.folder.join("out"));
        let (tasks, Taken { seconds, peak_bytes, .. }) = measured_lines(&mut command)?;
        println!(
            "{} views, {} points: {tasks} tasks planned in {seconds:.1} s, peak {} MiB",
            self.views,
            self.points,
            peak_bytes >> 20
        );
        Ok(())
    }

    fn scene(&self) -> Scene {
        let side = (self.views as f64).sqrt().ceil() as usize;
        let width = self.size.width as f64;
        let intrinsics = Intrinsics {
            fx: FOCAL_LENGTH * width,
            fy: FOCAL_LENGTH * width,
            cx: 0.5 * width,
            cy: 0.5 * self.size.height as f64,
        };
        let view = |index: usize| View {
            id: index as u32 + 1,
            name: format!("{index:06}.jpg"),
            camera: Camera { size: self.size, intrinsics, lens: Lens::None },
            cam_from_world: looking_down(index / side, index % side),
            depth_range: None,
        };
        let views: Vec<View> = (0..self.views).map(view).collect();
        let points = (0..self.points as u64).map(|point| observed(point, &views, side)).collect();
        Scene { views, points, pairs: None }
    }

    /// All that the scene depends on.
    fn scene_options(&self) -> String {
        format!("{} views of {}, {} rendered, {} points", self.views, self.size, self.rendered, self.points)
    }

    fn write_photographs(&self, scene: &Scene, images: &Path) -> Result<()> {
        let first = scene.views[0].cam_from_world.centre();
        let mut nearest: Vec<&View> = scene.views.iter().collect();
        nearest.sort_by_key(|view| ((view.cam_from_world.centre() - first).norm() * 1e6) as u64);
        let (rendered, plain) = nearest.split_at(self.rendered.min(nearest.len()));
        for view in rendered {
            let photograph = photograph(view);
            save(&images.join(&view.name), image::jpeg_rgb(&photograph, 92))?;
        }
        let grey = self.folder.join("grey.jpg");
        save(&grey, image::jpeg_rgb(&Grid::filled(self.size, [128; 3]), 92))?;
        for view in plain {
            fs::hard_link(&grey, images.join(&view.name))
                .with_context(|| format!("linking {}", view.name))?;
        }
        Ok(())
    }
}

fn size(text: &str) -> Result<Size> {
    let (width, height) = text.split_once('x').ok_or_else(|| anyhow!("expected WIDTHxHEIGHT"))?;
    let size = Size::new(width.parse()?, height.parse()?);
    ensure!(size.width >= 64 && size.height >= 64, "expected at least 64x64");
    Ok(size)
}

/// The pose `cam_from_world` of camera number `along` of a strip, which looks straight down.
fn looking_down(strip: usize, along: usize) -> Pose {
    let centre = Vector3::new(strip as f64 * SPACING[1], along as f64 * SPACING[0], HEIGHT);
    let rotation = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    Pose { rotation, translation: -(rotation * centre) }
}

/// Height of the ground at (x, y), scene units.
fn ground(x: f64, y: f64) -> f64 {
    0.15 * (0.9 * x).sin() * (1.1 * y).cos()
}

/// Sparse point number `point`: a random place on the ground with its track. `side` is the number of views in a strip.
fn observed(point: u64, views: &[View], side: usize) -> SparsePoint {
    let strips = views.len().div_ceil(side);
    let [u, v] = [0, 1].map(|axis| hashed(point, axis, 0) as f64 / u64::MAX as f64);
    let (x, y) = (u * strips as f64 * SPACING[1], v * side as f64 * SPACING[0]);
    let x_in_world = Vector3::new(x, y, ground(x, y));
    let around = |at: f64, spacing: f64, count: usize| {
        let centre = (at / spacing) as usize;
        centre.saturating_sub(4)..(centre + 5).min(count)
    };
    let mut seen = Vec::new();
    for strip in around(x, SPACING[1], strips) {
        for along in around(y, SPACING[0], side) {
            let index = strip * side + along;
            let Some(view) = views.get(index) else { continue };
            let pixel = view.camera.project(&view.cam_from_world.transform(&x_in_world));
            let inside = |p: nalgebra::Vector2<f64>| {
                p.x >= 0.0
                    && p.y >= 0.0
                    && p.x < view.camera.size.width as f64
                    && p.y < view.camera.size.height as f64
            };
            if pixel.is_some_and(inside) && hashed(point, 2, index as u64).is_multiple_of(TRACKED) {
                seen.push(index);
            }
        }
    }
    SparsePoint { x_in_world, views: seen }
}

/// Renders the ground as a view sees it. Each pixel's ray meets the ground by fixed-point iteration of its depth.
fn photograph(view: &View) -> Grid<Rgb> {
    let centre = view.cam_from_world.centre();
    let Intrinsics { fx, fy, cx, cy } = view.camera.intrinsics;
    let finest = 2.0 * HEIGHT / fx;
    Grid::from_fn(view.camera.size, |px, py| {
        let (dx, dy) = ((px as f64 + 0.5 - cx) / fx, -(py as f64 + 0.5 - cy) / fy);
        let mut depth = HEIGHT;
        for _ in 0..6 {
            depth = HEIGHT - ground(centre.x + depth * dx, centre.y + depth * dy);
        }
        let level = texture((centre.x + depth * dx) / finest, (centre.y + depth * dy) / finest);
        [level, (0.9 * level).sqrt(), 0.7 * level].map(|part| (255.0 * part) as u8)
    })
}

/// The mean of [`OCTAVES`] layers of value noise, 0 to 1; the finest has a grid step of 1.
fn texture(x: f64, y: f64) -> f64 {
    let octave = |octave: u32| {
        let (x, y) = (x / f64::from(1 << (2 * octave)), y / f64::from(1 << (2 * octave)));
        let (left, top) = (x.floor(), y.floor());
        let (s, t) = (x - left, y - top);
        let value = |dx: f64, dy: f64| {
            let (column, row) = ((left + dx) as i64 as u64, (top + dy) as i64 as u64);
            hashed(column, row, octave.into()) as f64 / u64::MAX as f64
        };
        let upper = value(0.0, 0.0) * (1.0 - s) + value(1.0, 0.0) * s;
        let lower = value(0.0, 1.0) * (1.0 - s) + value(1.0, 1.0) * s;
        upper * (1.0 - t) + lower * t
    };
    (0..OCTAVES).map(octave).sum::<f64>() / f64::from(OCTAVES)
}

/// A pseudo-random number: a hash of the three numbers (SplitMix64's mixing).
fn hashed(a: u64, b: u64, c: u64) -> u64 {
    let mix = |state: u64, value: u64| {
        let state = (state ^ value).wrapping_add(0x9E37_79B9_7F4A_7C15);
        let state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let state = (state ^ (state >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        state ^ (state >> 31)
    };
    [a, b, c].into_iter().fold(0, mix)
}
