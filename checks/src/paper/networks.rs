//! The networks of the tables: exports, trains and measures them.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result};
use serde::Deserialize;

use super::{HOLD_OUT, Lab, text};
use crate::step::{root, run};
use crate::vamvs;

/// Number of reference views that are measured.
pub const REFERENCES: &str = "27";

/// A network for a row of a table.
#[derive(Clone, Copy, Debug)]
pub struct Variant {
    /// Its name, also of its files.
    pub name: &'static str,
    aggregation: &'static str,
    /// Further arguments of `models/export.py`.
    export: &'static [&'static str],
    /// Further flags of `vamvs train`.
    train: &'static [&'static str],
    /// Further flags of `vamvs eval network`.
    measure: &'static [&'static str],
}

impl Variant {
    /// The paper's network with an aggregation.
    pub const fn plain(aggregation: &'static str) -> Self {
        Self { name: aggregation, aggregation, export: &[], train: &[], measure: &[] }
    }

    /// The paper's network, changed by the arguments `export` of `models/export.py`.
    pub const fn changed(
        name: &'static str,
        aggregation: &'static str,
        export: &'static [&'static str],
    ) -> Self {
        Self { name, aggregation, export, train: &[], measure: &[] }
    }
}

pub const VAR: Variant = Variant::plain("var");
pub const VIS_VAR: Variant = Variant::plain("vis-var");
pub const VIS_AVG: Variant = Variant::plain("vis-avg");
pub const VIS_MAX: Variant = Variant::plain("vis-max");
pub const VIS_CORR: Variant = Variant::plain("vis-corr");
pub const UNSUPERVISED: Variant = Variant {
    train: &["--visibility-weight", "0"],
    ..Variant::changed("vis-var-unsupervised", "vis-var", &[])
};
pub const TRUE_VISIBILITY: Variant = Variant {
    train: &["--true-visibility"],
    measure: &["--true-visibility"],
    ..Variant::changed("vis-var-true", "vis-var", &[])
};

/// What `vamvs eval network --json` prints for one network.
#[derive(Clone, Debug, Deserialize)]
pub struct Measured {
    scores: Scores,
}

#[derive(Clone, Debug, Deserialize)]
struct Scores {
    stages: Vec<Stage>,
}

/// The accuracy of the map after a stage, by visibility in the source views.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Stage {
    /// All pixels.
    pub overall: Region,
    /// Pixels that at least one source view does not see.
    pub invisible: Region,
    /// Pixels that all source views see.
    pub fully_visible: Region,
}

/// Pixel counts of a region.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Region {
    pixels: u64,
    within_d: u64,
    within_3d: u64,
    outliers: u64,
}

impl Region {
    /// Shares of pixels with a depth error within d, within 3d, and > 1 % of the depth.
    pub fn shares(&self) -> [f64; 3] {
        [self.within_d, self.within_3d, self.outliers].map(|count| count as f64 / self.pixels as f64)
    }
}

impl Measured {
    /// The accuracy after each stage, the coarse stage first.
    pub fn stages(&self) -> &[Stage] {
        &self.scores.stages
    }

    /// The accuracy after the last stage.
    pub fn last(&self) -> Stage {
        self.scores.stages[self.scores.stages.len() - 1]
    }
}

impl Lab<'_> {
    /// The file of the trained network; trains the network if there is none.
    pub fn trained(&self, variant: &Variant) -> Result<PathBuf> {
        let regime = self.regime;
        let run_folder = self.file(&format!("{}-{}/{}", regime.name, self.arguments.steps, variant.name));
        let module = run_folder.join("module.pt");
        if module.is_file() {
            return Ok(module);
        }
        let steps = self.arguments.steps;
        let mut command = Command::new(vamvs::binary()?);
        command.args(["train", "--data", &text(&self.scenes(&regime.training)?)]);
        command.args(["--network", &text(&self.untrained(variant)?), "--out", &text(&run_folder)]);
        command.args(["--steps", &steps.to_string(), "--coarse-steps", &(3 * steps / 10).to_string()]);
        command.args(["--warm-up", &(steps / 20).to_string(), "--batch", "1"]);
        command.args(["--learning-rate", regime.learning_rate, "--crop", regime.crop[0], regime.crop[1]]);
        command.args(["--freeze-norm-after", &(7 * steps / 10).to_string(), "--views", "3", "3"]);
        command.args(["--max-planes", "48", "--threads", &self.threads()]);
        command.args(["--cross-entropy", "0"]);
        run(&format!("training: {}", variant.name), command.args(variant.train))?;
        Ok(module)
    }

    /// The file of the untrained network; exports the network if there is none.
    fn untrained(&self, variant: &Variant) -> Result<PathBuf> {
        let thin = self.regime.thin;
        let file = self.file(&format!("{}.thin-{thin}.untrained.pt", variant.name));
        if !file.is_file() {
            let mut python = Command::new(&self.arguments.python);
            python.arg("models/export.py").arg(variant.aggregation).arg(&file).args(["--thin", thin]);
            let export = python.args(variant.export).current_dir(root());
            run(&format!("export: {}", variant.name), export).context(
                "models/export.py needs torch: pip install torch==2.11.0, or name another --python",
            )?;
        }
        Ok(file)
    }

    /// Measures a network on the hold-out set with `views` views, the reference included.
    pub fn measured(&self, variant: &Variant, views: usize) -> Result<Measured> {
        let (network, set) = (self.trained(variant)?, self.scenes(&HOLD_OUT)?);
        let mut command = Command::new(vamvs::binary()?);
        command.args(["eval", "network", &text(&network), "--data", &text(&set)]);
        command.args(["--views", &views.to_string(), "--references", REFERENCES]);
        command.args(["--threads", &self.threads()]).args(variant.measure);
        let mut all: Vec<Measured> = vamvs::told(&mut command)?;
        all.pop().context("vamvs eval network measured nothing")
    }
}
