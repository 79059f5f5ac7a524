//! The commands that `vamvs-checks` implements: builds that program and runs it with the command's arguments.

use std::ffi::OsString;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::step::{run, target};
use crate::{cargo, setup};

/// A command of `vamvs-checks`. Its arguments are passed on unread, also `--help`.
#[derive(Args)]
#[command(disable_help_flag = true)]
pub struct Check {
    /// Arguments; --help lists them.
    #[arg(value_name = "ARGUMENTS", trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

impl Check {
    /// Builds the `vamvs` command and `vamvs-checks`, and runs the check `name`.
    pub fn run(&self, name: &str) -> Result<()> {
        self.run_built(name, &[])
    }

    /// As [`Check::run`], of a check that trains networks or uses others than the default one; sets up libtorch if there is none.
    pub fn run_with_libtorch(&self, name: &str) -> Result<()> {
        setup::ensure_any()?;
        self.run_built(name, &["--features", "vamvs-cli/torch"])
    }

    /// As [`Check::run`], of a check that makes synthetic scenes with `vamvs synth`.
    pub fn run_with_synth(&self, name: &str) -> Result<()> {
        self.run_built(name, &["--features", "vamvs-cli/synth"])
    }

    fn run_built(&self, name: &str, features: &[&str]) -> Result<()> {
        let packages = ["build", "--release", "-p", "vamvs-cli", "-p", "vamvs-checks"];
        run("build", cargo(&packages).args(features))?;
        let program = target()?.join("release").join(format!("vamvs-checks{}", std::env::consts::EXE_SUFFIX));
        let status = Command::new(&program).arg(name).args(&self.arguments).status();
        let status = status.with_context(|| format!("{} could not be started", program.display()))?;
        ensure!(status.success(), "{name} failed ({status})");
        Ok(())
    }
}
