//! Checks of reconstructions that a workflow manager spreads over processes: Snakemake, and with `cargo xtask cluster`
//! SLURM.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::files::{create_folder, remove, write};
use crate::step::{root, run, target};
use crate::{cargo, pip, setup};

/// The version of Snakemake that is tested, as pip takes it.
const SNAKEMAKE: &str = "snakemake==9.27.1";

/// Minor version of the oldest Python 3 that this Snakemake runs on.
const PYTHON: u32 = 11;

/// Reconstruct on a SLURM cluster of two nodes on this machine, with and without Snakemake, while a task and a node are
/// killed.
///
/// Needs root and the packages slurm-wlm and munge of Debian or Ubuntu. There must be no SLURM configuration yet.
#[derive(Args)]
pub struct Cluster {}

impl Cluster {
    pub fn run(&self) -> Result<()> {
        setup::ensure_any()?;
        run("build", &mut cargo(&["build", "--release", "-p", "vamvs-cli", "--features", "synth"]))?;
        let vamvs = target()?.join(format!("release/vamvs{}", std::env::consts::EXE_SUFFIX));
        let folder = target()?.join("cluster");
        let site = site(&[SNAKEMAKE, "snakemake-executor-plugin-slurm==2.8.0"])?;
        Scene::make(&vamvs, &folder, 12)?;
        let mut check = Command::new("bash");
        check.arg(root().join("workflow/cluster-check.sh")).arg(&vamvs).arg(&folder);
        run("cluster", check.env("PYTHONPATH", site))
    }
}

/// Runs the tasks of a reconstruction with Snakemake, up to four at a time. The cloud must be that of one process, byte
/// for byte. Skipped where Python is too old.
pub fn test(vamvs: &Path) -> Result<()> {
    if !python_suffices()? {
        println!("── Snakemake is not tested: it needs Python 3.{PYTHON}");
        return Ok(());
    }
    let folder = target()?.join("workflow");
    let site = site(&[SNAKEMAKE])?;
    let scene = Scene::make(vamvs, &folder, 8)?;
    run("reconstruct in one process", &mut scene.command(vamvs, "reconstruct", "whole"))?;
    let tasks = scene.command(vamvs, "tasks", "spread").args(["--batch", "2"]).output().context("vamvs")?;
    ensure!(tasks.status.success(), "vamvs tasks failed: {}", String::from_utf8_lossy(&tasks.stderr));
    write(&folder.join("tasks.jsonl"), &String::from_utf8(tasks.stdout)?)?;
    let mut snakemake = Command::new("python3");
    snakemake.args(["-m", "snakemake", "--quiet", "all", "--cores", "4", "--snakefile"]);
    snakemake.arg(root().join("workflow/Snakefile")).arg("--config");
    snakemake.arg("tasks=tasks.jsonl").arg(format!("vamvs={}", vamvs.display()));
    let snakemake = snakemake.current_dir(&folder).env("PYTHONPATH", site).stdin(Stdio::null());
    run("reconstruct with Snakemake", snakemake)?;
    let cloud =
        |out: &str| fs::read(folder.join(out).join("fused.ply")).with_context(|| format!("{out}/fused.ply"));
    ensure!(cloud("whole")? == cloud("spread")?, "the clouds differ");
    Ok(())
}

/// A small synthetic scene in `folder/set`.
struct Scene {
    folder: PathBuf,
}

impl Scene {
    fn make(vamvs: &Path, folder: &Path, views: usize) -> Result<Self> {
        remove(folder)?;
        create_folder(folder)?;
        let mut synth = Command::new(vamvs);
        synth.args(["synth", "--scenes", "1", "--size", "160x120", "--samples", "1", "--quiet", "--out"]);
        synth.arg(folder.join("set")).args(["--views", &views.to_string()]);
        run("render a scene", &mut synth)?;
        Ok(Self { folder: folder.to_owned() })
    }

    /// The command line `vamvs COMMAND` for the scene, with the output folder `out` in `folder`.
    fn command(&self, vamvs: &Path, command: &str, out: &str) -> Command {
        let scene = self.folder.join("set/scene-00000");
        let mut run = Command::new(vamvs);
        run.arg(command).arg("--cams").arg(scene.join("cams")).arg("--images").arg(scene.join("images"));
        run.arg("--out").arg(self.folder.join(out));
        run.args(["--weights", "vis-corr", "--threads", "1", "--no-report", "--quiet"]);
        run
    }
}

/// Installs Python packages into a folder of their own and returns it, for PYTHONPATH.
fn site(requirements: &[&str]) -> Result<PathBuf> {
    let site = target()?.join("snakemake");
    // This dependency has no wheel; it is pure Python.
    let from_source = ["--no-binary=connection_pool"];
    pip::install(&[&from_source, requirements].concat(), &site, "200 MB")?;
    Ok(site)
}

fn python_suffices() -> Result<bool> {
    let test = format!("import sys; sys.exit(sys.version_info < (3, {PYTHON}))");
    Ok(Command::new("python3").args(["-c", &test]).status().context("python3")?.success())
}
