//! `cargo xtask test`: all checks that a change must pass.

use std::time::Instant;

use anyhow::Result;
use clap::Args;

use crate::step::{run, target};
use crate::{book, cargo, python, setup, workflow};

/// Check everything: formatting, lints, tests, documentation, the Python package, Snakemake, the book, the build
/// with libtorch and without.
///
/// Sets up libtorch first, if there is none.
#[derive(Args)]
pub struct Test {}

impl Test {
    pub fn run(&self) -> Result<()> {
        let start = Instant::now();
        setup::ensure_any()?;
        run("format", &mut cargo(&["fmt", "--all", "--check"]))?;
        run("lint", cargo(&["clippy"]).args(ALL).args(["--all-targets", "--", "-D", "warnings"]))?;
        run("test", cargo(&["test"]).args(ALL))?;
        run("document", cargo(&["doc", "--no-deps"]).args(ALL).env("RUSTDOCFLAGS", "-D warnings"))?;
        python::test()?;
        let vamvs = target()?.join("debug").join(format!("vamvs{}", std::env::consts::EXE_SUFFIX));
        workflow::test(&vamvs)?;
        book::build(&vamvs)?;
        test_without_libtorch()?;
        println!("all checks passed in {:.0} s", start.elapsed().as_secs_f64());
        Ok(())
    }
}

/// All crates, with all that needs libtorch.
pub const ALL: [&str; 3] = ["--workspace", "--features", "vamvs-cli/torch,vamvs-python/torch"];

/// Builds the command as it is by default, with a LIBTORCH that does not exist, and runs its tests.
fn test_without_libtorch() -> Result<()> {
    let mut test = cargo(&["test", "-p", "vamvs-cli"]);
    run("test without libtorch", test.env("LIBTORCH", "no-libtorch-here"))
}
