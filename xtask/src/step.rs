//! A named command that must succeed, and where the repository is.

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

/// The repository's root folder.
pub fn root() -> PathBuf {
    let mut root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    root.pop();
    root
}
