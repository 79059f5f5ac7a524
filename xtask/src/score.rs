//! `cargo xtask score`: networks side by side on scenes with known depth.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde::Deserialize;
use vamvs_io::atomic;

use crate::vamvs;

/// Score networks side by side on scenes of `vamvs synth`.
///
/// Depth maps are made as `vamvs depth` makes them, with the best source views and the range that the
/// cameras' files tell. A failure is a pixel whose depth is off by more than 1 %.
#[derive(Args)]
pub struct Score {
    /// Folder of scenes, best of assets and styles that no network was trained with.
    #[arg(value_name = "SET")]
    set: PathBuf,
    /// The networks.
    #[arg(long, value_name = "NAME|FILE.pt", num_args = 1.., required = true)]
    weights: Vec<PathBuf>,
    /// Views compared for a depth map, the reference included.
    #[arg(long, value_name = "N", num_args = 1.., default_values_t = [5, 7])]
    views: Vec<usize>,
    /// Folder for depth maps and the table.
    #[arg(long, value_name = "DIR", default_value = "target/score")]
    out: PathBuf,
}

/// Error beyond which a depth is a failure, as a share of the true depth.
const FAILURE: f64 = 0.01;

/// What `vamvs eval depth --json` prints.
#[derive(Deserialize)]
struct Evaluation {
    /// Over all scenes, by region.
    mean: Vec<RegionErrors>,
}

#[derive(Deserialize)]
struct RegionErrors {
    region: String,
    relative: Relative,
    within: Vec<Within>,
}

#[derive(Deserialize)]
struct Relative {
    median: f64,
}

#[derive(Deserialize)]
struct Within {
    error: f64,
    share: f64,
}

impl RegionErrors {
    fn failures(&self) -> Option<f64> {
        self.within.iter().find(|within| within.error == FAILURE).map(|within| 1.0 - within.share)
    }
}

impl Score {
    pub fn run(&self) -> Result<()> {
        vamvs::build()?;
        let scenes = scenes(&self.set)?;
        let mut rows = Vec::new();
        for weights in &self.weights {
            for &views in &self.views {
                rows.push(self.row(&scenes, weights, views)?);
            }
        }
        let table = format!("{HEAD}{}\n", rows.join("\n"));
        let file = self.out.join("score.md");
        atomic::write(&file, |out| out.write_all(table.as_bytes()))?;
        println!("\n{table}\n{}", file.display());
        Ok(())
    }

    /// A network's line of the table.
    fn row(&self, scenes: &[String], weights: &Path, views: usize) -> Result<String> {
        let name = weights.file_stem().context("a network has no name")?.to_string_lossy();
        let out = self.out.join(format!("{name}-{views}"));
        let mut seconds = 0.0;
        for scene in scenes {
            let from = self.set.join(scene);
            let (cams, images, views) = (from.join("cams"), from.join("images"), views.to_string());
            let arguments: [&OsStr; 9] = [
                "--cams".as_ref(),
                cams.as_ref(),
                "--images".as_ref(),
                images.as_ref(),
                "--weights".as_ref(),
                weights.as_ref(),
                "--force".as_ref(),
                "--views".as_ref(),
                views.as_ref(),
            ];
            seconds += vamvs::depth(&arguments, &out.join(scene))?;
        }
        let evaluation: Evaluation = vamvs::eval_depth(&out, &self.set)?;
        let cell = |region: &str| {
            let found = evaluation.mean.iter().find(|errors| errors.region == region);
            found
                .and_then(RegionErrors::failures)
                .map_or("–".to_owned(), |share| format!("{:.1} %", 100.0 * share))
        };
        let median = evaluation.mean.first().map_or(f64::NAN, |all| all.relative.median);
        Ok(format!(
            "| {name} | {views} | {} | {} | {} | {:.2} % | {seconds:.0} |",
            cell("all"),
            cell("invisible"),
            cell("visible"),
            100.0 * median
        ))
    }
}

const HEAD: &str = "\
| network | views | failures | of what some source does not see | of what all see | median error | seconds |
|---|---|---|---|---|---|---|
";

/// The scenes' names, in order.
fn scenes(set: &Path) -> Result<Vec<String>> {
    let entries = std::fs::read_dir(set).with_context(|| format!("{} cannot be read", set.display()))?;
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry?;
        if entry.path().join("scene.json").is_file() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    ensure!(!names.is_empty(), "{} has no scenes: expected folders with scene.json", set.display());
    Ok(names)
}
