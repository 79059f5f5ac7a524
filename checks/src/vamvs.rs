//! The `vamvs` command, run as people run it, and what it tells of a run.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use vamvs_fusion::ViewReport;
use wait4::Wait4;

use crate::step::target;

/// A `vamvs reconstruct` that succeeded.
pub struct Reconstruction {
    /// What it printed.
    pub summary: Summary,
    /// Wall-clock time.
    pub seconds: f64,
}

/// The summary that `vamvs reconstruct --json` prints.
#[derive(Deserialize)]
pub struct Summary {
    /// Of the depth maps.
    pub depth: DepthSummary,
    /// Of the cloud.
    pub fusion: FusionSummary,
}

/// What became of the views.
#[derive(Deserialize)]
pub struct DepthSummary {
    /// Depth maps that were made.
    pub made: usize,
    /// Time by stage of the network.
    pub seconds: BTreeMap<String, f64>,
}

/// What became of the depth maps.
#[derive(Deserialize)]
pub struct FusionSummary {
    /// What became of all pixels.
    pub total: ViewReport,
}

/// Runs `vamvs reconstruct` into the folder `out`; its messages go to the terminal.
pub fn reconstruct(arguments: &[impl AsRef<OsStr>], out: &Path) -> Result<Reconstruction> {
    let start = Instant::now();
    let summary = told(Command::new(binary()?).arg("reconstruct").args(arguments).arg("--out").arg(out))?;
    Ok(Reconstruction { summary, seconds: start.elapsed().as_secs_f64() })
}

/// Runs a command with `--json` and returns what it prints; its messages go to the terminal.
pub fn told<T: DeserializeOwned>(command: &mut Command) -> Result<T> {
    command.arg("--json");
    println!("── {}", command_line(command));
    let output = command.stderr(Stdio::inherit()).output().context("vamvs could not be started")?;
    ensure!(output.status.success(), "vamvs failed ({}); its message is above", output.status);
    serde_json::from_slice(&output.stdout).context("what `vamvs --json` printed")
}

/// Time and memory that a command took.
pub struct Taken {
    /// Wall-clock time.
    pub seconds: f64,
    /// Of all threads, also the system's on their behalf.
    pub processor_seconds: f64,
    /// Peak of the memory held, bytes.
    pub peak_bytes: u64,
}

/// Runs a command with `--json` and `--quiet`; what it prints, and what it took.
pub fn measured<T: DeserializeOwned>(command: &mut Command) -> Result<(T, Taken)> {
    let read = |output| serde_json::from_reader(output).context("what `vamvs --json` printed");
    timed(command.args(["--json", "--quiet"]), read)
}

/// Runs a command with `--quiet`; the number of lines that it prints, and what it took.
pub fn measured_lines(command: &mut Command) -> Result<(usize, Taken)> {
    let count =
        |output| BufReader::new(output).lines().try_fold(0, |count, line| Ok(line.map(|_| count + 1)?));
    timed(command.arg("--quiet"), count)
}

/// Runs a command; what `read` makes of its output, and what it took.
fn timed<T>(command: &mut Command, read: impl Fn(ChildStdout) -> Result<T>) -> Result<(T, Taken)> {
    println!("── {}", command_line(command));
    let start = Instant::now();
    let mut child = command.stdout(Stdio::piped()).spawn().context("vamvs could not be started")?;
    let output = child.stdout.take().context("vamvs has no output")?;
    let told = read(output);
    let ended = child.wait4().context("vamvs was lost")?;
    ensure!(ended.status.success(), "vamvs failed ({}); its message is above", ended.status);
    let taken = Taken {
        seconds: start.elapsed().as_secs_f64(),
        processor_seconds: (ended.rusage.utime + ended.rusage.stime).as_secs_f64(),
        peak_bytes: ended.rusage.maxrss,
    };
    Ok((told?, taken))
}

/// The release build, beside the build that this program is of.
pub fn binary() -> Result<PathBuf> {
    Ok(target()?.join("release").join(format!("vamvs{}", std::env::consts::EXE_SUFFIX)))
}

/// The command as one would type it.
fn command_line(command: &Command) -> String {
    let arguments = command.get_args().map(|argument| argument.to_string_lossy());
    std::iter::once("vamvs".into()).chain(arguments).collect::<Vec<_>>().join(" ")
}
