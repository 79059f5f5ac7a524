//! `cargo xtask test`: all checks that a change must pass.

use std::time::Instant;

use anyhow::Result;
use clap::Args;

use crate::step::{run, target};
use crate::{book, cargo, platforms, python, setup, workflow};

/// Check everything: formatting, lints, tests, documentation, the Python package, Snakemake, the book, the build
/// with libtorch and without, and other platforms.
///
/// Sets up libtorch first, if there is none.
#[derive(Args)]
pub struct Test {}

impl Test {
    pub fn run(&self) -> Result<()> {
        let start = Instant::now();
        setup::ensure_any()?;
        ensure_gpu();
        run("format", &mut cargo(&["fmt", "--all", "--check"]))?;
        run("lint", cargo(&["clippy"]).args(ALL).args(["--all-targets", "--", "-D", "warnings"]))?;
        run("test", cargo(&["test"]).args(ALL))?;
        run("document", cargo(&["doc", "--no-deps"]).args(ALL).env("RUSTDOCFLAGS", "-D warnings"))?;
        python::test()?;
        let vamvs = target()?.join("debug").join(format!("vamvs{}", std::env::consts::EXE_SUFFIX));
        workflow::test(&vamvs)?;
        book::build(&vamvs)?;
        test_without_libtorch()?;
        platforms::check()?;
        println!("all checks passed in {:.0} s", start.elapsed().as_secs_f64());
        Ok(())
    }
}

/// Drivers that do in software what a GPU does, for the tests of kernels.
const SOFTWARE_GPU: [&str; 2] = ["mesa-vulkan-drivers", "libvulkan1"];

/// Installs a software GPU where there is no driver of any and this may be done; else these tests say that they test nothing.
fn ensure_gpu() {
    if !cfg!(target_os = "linux") {
        return;
    }
    let drivers = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"].map(std::path::Path::new);
    if drivers.iter().any(|folder| folder.read_dir().is_ok_and(|mut files| files.next().is_some())) {
        return;
    }
    println!("no driver of a GPU: installing {} by apt-get", SOFTWARE_GPU.join(" and "));
    let mut install = std::process::Command::new("apt-get");
    install.args(["install", "--yes", "--no-install-recommends"]).args(SOFTWARE_GPU);
    let done = install.env("DEBIAN_FRONTEND", "noninteractive").stdout(std::process::Stdio::null()).status();
    if !done.is_ok_and(|status| status.success()) {
        println!("it could not be installed: kernels for GPUs are compiled and validated, but not run");
    }
}

/// All crates, with all that needs libtorch, and GPUs.
pub const ALL: [&str; 3] = ["--workspace", "--features", "vamvs-cli/torch,vamvs-cli/gpu,vamvs-python/torch"];

/// Builds the command as it is by default, with a LIBTORCH that does not exist, and runs its tests.
fn test_without_libtorch() -> Result<()> {
    let mut test = cargo(&["test", "-p", "vamvs-cli"]);
    run("test without libtorch", test.env("LIBTORCH", "no-libtorch-here"))
}
