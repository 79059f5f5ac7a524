//! The commands, one a file.

#[cfg(feature = "net")]
mod calibrate;
pub mod depth;
mod eval;
mod fuse;
mod info;
mod manual;
mod pseudo;
mod reconstruct;
mod refine;
mod report;
mod synth;
mod tasks;
#[cfg(feature = "net")]
mod train;

use anyhow::{Result, bail};
use vamvs::output::LeftOut;

use crate::arguments::{Arguments, Command, CommonFlags};

/// Runs a command.
pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Reconstruct(arguments) => reconstruct::run(arguments),
        Command::Depth(arguments) => depth::run(arguments),
        Command::Tasks(arguments) => tasks::run(arguments),
        Command::Refine(arguments) => refine::run(arguments),
        Command::Fuse(arguments) => fuse::run(arguments),
        Command::Synth(arguments) => synth::run(arguments),
        Command::Pseudo(arguments) => pseudo::run(arguments),
        #[cfg(feature = "net")]
        Command::Train(arguments) => train::run(arguments),
        #[cfg(feature = "net")]
        Command::Calibrate(arguments) => calibrate::run(arguments),
        Command::Eval(arguments) => eval::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Completions(arguments) => manual::completions(arguments),
        Command::Man(arguments) => manual::run(arguments),
    }
}

/// With `--strict`, views that are left out are an error.
fn expect_all_views(common: &CommonFlags, left_out: &[LeftOut]) -> Result<()> {
    if common.strict && !left_out.is_empty() {
        let views: Vec<String> =
            left_out.iter().map(|LeftOut { view, reason }| format!("{view}: {reason}")).collect();
        bail!("{} view(s) were left out, and --strict allows none: {}", views.len(), views.join("; "));
    }
    Ok(())
}
