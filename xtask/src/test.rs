//! `cargo xtask test`: everything that must hold of a change.

use std::time::Instant;

use anyhow::Result;
use clap::Args;

use crate::step::{run, target};
use crate::{book, cargo, python, setup, workflow};

/// Check everything: formatting, lints, tests, documentation, the book, the Python package, Snakemake, the build without
/// libtorch.
///
/// Sets up libtorch first, if need be.
#[derive(Args)]
pub struct Test {}

impl Test {
    pub fn run(&self) -> Result<()> {
        let start = Instant::now();
        setup::ensure_any()?;
        run("format", &mut cargo(&["fmt", "--all", "--check"]))?;
        run("lint", &mut cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]))?;
        run("test", &mut cargo(&["test", "--workspace"]))?;
        run("document", cargo(&["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"))?;
        python::test()?;
        let vamvs = target()?.join("debug").join(format!("vamvs{}", std::env::consts::EXE_SUFFIX));
        workflow::test(&vamvs)?;
        book::build(&vamvs)?;
        test_without_libtorch()?;
        println!("all is well, after {:.0} s", start.elapsed().as_secs_f64());
        Ok(())
    }
}

/// Builds the command without the network where no libtorch can be found, and tests `vamvs fuse` in it.
fn test_without_libtorch() -> Result<()> {
    let mut test = cargo(&["test", "-p", "vamvs-cli", "--no-default-features"]);
    run("test without libtorch", test.env("LIBTORCH", "no-libtorch-here"))
}
