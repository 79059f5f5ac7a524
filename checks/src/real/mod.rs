//! `cargo xtask real`: the benchmark on real photographs, which are not in the repository.

mod cameras;
mod ground_truth;
mod held_back;
mod scenes;
mod sky;
mod table;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use nalgebra::Vector3;
use serde_json::Value;
use vamvs_core::{CloudPoint, Grid, Pose, Size};
use vamvs_io::{image, ply};
use vamvs_picture::map::{spread, valid};
use vamvs_picture::{Look, Scale, Surfels, Viewpoint, panel};

use crate::convert::{self, Layout};
use crate::maps::Map;
use crate::vamvs::{self, Summary};
use crate::{files, frames};
use cameras::Shot;
use ground_truth::TrueView;
use held_back::{Explained, explain};
use scenes::{RealScene, Role, SceneLayout};
use table::Row;

/// Measure reconstructions of real photographs, draw them, and write a table.
///
/// Takes every scene below DIR: a COLMAP model (`sparse/0`, `images`), MVSNet's layout (`cams`, `images`, perhaps `gt/NAME.png` with
/// the step in `gt/scale.txt`), Middlebury's (`NAME_par.txt`) or frames of 7-Scenes. With ground truth, depth maps and cloud are
/// compared with it. Of COLMAP models each photograph in turn is held back, the scene is reconstructed without it, and the cloud is projected
/// into it.
#[derive(Args)]
pub struct Real {
    /// Folder with the scenes' folders.
    #[arg(value_name = "DIR")]
    scenes: PathBuf,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "target/real")]
    out: PathBuf,
    /// Only this scene; may be repeated.
    #[arg(long, value_name = "NAME")]
    scene: Vec<String>,
    /// Only scenes on which choices are made, or only those that are measured once at the end.
    #[arg(long, value_enum)]
    role: Option<Role>,
    /// Numbers of views for a depth map, compared side by side [default: the program's default alone].
    #[arg(long, value_name = "N", value_delimiter = ',')]
    views: Vec<usize>,
    /// The most photographs of a scene that are held back, evenly spread [default: all].
    #[arg(long, value_name = "N")]
    held_back: Option<usize>,
    /// Another program's depth maps: below DIR a folder for each scene as `vamvs fuse` takes it, and below that
    /// `without-NAME` for each photograph that is held back. They are fused as ours and by counting.
    #[arg(long, value_name = "NAME=DIR")]
    beside: Vec<String>,
    /// The most views of a scene that is not a COLMAP model.
    #[arg(long, value_name = "N", default_value_t = 16)]
    max_views: usize,
    /// Further flags of `vamvs reconstruct`.
    #[arg(last = true, value_name = "FLAGS")]
    flags: Vec<OsString>,
}

/// Size of the pictures of clouds, pixels.
const CLOUD_SIZE: Size = Size::new(1280, 960);

/// Width of each panel in the picture of a view, pixels.
const PANEL_WIDTH: usize = 400;

/// Largest number of views that are drawn.
const SHOWN: usize = 3;

/// How far beside a camera the eye stands from which a cloud is drawn, as a share of the cloud's median distance.
const ASIDE: f64 = 0.35;

impl Real {
    pub fn run(&self) -> Result<()> {
        let mut scenes = scenes::find(&self.scenes, &self.scene)?;
        scenes.retain(|scene| self.role.is_none_or(|role| role == scene.known.role));
        ensure!(!scenes.is_empty(), "no scene is left of those in {}", self.scenes.display());
        let others = self.beside.iter().map(|other| named(other)).collect::<Result<Vec<_>>>()?;
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{} could not be made", self.out.display()))?;
        let (mut rows, mut failed) = (Vec::new(), Vec::new());
        for scene in &scenes {
            println!("\n── {}", scene.name);
            if let Err(error) = self.scene(scene, &others, &mut rows) {
                failed.push(format!("{}: {error:#}", scene.name));
            }
            self.save(&rows, &failed)?; // what is measured by now is not lost if a later scene is interrupted
        }
        println!("\n{}", table::markdown(&rows, &failed));
        ensure!(failed.is_empty(), "{} of the scenes failed", failed.len());
        Ok(())
    }

    fn save(&self, rows: &[Row], failed: &[String]) -> Result<()> {
        files::save(&self.out.join("real.md"), table::markdown(rows, failed))?;
        files::save(&self.out.join("real.json"), serde_json::to_string_pretty(rows)?)
    }

    /// Measures a scene in all ways that are wanted.
    fn scene(&self, scene: &RealScene, others: &[(&str, PathBuf)], rows: &mut Vec<Row>) -> Result<()> {
        let folder = self.out.join(&scene.name);
        let input = self.input(scene, &folder.join("scene"))?;
        let counts: Vec<Option<usize>> = match self.views.as_slice() {
            [] => vec![None],
            counts => counts.iter().copied().map(Some).collect(),
        };
        for count in counts {
            let label = count.map_or("vamvs".to_owned(), |count| format!("vamvs, {count} views"));
            let mut flags: Vec<OsString> = scene.known.flags.iter().map(OsString::from).collect();
            flags.extend(self.flags.iter().cloned());
            if let Some(count) = count {
                flags.extend(["--views".into(), count.to_string().into()]);
            }
            let run = Run {
                scene,
                input: &input,
                flags,
                folder: folder.join(label.replace(", ", "-").replace(' ', "-")),
            };
            let (mut row, views) = run.whole(&label)?;
            row.held_back = Explained::mean(&run.without_each(&views, self.held_back)?);
            rows.push(row);
        }
        for (name, maps) in others {
            let maps = maps.join(&scene.name);
            if maps.is_dir() {
                rows.extend(self.other_program(scene, name, &maps)?);
            }
        }
        Ok(())
    }

    /// The flags that name the scene's cameras, and the folder of its photographs. Scenes that are not COLMAP models are
    /// first copied to `to` in MVSNet's layout.
    fn input(&self, scene: &RealScene, to: &Path) -> Result<Input> {
        let from = &scene.folder;
        let layout = match &scene.layout {
            SceneLayout::Colmap(model) => {
                return Ok(Input { cameras: ["--colmap".into(), model.into()], images: from.join("images") });
            }
            SceneLayout::Mvsnet => convert::first_views(from, to, self.max_views)?,
            SceneLayout::Middlebury => convert::middlebury(from, to, self.max_views)?,
            SceneLayout::Frames => frames::convert(from, to, self.max_views)?,
        };
        let Layout { cams, images } = layout;
        Ok(Input { cameras: ["--cams".into(), cams.into()], images })
    }

    /// Fuses and measures another program's depth maps, by both rules of consistency.
    fn other_program(&self, scene: &RealScene, name: &str, maps: &Path) -> Result<Vec<Row>> {
        let views = cameras::read(maps)?.len();
        // Of two views no more than two can agree.
        let counted = ["--consistency", "classic", "--min-views", if views < 3 { "2" } else { "3" }];
        let mut rows = Vec::new();
        for (rule, flags) in [("", &[][..]), (", counted", &counted[..])] {
            let cloud = |maps: &Path, file: &str| -> Result<Vec<CloudPoint>> {
                let file = self.out.join(&scene.name).join(format!("{name}{rule}{file}.ply"));
                let mut fuse = Command::new(vamvs::binary()?);
                fuse.arg("fuse").arg(maps).args(flags).arg("--out").arg(&file);
                let _: Value = vamvs::told(&mut fuse)?;
                Ok(ply::read(&file)?)
            };
            let views = cameras::read(maps)?;
            let whole = cloud(maps, "")?;
            let mut held_back = Vec::new();
            for shot in &views {
                let without = maps.join(format!("without-{}", shot.name));
                if without.is_dir() {
                    held_back.push(explain_without(
                        scene,
                        &cloud(&without, &format!("-without-{}", shot.name))?,
                        shot,
                    ));
                }
            }
            let sky = sky_share(scene, None, &views, &whole)?;
            let ground_truth = ground_truth::read(scene, views)?;
            rows.push(Row {
                scene: scene.name.clone(),
                role: scene.known.role,
                label: format!("{name}{rule}"),
                points: whole.len(),
                sky,
                ground_truth: scored(scene, &ground_truth, maps, &whole)?,
                held_back: Explained::mean(&held_back),
                seconds: None,
                peak_bytes: None,
            });
        }
        Ok(rows)
    }
}

/// A scene's cameras and photographs as `vamvs reconstruct` takes them.
struct Input {
    cameras: [OsString; 2],
    images: PathBuf,
}

/// One way to reconstruct a scene.
struct Run<'a> {
    scene: &'a RealScene,
    input: &'a Input,
    flags: Vec<OsString>,
    folder: PathBuf,
}

impl Run<'_> {
    /// Reconstructs from these photographs into a folder; time of a view, and peak.
    fn reconstruct(&self, images: &Path, out: &Path) -> Result<(Option<f64>, u64)> {
        let mut command = Command::new(vamvs::binary()?);
        command.arg("reconstruct").args(&self.input.cameras).arg("--images").arg(images);
        command.args(&self.flags).arg("--no-report").arg("--out").arg(out);
        let (summary, taken): (Summary, _) = vamvs::measured(&mut command)?;
        let made = summary.depth.made;
        Ok(((made > 0).then(|| taken.seconds / made as f64), taken.peak_bytes))
    }

    /// Reconstructs from all photographs, compares with the ground truth and draws the result.
    fn whole(&self, label: &str) -> Result<(Row, Vec<Shot>)> {
        let out = self.folder.join("result");
        let (seconds, peak) = self.reconstruct(&self.input.images, &out)?;
        let (views, cloud) = (cameras::read(&out)?, ply::read(&out.join("fused.ply"))?);
        self.draw(&out, &views, &cloud)?;
        let sky = sky_share(self.scene, Some(&self.folder), &views, &cloud)?;
        let ground_truth = ground_truth::read(self.scene, cameras::read(&out)?)?;
        let row = Row {
            scene: self.scene.name.clone(),
            role: self.scene.known.role,
            label: label.to_owned(),
            points: cloud.len(),
            sky,
            ground_truth: scored(self.scene, &ground_truth, &out, &cloud)?,
            held_back: None,
            seconds,
            peak_bytes: Some(peak),
        };
        Ok((row, views))
    }

    /// Holds back photographs one after the other, `most` at most.
    fn without_each(&self, views: &[Shot], most: Option<usize>) -> Result<Vec<Explained>> {
        if !matches!(self.scene.layout, SceneLayout::Colmap(_)) || views.len() < 4 {
            return Ok(Vec::new());
        }
        let count = most.unwrap_or(views.len()).min(views.len());
        let chosen = (0..count).map(|index| &views[(2 * index + 1) * views.len() / (2 * count)]);
        chosen.map(|shot| self.without(shot)).collect()
    }

    /// Reconstructs without one photograph and projects the cloud into it.
    fn without(&self, shot: &Shot) -> Result<Explained> {
        let folder = self.folder.join(format!("without-{}", shot.name));
        let images = folder.join("images");
        copy_others(&self.input.images, &images, &shot.name)?;
        let out = folder.join("result");
        self.reconstruct(&images, &out)?;
        Ok(explain_without(self.scene, &ply::read(&out.join("fused.ply"))?, shot))
    }

    /// Pictures of some views, and of the cloud from the best side and from beside a camera.
    fn draw(&self, out: &Path, views: &[Shot], cloud: &[CloudPoint]) -> Result<()> {
        for shot in views.iter().step_by(views.len().div_ceil(SHOWN).max(1)) {
            let map = Map::read(out, &shot.name)?;
            image::save_png_rgb(&self.folder.join(format!("{}.png", shot.name)), &picture(shot, &map))?;
        }
        let Some(middle) = views.get(views.len() / 2).filter(|_| !cloud.is_empty()) else { return Ok(()) };
        let surfels = Surfels::new(cloud);
        for (side, name) in [(-1.0, "left"), (1.0, "right")] {
            let view = viewpoint_aside(middle, cloud, side);
            for (look, end) in [(Look::Colours, ""), (Look::Clay, "-shape")] {
                let file = self.folder.join(format!("cloud-{name}{end}.png"));
                image::save_png_rgb(&file, &surfels.render(&view, look))?;
            }
        }
        Ok(())
    }
}

/// `NAME=DIR`.
fn named(text: &str) -> Result<(&str, PathBuf)> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && Path::new(folder).is_dir() => Ok((name, folder.into())),
        _ => bail!("--beside {text}: expected NAME=DIR with a folder that exists"),
    }
}

/// Copies all photographs of a folder but the one called `name` to an empty folder.
fn copy_others(from: &Path, to: &Path, name: &str) -> Result<()> {
    std::fs::create_dir_all(to).with_context(|| format!("{} could not be made", to.display()))?;
    let entries = std::fs::read_dir(from).with_context(|| format!("{} cannot be read", from.display()))?;
    let mut left_out = false;
    for entry in entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()) {
        if entry.file_stem().is_some_and(|stem| stem.to_string_lossy() == name) {
            left_out = true;
            continue;
        }
        let copy = to.join(entry.file_name().unwrap_or_default());
        std::fs::copy(&entry, copy).with_context(|| format!("{} cannot be copied", entry.display()))?;
    }
    ensure!(left_out, "{} has no photograph {name}", from.display());
    Ok(())
}

/// How well a cloud explains what is no sky in a photograph.
fn explain_without(scene: &RealScene, cloud: &[CloudPoint], shot: &Shot) -> Explained {
    let sky = scene.known.sky.map(|rule| rule.find(&shot.photo));
    explain(cloud, shot, sky.as_ref())
}

/// The share of the cloud that is sky; `None` if the scene has no rule for its sky. Where the sky was found is drawn into
/// `folder`.
fn sky_share(
    scene: &RealScene,
    folder: Option<&Path>,
    views: &[Shot],
    cloud: &[CloudPoint],
) -> Result<Option<f64>> {
    let Some(rule) = scene.known.sky else { return Ok(None) };
    let mut skies = Vec::new();
    for shot in views {
        let sky = rule.find(&shot.photo);
        if let Some(folder) = folder {
            let shown = Grid::from_fn(shot.photo.size(), |x, y| {
                if sky[(x, y)] { [255, 0, 255] } else { shot.photo[(x, y)] }
            });
            let file = folder.join("sky").join(format!("{}.png", shot.name));
            std::fs::create_dir_all(folder.join("sky"))?;
            image::save_png_rgb(&file, &shown)?;
        }
        let copy = Shot { name: shot.name.clone(), photo: shot.photo.clone(), ..*shot };
        skies.push((copy, sky::inside(&sky)));
    }
    Ok(Some(sky::share(cloud, &skies)))
}

fn scored(
    scene: &RealScene,
    ground_truth: &[TrueView],
    out: &Path,
    cloud: &[CloudPoint],
) -> Result<Option<(ground_truth::Scores, [f64; 5])>> {
    if ground_truth.is_empty() {
        return Ok(None);
    }
    let thresholds = scene.known.thresholds;
    Ok(Some((ground_truth::scores(ground_truth, out, cloud, &thresholds)?, thresholds)))
}

/// A row of panels: photograph, depth, confident depth, confidence.
fn picture(shot: &Shot, map: &Map) -> Grid<vamvs_core::Rgb> {
    let (near, far) = spread(&valid(&map.confident()));
    let parts = vec![
        shot.photo.clone(),
        Scale::Turbo.paint(&valid(&map.depth), near, far),
        Scale::Turbo.paint(&valid(&map.confident()), near, far),
        Scale::Confidence.paint(&map.confidence.map(|&confidence| Some(confidence)), 0.0, 1.0),
    ];
    let size = panel::of_width(parts[0].size(), PANEL_WIDTH);
    panel::row(&parts, size)
}

/// The view from beside a camera, towards what it sees.
fn viewpoint_aside(shot: &Shot, cloud: &[CloudPoint], side: f64) -> Viewpoint {
    let seen = |point: &CloudPoint| shot.pixel_of(&point.x_in_world).map(|(_, depth)| depth);
    let mut depths: Vec<f64> = cloud.iter().step_by(17).filter_map(seen).collect();
    depths.sort_by(f64::total_cmp);
    let distance = depths.get(depths.len() / 2).copied().unwrap_or(1.0);
    let world_from_cam = shot.cam_from_world.inverse();
    let eye =
        world_from_cam.transform(&Vector3::new(side * ASIDE * distance, -0.15 * distance, -0.1 * distance));
    let target = world_from_cam.transform(&Vector3::new(0.0, 0.0, distance));
    let up = world_from_cam.rotation * -Vector3::y();
    let Size { width, height } = shot.camera.size;
    let scale = (CLOUD_SIZE.width as f64 / width as f64).min(CLOUD_SIZE.height as f64 / height as f64);
    let size = Size::new((width as f64 * scale) as usize, (height as f64 * scale) as usize);
    Viewpoint { camera: shot.camera.resized(size), cam_from_world: Pose::look_at(&eye, &target, &up) }
}
