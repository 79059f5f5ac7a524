//! Runs commands that must succeed, and finds the repository and its target folder. `vamvs-checks` includes this file
//! too.

use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

/// Runs a command and prints its name before and its time after. Fails if the command does.
pub fn run(name: &str, command: &mut Command) -> Result<()> {
    println!("── {name}");
    let start = Instant::now();
    let status = command.status().with_context(|| format!("{name}: {command:?} could not be started"))?;
    ensure!(status.success(), "{name} failed ({status})");
    println!("── {name}: {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// The Cargo target folder that this program is in.
pub fn target() -> Result<PathBuf> {
    let this = std::env::current_exe().context("the path of this program is unknown")?;
    Ok(this.ancestors().nth(2).context("this program is not in a target folder")?.to_owned())
}

/// The repository's root folder.
pub fn root() -> PathBuf {
    let mut root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    root.pop();
    root
}
