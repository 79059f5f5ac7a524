//! `vamvs eval`: compares results with ground truth.

mod cloud;
mod depth;
#[cfg(feature = "torch")]
mod network;
mod scene;
mod table;

use anyhow::Result;
use vamvs::eval::depth::default_thresholds;
use vamvs::measures::Threshold;

use crate::arguments::{DepthThresholdFlags, EvalArguments, EvalCommand, EvalGeneralFlags};
use crate::progress::Progress;
use crate::settings::Settings;

/// Runs the command.
pub fn run(arguments: &EvalArguments) -> Result<()> {
    match &arguments.what {
        EvalCommand::Depth(arguments) => depth::run(arguments),
        EvalCommand::Cloud(arguments) => cloud::run(arguments),
        EvalCommand::Scene(arguments) => scene::run(arguments),
        #[cfg(feature = "torch")]
        EvalCommand::Network(arguments) => network::run(arguments),
        #[cfg(not(feature = "torch"))]
        EvalCommand::Network(_) => super::needs_libtorch("eval network"),
    }
}

/// Sets the threads; returns what draws the progress.
fn begin(flags: &EvalGeneralFlags) -> Result<Progress> {
    Settings { threads: flags.threads, ..Settings::default() }.use_threads()?;
    Ok(Progress::new(flags.quiet))
}

impl DepthThresholdFlags {
    /// The thresholds that are asked for, or the default ones.
    fn thresholds(&self, planes_known: bool) -> Vec<Threshold> {
        let absolute = self.absolute.iter().copied().map(Threshold::Absolute);
        let relative = self.relative.iter().copied().map(Threshold::Relative);
        let planes = self.planes.iter().copied().map(Threshold::Planes);
        let given: Vec<Threshold> = absolute.chain(relative).chain(planes).collect();
        if given.is_empty() { default_thresholds(planes_known) } else { given }
    }
}
