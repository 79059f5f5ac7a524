//! Runs the `vamvs` command as a user does and reads the summaries that it prints.

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
    /// The summary that it printed.
    pub summary: Summary,
    /// Wall-clock time, seconds.
    pub seconds: f64,
}

/// The summary that `vamvs reconstruct --json` prints.
#[derive(Deserialize)]
pub struct Summary {
    /// The depth estimation.
    pub depth: DepthSummary,
    /// The fusion.
    pub fusion: FusionSummary,
}

/// Number and time of the depth maps.
#[derive(Deserialize)]
pub struct DepthSummary {
    /// Depth maps that this run made; resumed ones do not count.
    pub made: usize,
    /// Time of each stage over all maps, seconds.
    pub seconds: BTreeMap<String, f64>,
}

/// What fusion did with the depth maps.
#[derive(Deserialize)]
pub struct FusionSummary {
    /// Pixel counts by outcome, over all views.
    pub total: ViewReport,
}

/// Runs `vamvs reconstruct` with the output folder `out`; its messages go to the terminal.
pub fn reconstruct(arguments: &[impl AsRef<OsStr>], out: &Path) -> Result<Reconstruction> {
    let start = Instant::now();
    let summary = told(Command::new(binary()?).arg("reconstruct").args(arguments).arg("--out").arg(out))?;
    Ok(Reconstruction { summary, seconds: start.elapsed().as_secs_f64() })
}

/// Runs a command with `--json` and parses what it prints; its messages go to the terminal.
pub fn told<T: DeserializeOwned>(command: &mut Command) -> Result<T> {
    command.arg("--json");
    println!("── {}", command_line(command));
    let output = command.stderr(Stdio::inherit()).output().context("vamvs could not be started")?;
    ensure!(output.status.success(), "vamvs failed ({}); its message is above", output.status);
    serde_json::from_slice(&output.stdout).context("what `vamvs --json` printed")
}

/// Time and memory of a command.
pub struct Taken {
    /// Wall-clock time, seconds.
    pub seconds: f64,
    /// Processor time of all threads, user and system, seconds.
    pub processor_seconds: f64,
    /// Peak of resident memory, bytes.
    pub peak_bytes: u64,
}

/// Runs a command with `--json` and `--quiet`. Returns what it printed, parsed, and its time and memory.
pub fn measured<T: DeserializeOwned>(command: &mut Command) -> Result<(T, Taken)> {
    let read = |output| serde_json::from_reader(output).context("what `vamvs --json` printed");
    timed(command.args(["--json", "--quiet"]), read)
}

/// Runs a command with `--quiet`. Returns the number of lines that it printed, and its time and memory.
pub fn measured_lines(command: &mut Command) -> Result<(usize, Taken)> {
    let count =
        |output| BufReader::new(output).lines().try_fold(0, |count, line| Ok(line.map(|_| count + 1)?));
    timed(command.arg("--quiet"), count)
}

/// Runs a command and passes its standard output to `read`. Returns the result of `read`, and time and memory.
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

/// The release build of `vamvs` in the target folder that this program is in.
pub fn binary() -> Result<PathBuf> {
    Ok(target()?.join("release").join(format!("vamvs{}", std::env::consts::EXE_SUFFIX)))
}

/// The command line as a user would type it.
fn command_line(command: &Command) -> String {
    let arguments = command.get_args().map(|argument| argument.to_string_lossy());
    std::iter::once("vamvs".into()).chain(arguments).collect::<Vec<_>>().join(" ")
}
