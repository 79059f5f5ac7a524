//! Reconstructions of the large scene: quality of the cloud, time and memory.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use nalgebra::Vector2;
use serde_json::Value;
use vamvs_core::lift::lift;
use vamvs_io::{mvsnet, pfm};

use super::networks::Variant;
use super::page::share;
use super::{LARGE, Lab, text};
use crate::vamvs;

/// The result of one reconstruction, with its time and memory.
pub struct Cloud {
    /// Size of the depth maps, `WIDTH×HEIGHT`.
    size: String,
    /// Peak of resident memory of the process.
    peak_bytes: u64,
    /// Mean time of a depth map, seconds: all stages but reading and writing, and the flow iterations alone.
    seconds: [f64; 2],
    points: u64,
    /// Precision, recall and F-score at the smallest distance threshold of `vamvs eval scene`; `None` for an empty
    /// cloud.
    agreement: Option<[f64; 3]>,
}

impl Cloud {
    /// The cells of a row of table 5.
    pub fn cells(&self) -> Vec<String> {
        let [whole, _] = self.seconds;
        let agreement = match self.agreement {
            Some(shares) => shares.map(share),
            None => ["–"; 3].map(str::to_owned),
        };
        let cells = [self.size.clone(), self.memory(), format!("{whole:.2} s"), self.points.to_string()];
        cells.into_iter().chain(agreement).collect()
    }

    fn memory(&self) -> String {
        format!("{} MiB", self.peak_bytes >> 20)
    }
}

/// Reconstructs the large scene with 0, 1, … `most` flow iterations.
pub fn by_iterations(lab: &Lab, variant: &Variant, most: usize) -> Result<Vec<Cloud>> {
    let network = text(&lab.trained(variant)?);
    let cloud = |iterations: usize| {
        let iterations = iterations.to_string();
        reconstruct(lab, &format!("iterations-{iterations}"), &network, &["--iterations", &iterations])
    };
    (0..=most).map(cloud).collect()
}

/// Reconstructs the large scene whole and foveated, and returns the two rows of figure 15's table.
pub fn foveated(lab: &Lab) -> Result<Vec<Vec<String>>> {
    let region = region(&scene(lab)?)?;
    let (roi, area) = (region.corners.map(|corner| format!("{corner:.4}")), region.share);
    let stride = ["--coarse-stride", "8"];
    let mut fovea = [&stride[..], &["--fovea", "--roi"]].concat();
    fovea.extend(roi.iter().map(String::as_str));
    let whole = reconstruct(lab, "whole", "vis-max", &stride)?;
    let foveated = reconstruct(lab, "foveated", "vis-max", &fovea)?;
    let row = |name: &str, area: f64, cloud: &Cloud| {
        let [seconds, flow] = cloud.seconds;
        let times = [format!("{seconds:.2} s"), format!("{flow:.2} s")];
        let [name, area] = [name.to_owned(), format!("{:.1} %", 100.0 * area)];
        [name, area, cloud.memory()].into_iter().chain(times).chain([cloud.points.to_string()]).collect()
    };
    Ok(vec![row("whole", 1.0, &whole), row("foveated", area, &foveated)])
}

/// A box in the world.
struct Region {
    /// x0, y0, z0, x1, y1, z1, scene units.
    corners: [f64; 6],
    /// Share of the first photograph's area that the box's section at its centre's depth covers.
    share: f64,
}

/// A cube around the surface point at the middle of the first photograph.
fn region(scene: &Path) -> Result<Region> {
    /// Half of the cube's side, as a share of the width that the photograph covers at the depth of its centre.
    const HALF: f64 = 0.09;
    let view = mvsnet::read_cam(&scene.join("cams/00000000_cam.txt"), &mvsnet::Options::default())?;
    let depth = pfm::read_depth(&scene.join("depths/00000000.pfm"))?;
    let (width, height) = (depth.width(), depth.height());
    let intrinsics = view.intrinsics;
    let at_middle = f64::from(depth[(width / 2, height / 2)]);
    let camera = vamvs_core::Pinhole { size: depth.size(), intrinsics };
    let middle = Vector2::new(0.5 * width as f64, 0.5 * height as f64);
    let middle = view.cam_from_world.inverse().transform(&lift(&camera, &middle, at_middle));
    let half = HALF * width as f64 / intrinsics.fx * at_middle;
    let side = 2.0 * half * intrinsics.fx / at_middle;
    let corner = |sign: f64| middle.map(|along| along + sign * half);
    let ([x0, y0, z0], [x1, y1, z1]) = (corner(-1.0).into(), corner(1.0).into());
    Ok(Region { corners: [x0, y0, z0, x1, y1, z1], share: side * side / (width * height) as f64 })
}

fn scene(lab: &Lab) -> Result<PathBuf> {
    Ok(lab.scenes(&LARGE)?.join("scene-00000"))
}

/// Runs `vamvs reconstruct` on the large scene, without reuse of earlier results, then `vamvs eval scene`. `more` are
/// further flags of the reconstruction.
fn reconstruct(lab: &Lab, name: &str, network: &str, more: &[&str]) -> Result<Cloud> {
    let (scene, out) = (scene(lab)?, lab.file(&format!("clouds/{name}")));
    let mut command = Command::new(vamvs::binary()?);
    command.args(["reconstruct", "--cams", &text(&scene.join("cams"))]);
    command.args(["--images", &text(&scene.join("images")), "--weights", network, "--out", &text(&out)]);
    command.args(["--views", "5", "--planes", "96", "--force", "--no-report", "--threads", &lab.threads()]);
    let (summary, taken) = vamvs::measured::<Value>(command.arg("--no-refine").args(more))?;
    let points = summary["fusion"]["points"].as_u64().context("the summary has no number of points")?;
    let stages = summary["depth"]["seconds"].as_object().context("the summary has no seconds by stage")?;
    let made = summary["depth"]["made"].as_f64().context("the summary has no number of maps")?;
    let spent = |wanted: &dyn Fn(&str) -> bool| {
        let times = stages.iter().filter(|(stage, _)| wanted(stage)).filter_map(|(_, time)| time.as_f64());
        times.sum::<f64>() / made
    };
    let of_flow = |stage: &str| ["fetch", "neighbours", "flow"].contains(&stage);
    let seconds = [spent(&|stage| !["read", "write"].contains(&stage)), spent(&of_flow)];
    let size = pfm::read_depth(&out.join("depths/00000000.pfm"))?.size();
    let agreement = if points > 0 { Some(agreement(&out, &scene)?) } else { None };
    let size = format!("{}×{}", size.width, size.height);
    Ok(Cloud { size, peak_bytes: taken.peak_bytes, seconds, points, agreement })
}

fn agreement(out: &Path, scene: &Path) -> Result<[f64; 3]> {
    let mut command = Command::new(vamvs::binary()?);
    let scores: Value = vamvs::told(command.args(["eval", "scene", &text(out), &text(scene)]))?;
    let finest = &scores["cloud"]["agreement"][0];
    let value =
        |name: &str| finest[name].as_f64().with_context(|| format!("the cloud's scores have no {name}"));
    Ok([value("precision")?, value("recall")?, value("f_score")?])
}
