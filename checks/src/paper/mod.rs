//! `cargo xtask paper`: the paper's experiments on small synthetic sets, table by table.
//!
//! Every network is trained for the same small number of steps. So the tables compare networks at equal training
//! cost, not at their best. Scenes and networks that exist in the output folder are used again.

mod clouds;
mod networks;
mod page;
mod tables;

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use vamvs_io::atomic;

use crate::step::run;
use crate::vamvs;
use networks::Variant;
use page::Section;

/// Run the paper's experiments on small synthetic sets and write its tables, with the paper's own figures.
///
/// Needs a Python with torch to export the untrained networks. Networks are trained one after the other; the same
/// command continues an interrupted run.
#[derive(Args)]
pub struct Paper {
    /// Tables and figures to make [default: all, and write the page; with --full: table1 and figure12].
    #[arg(value_enum, value_name = "WHAT")]
    what: Vec<Experiment>,
    /// Networks of the paper's width, trained on more scenes and larger crops: var, vis-var, vis-max and, beside them,
    /// vis-corr. Prints the tables and leaves the page as it is.
    #[arg(long)]
    full: bool,
    /// Folder for scenes, networks and runs.
    #[arg(long, value_name = "DIR", default_value = "target/paper")]
    out: PathBuf,
    /// Training steps of each network.
    #[arg(long, value_name = "N", default_value_t = 500)]
    steps: usize,
    /// Threads for training and measuring.
    #[arg(long, value_name = "N", default_value_t = 2)]
    threads: usize,
    /// The Python that exports networks.
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: PathBuf,
    /// The page to write when all experiments are made.
    #[arg(long, value_name = "FILE.md", default_value = "docs/paper.md")]
    page: PathBuf,
}

/// A table or figure of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Experiment {
    /// Six ways to aggregate views.
    Table1,
    /// Visibility: unsupervised, supervised, ground truth.
    Table2,
    /// Visibility with and without the planes' normalised depth as input.
    Table3,
    /// Flow iterations: quality, resolution, memory, time.
    Table5,
    /// Ablation of hypotheses, neighbours and image features.
    Table6,
    /// Number of hypotheses on each side of a point (m).
    Table7,
    /// Direct regression instead of hypotheses.
    Table8,
    /// Number of views.
    Figure12,
    /// Foveated depth.
    Figure15,
}

/// How large the networks are and how they are trained.
struct Regime {
    name: &'static str,
    /// Divisor of the paper's number of channels, for all hidden layers (`models/export.py --thin`).
    thin: &'static str,
    training: SceneSet,
    crop: [&'static str; 2],
    learning_rate: &'static str,
}

/// The regime of the page.
const HALF_WIDTH: Regime = Regime {
    name: "runs",
    thin: "2",
    training: SceneSet { name: "training", seed: "1", scenes: 24, size: "256x192" },
    crop: ["160", "128"],
    learning_rate: "2e-3",
};
/// The regime of `--full`.
const FULL_WIDTH: Regime = Regime {
    name: "full",
    thin: "1",
    training: SceneSet { scenes: 72, ..HALF_WIDTH.training },
    crop: ["256", "192"],
    learning_rate: "1e-3",
};

/// The settings and the output folder that all experiments share.
struct Lab<'a> {
    arguments: &'a Paper,
    regime: &'static Regime,
    /// The output folder, absolute.
    out: PathBuf,
}

/// A set of synthetic scenes, rendered once.
struct SceneSet {
    name: &'static str,
    seed: &'static str,
    scenes: usize,
    size: &'static str,
}

/// The hold-out set that accuracy is measured on.
const HOLD_OUT: SceneSet = SceneSet { name: "hold-out", seed: "1001", scenes: 6, size: "256x192" };
/// The scene that time, memory and clouds are measured on.
const LARGE: SceneSet = SceneSet { name: "large", seed: "2001", scenes: 1, size: "640x480" };

impl Paper {
    pub fn run(&self) -> Result<()> {
        ensure!(self.steps >= 10, "--steps must be 10 at least, got {}", self.steps);
        std::fs::create_dir_all(&self.out)?;
        let regime = if self.full { &FULL_WIDTH } else { &HALF_WIDTH };
        let lab = Lab { arguments: self, regime, out: self.out.canonicalize()? };
        let wanted = match (self.what.as_slice(), self.full) {
            ([], false) => Experiment::value_variants(),
            ([], true) => &[Experiment::Table1, Experiment::Figure12],
            (what, _) => what,
        };
        let sections = wanted.iter().map(|&what| lab.section(what)).collect::<Result<Vec<_>>>()?;
        sections.iter().for_each(|section| println!("\n{}", section.markdown()));
        if self.what.is_empty() && !self.full {
            let before = std::fs::read_to_string(&self.page).unwrap_or_default();
            let text = page::markdown(&before, &sections, self.steps);
            atomic::write(&self.page, |out| out.write_all(text.as_bytes()))?;
            println!("{}", self.page.display());
        }
        Ok(())
    }
}

impl Lab<'_> {
    fn section(&self, what: Experiment) -> Result<Section> {
        match what {
            Experiment::Table1 => tables::aggregations(self),
            Experiment::Table2 => tables::supervision(self),
            Experiment::Table3 => tables::plane_depth(self),
            Experiment::Table5 => tables::iterations(self),
            Experiment::Table6 => tables::left_out(self),
            Experiment::Table7 => tables::hypotheses(self),
            Experiment::Table8 => tables::regression(self),
            Experiment::Figure12 => tables::views(self),
            Experiment::Figure15 => tables::fovea(self),
        }
    }

    /// The folder of a set, rendered if it is not complete: scenes of style `clutter`, 9 views, 4 light paths a pixel.
    fn scenes(&self, set: &SceneSet) -> Result<PathBuf> {
        let folder = self.out.join(set.name);
        let mut command = Command::new(vamvs::binary()?);
        command.args(["synth", "--quiet", "--styles", "clutter", "--views", "9", "--samples", "4"]);
        command.args(["--scenes", &set.scenes.to_string(), "--seed", set.seed, "--size", set.size]);
        run(&format!("scenes: {}", set.name), command.arg("--out").arg(&folder))?;
        Ok(folder)
    }

    /// The networks of table 1 and figure 12: those of the page, or in the full regime four.
    fn compared<'v>(&self, of_page: &'v [Variant]) -> &'v [Variant] {
        const FULL: [Variant; 4] = [networks::VAR, networks::VIS_VAR, networks::VIS_MAX, networks::VIS_CORR];
        if self.arguments.full { &FULL } else { of_page }
    }

    fn threads(&self) -> String {
        self.arguments.threads.to_string()
    }

    fn file(&self, name: &str) -> PathBuf {
        self.out.join(name)
    }
}

/// A path as a command-line argument.
fn text(path: &Path) -> String {
    path.display().to_string()
}
