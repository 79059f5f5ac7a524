//! A named command that must succeed, and where the repository and its builds are.

use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

/// Runs a command, says what it is and how long it took.
pub fn run(name: &str, command: &mut Command) -> Result<()> {
    println!("── {name}");
    let start = Instant::now();
    let status = command.status().with_context(|| format!("{name}: {command:?} could not be started"))?;
    ensure!(status.success(), "{name} failed ({status})");
    println!("── {name}: {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// Cargo's target folder, that this program is in.
pub fn target() -> Result<PathBuf> {
    let this = std::env::current_exe().context("where is this program?")?;
    Ok(this.ancestors().nth(2).context("this program is not in a target folder")?.to_owned())
}

/// The repository's root folder.
pub fn root() -> PathBuf {
    let mut root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    root.pop();
    root
}
