//! `cargo xtask real`: reconstructs real photographs, which are not in the repository.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use vamvs_core::{CloudPoint, Grid, Rgb, Size};
use vamvs_eval::DepthErrors;
use vamvs_io::{atomic, image, ply};
use vamvs_picture::map::{relative_errors, spread, valid};
use vamvs_picture::viewpoint::best_direction;
use vamvs_picture::{Look, Scale, Surfels, Viewpoint, panel};

use crate::convert::{self, Layout};
use crate::frames;
use crate::maps::{self, Map};
use crate::picture::up_beside;
use crate::vamvs::{self, Reconstruction};

/// Reconstruct real photographs, draw the results and write a table of them.
///
/// Scenes are folders of these names: herz_jesus_p8 and kermit (COLMAP models), dtu_scan37 (MVSNet layout),
/// dino_sparse_ring (Middlebury) and red_kitchen (7-Scenes, whose depth sensor gives a rough ground truth). Those
/// that are missing are skipped.
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
    /// Longer side to which photographs are reduced, pixels [default: each scene's own].
    #[arg(long, value_name = "PIXELS")]
    max_size: Option<usize>,
    /// Largest number of views; scenes that are COLMAP models are always used whole.
    #[arg(long, value_name = "N", default_value_t = 16)]
    max_views: usize,
    /// Further flags of `vamvs reconstruct`.
    #[arg(last = true, value_name = "FLAGS")]
    flags: Vec<OsString>,
}

/// How to reconstruct the scene in the folder `name`.
struct Known {
    name: &'static str,
    kind: Kind,
    /// Longer side to which photographs are reduced, pixels.
    max_size: usize,
    flags: &'static [&'static str],
}

/// The layout of a scene's files.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// A COLMAP model in this subfolder.
    Colmap(&'static str),
    /// MVSNet's layout.
    Mvsnet,
    /// Cameras in Middlebury's `NAME_par.txt`.
    Middlebury,
    /// RGB-D frames of 7-Scenes.
    Frames,
}

/// The dinosaur's bounding box, from the benchmark's readme. The background is black.
const DINO: &[&str] = &[
    "--roi",
    "-0.061897",
    "-0.018874",
    "-0.057845",
    "0.010897",
    "0.068227",
    "0.015495",
    "--min-brightness",
    "20",
];

/// The depth range is the sensor's nominal one, metres. Estimated from the cameras alone, which rotate more than they
/// translate, it would be 1.3 to 20 m and miss near surfaces. Poses are inaccurate, so more views help. Planes are
/// uniform in depth, as in the paper.
const ROOM: &[&str] =
    &["--depth-range", "0.5", "4.5", "--views", "7", "--spacing", "depth", "--planes", "96"];

const KNOWN: [Known; 5] = [
    Known { name: "herz_jesus_p8", kind: Kind::Colmap("sparse"), max_size: 1280, flags: &[] },
    Known { name: "kermit", kind: Kind::Colmap("sparse/0"), max_size: 1280, flags: &[] },
    Known { name: "dtu_scan37", kind: Kind::Mvsnet, max_size: 800, flags: &[] },
    Known { name: "dino_sparse_ring", kind: Kind::Middlebury, max_size: 1280, flags: DINO },
    Known { name: "red_kitchen", kind: Kind::Frames, max_size: 1280, flags: ROOM },
];

/// Thresholds of the relative depth error.
const THRESHOLDS: [f64; 3] = [0.01, 0.02, 0.05];

/// Size of the pictures of clouds, pixels.
const CLOUD_SIZE: Size = Size::new(1280, 960);

/// Width of each panel in the picture of a view, pixels.
const PANEL_WIDTH: usize = 400;

/// Largest number of views that are drawn.
const SHOWN: usize = 3;

/// The result of a scene.
struct Outcome {
    name: &'static str,
    views: usize,
    reconstruction: Reconstruction,
    /// Errors against the sensor's depth: of all depths, and of the confident ones. `None` without a sensor.
    errors: Option<[DepthErrors; 2]>,
}

impl Real {
    pub fn run(&self) -> Result<()> {
        let wanted = self.wanted()?;
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{} could not be made", self.out.display()))?;
        let mut outcomes = Vec::new();
        let mut failed = Vec::new();
        for known in wanted {
            match self.scene(known) {
                Ok(outcome) => outcomes.push(outcome),
                Err(error) => failed.push(format!("{}: {error:#}", known.name)),
            }
        }
        let text = report(&outcomes, &failed);
        let file = self.out.join("real.md");
        atomic::write(&file, |out| out.write_all(text.as_bytes()))?;
        println!("\n{text}\n{}", file.display());
        ensure!(failed.is_empty(), "{} of the scenes failed", failed.len());
        Ok(())
    }

    /// The scenes that were asked for and whose folders exist.
    fn wanted(&self) -> Result<Vec<&'static Known>> {
        let names = KNOWN.iter().map(|known| known.name).collect::<Vec<_>>();
        if let Some(name) = self.scene.iter().find(|name| !names.contains(&name.as_str())) {
            bail!("{name} is no known scene: expected one of {}", names.join(", "));
        }
        let asked =
            |known: &&Known| self.scene.is_empty() || self.scene.iter().any(|name| name == known.name);
        let there = |known: &&Known| self.scenes.join(known.name).is_dir();
        let wanted: Vec<_> = KNOWN.iter().filter(asked).filter(there).collect();
        ensure!(!wanted.is_empty(), "{} has no folder {}", self.scenes.display(), names.join(", "));
        Ok(wanted)
    }

    fn scene(&self, known: &'static Known) -> Result<Outcome> {
        println!("\n── {}", known.name);
        let (from, out) = (self.scenes.join(known.name), self.out.join(known.name));
        let mut flags = self.input(known.kind, &from, &out.join("scene"))?;
        let max_size = self.max_size.unwrap_or(known.max_size);
        flags.extend(["--max-size".into(), max_size.to_string().into()]);
        flags.extend(known.flags.iter().map(OsString::from));
        flags.extend(self.flags.iter().cloned());
        let result = out.join("result");
        let reconstruction = vamvs::reconstruct(&flags, &result)?;
        let views = read_views(&result, (known.kind == Kind::Frames).then_some(&from))?;
        self.draw(known.name, &result, &views)?;
        Ok(Outcome { name: known.name, views: views.len(), reconstruction, errors: errors(&views)? })
    }

    /// The flags that name the scene's cameras and photographs. Scenes that are not COLMAP models are first copied to
    /// `to` in MVSNet's layout.
    fn input(&self, kind: Kind, from: &Path, to: &Path) -> Result<Vec<OsString>> {
        let layout = match kind {
            Kind::Colmap(model) => {
                let (model, images) = (from.join(model), from.join("images"));
                return Ok(vec!["--colmap".into(), model.into(), "--images".into(), images.into()]);
            }
            Kind::Mvsnet => convert::first_views(from, to, self.max_views)?,
            Kind::Middlebury => convert::middlebury(from, to, self.max_views)?,
            Kind::Frames => frames::convert(from, to, self.max_views)?,
        };
        let Layout { cams, images } = layout;
        Ok(vec!["--cams".into(), cams.into(), "--images".into(), images.into()])
    }

    /// Writes pictures of the cloud and of some views next to the report.
    fn draw(&self, name: &str, result: &Path, views: &[View]) -> Result<()> {
        let file = result.join("fused.ply");
        let cloud = ply::read(&file)?;
        for (look, end) in [(Look::Colours, "cloud"), (Look::Clay, "shape")] {
            let picture = cloud_picture(&cloud, &file, look)?;
            image::save_png_rgb(&self.out.join(format!("{name}-{end}.png")), &picture)?;
        }
        for view in views.iter().step_by(views.len().div_ceil(SHOWN).max(1)) {
            let file = self.out.join(format!("{name}-{}.png", view.name));
            image::save_png_rgb(&file, &view.picture(result)?)?;
        }
        Ok(())
    }
}

/// The estimated depth map of a view, and the sensor's depth at its pixels if there is a sensor.
struct View {
    name: String,
    map: Map,
    sensor: Option<Grid<f32>>,
}

impl View {
    /// A row of panels: photograph, depth, confident depth, confidence and, with a sensor, its depth and the error.
    fn picture(&self, result: &Path) -> Result<Grid<Rgb>> {
        let depth = valid(&self.map.depth);
        let (near, far) = spread(&self.sensor.as_ref().map_or(valid(&self.map.confident()), valid));
        let mut parts = vec![
            image::load_rgb(&result.join("images").join(format!("{}.png", self.name)))?,
            Scale::Turbo.paint(&depth, near, far),
            Scale::Turbo.paint(&valid(&self.map.confident()), near, far),
            Scale::Confidence.paint(&self.map.confidence.map(|&confidence| Some(confidence)), 0.0, 1.0),
        ];
        if let Some(sensor) = &self.sensor {
            let error = relative_errors(&self.map.depth, sensor);
            parts.push(Scale::Turbo.paint(&valid(sensor), near, far));
            parts.push(Scale::Error.paint(&error, 0.0, 2.0 * THRESHOLDS[2] as f32));
        }
        let size = panel::of_width(parts[0].size(), PANEL_WIDTH);
        Ok(panel::row(&parts, size))
    }
}

/// Reads the views in an output folder, and the sensor's depth from the folder `frames` if it is given.
fn read_views(result: &Path, frames: Option<&PathBuf>) -> Result<Vec<View>> {
    let folder = result.join("depths");
    let entries =
        std::fs::read_dir(&folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let files = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = files.filter_map(|file| file.strip_suffix(".pfm").map(str::to_owned)).collect();
    names.sort();
    let read = |name: String| {
        let map = Map::read(result, &name)?;
        let sensor =
            frames.map(|frames| frames::sensor_depth(frames, &name, map.depth.size())).transpose()?;
        Ok(View { name, map, sensor })
    };
    names.into_iter().map(read).collect()
}

/// Errors against the sensor's depth: of all depths, and of the confident ones. `None` without a sensor.
fn errors(views: &[View]) -> Result<Option<[DepthErrors; 2]>> {
    let Some(sensors) = views.iter().map(|view| view.sensor.as_ref()).collect::<Option<Vec<_>>>() else {
        return Ok(None);
    };
    let of = |depths: &[Grid<f32>]| maps::relative_errors(depths, sensors.iter().copied(), &THRESHOLDS);
    let all: Vec<_> = views.iter().map(|view| view.map.depth.clone()).collect();
    let confident: Vec<_> = views.iter().map(|view| view.map.confident()).collect();
    Ok(Some([of(&all)?, of(&confident)?]))
}

fn cloud_picture(cloud: &[CloudPoint], file: &Path, look: Look) -> Result<Grid<Rgb>> {
    let up = up_beside(file)?;
    let view = Viewpoint::from_direction(cloud, &best_direction(cloud, &up), &up, CLOUD_SIZE);
    Ok(Surfels::new(cloud).render(&view, look))
}

/// All results as Markdown.
fn report(outcomes: &[Outcome], failed: &[String]) -> String {
    let mut lines = vec![
        "| scene | views | seconds a view | points | pixels kept | not confident | inconsistent |".to_owned(),
        "|---|---|---|---|---|---|---|".to_owned(),
    ];
    lines.extend(outcomes.iter().map(Outcome::row));
    if outcomes.iter().any(|outcome| outcome.errors.is_some()) {
        lines.push("\nDepths against a sensor's, where the sensor has one:\n".to_owned());
        lines.push(
            "| scene | depths | share | median error | within 1 % | within 2 % | within 5 % |".to_owned(),
        );
        lines.push("|---|---|---|---|---|---|---|".to_owned());
        lines.extend(outcomes.iter().flat_map(Outcome::error_rows));
    }
    lines.extend(failed.iter().map(|problem| format!("\nFailed: {problem}")));
    lines.join("\n") + "\n"
}

impl Outcome {
    fn row(&self) -> String {
        let total = &self.reconstruction.summary.fusion.total;
        let share = |count: u64| percent(count as f64 / total.pixels.max(1) as f64);
        let (kept, unconfident) = (percent(total.kept()), share(total.unconfident));
        let inconsistent = share(total.inconsistent);
        let (name, views, seconds) = (self.name, self.views, self.seconds_a_view());
        let points = total.points;
        format!("| {name} | {views} | {seconds} | {points} | {kept} | {unconfident} | {inconsistent} |")
    }

    /// Mean time of the depth maps that this run made, seconds.
    fn seconds_a_view(&self) -> String {
        let depth = &self.reconstruction.summary.depth;
        match depth.made {
            0 => "were there".to_owned(),
            made => format!("{:.1}", depth.seconds.values().sum::<f64>() / made as f64),
        }
    }

    fn error_rows(&self) -> Vec<String> {
        let Some([all, confident]) = &self.errors else { return Vec::new() };
        let row = |what: &str, errors: &DepthErrors| {
            let within: Vec<_> = errors.within.iter().map(|within| percent(within.share)).collect();
            let (share, median) = (percent(errors.coverage), percent(errors.relative.median));
            format!("| {} | {what} | {share} | {median} | {} |", self.name, within.join(" | "))
        };
        vec![row("all", all), row("confident", confident)]
    }
}

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}
