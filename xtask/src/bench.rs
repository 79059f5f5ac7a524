//! `cargo xtask bench`: runs the benchmarks and prints the time of a depth map by stage.

use std::process::Stdio;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::step::run;
use crate::{cargo, setup};

/// File of the network that is measured.
const MODULE: &str = "tests/modules/paper-var.pt";

/// The depth maps that are measured: width and height in pixels, views, planes.
const SIZES: [[&str; 4]; 2] = [["640", "512", "5", "48"], ["1280", "960", "5", "96"]];

/// Run the benchmarks of geometry, fusion and refinement, and measure a depth map's time by stage and peak memory.
///
/// Sets up libtorch first, if there is none.
#[derive(Args)]
pub struct Bench {}

impl Bench {
    pub fn run(&self) -> Result<()> {
        setup::ensure_any()?;
        for package in ["vamvs-core", "vamvs-fusion", "vamvs-refine"] {
            run(&format!("bench {package}"), &mut cargo(&["bench", "-p", package, "--bench", "*"]))?;
        }
        run("build", &mut cargo(&["build", "--release", "-p", "vamvs-net", "--example", "profile"]))?;
        let profiles = SIZES.iter().map(|size| profile(size)).collect::<Result<Vec<_>>>()?;
        print_table(&profiles);
        Ok(())
    }
}

/// Runs the example `profile` for a size. Returns what it prints as pairs of a name and a value: the time of each
/// stage, the total time, and memory.
fn profile(size: &[&str]) -> Result<Vec<(String, String)>> {
    let mut command =
        cargo(&["run", "--release", "--quiet", "-p", "vamvs-net", "--example", "profile", "--"]);
    command.arg(MODULE).args(size);
    let output = command.stderr(Stdio::inherit()).output().context("the profile could not be started")?;
    ensure!(output.status.success(), "the profile failed ({}); its message is above", output.status);
    Ok(rows(&String::from_utf8_lossy(&output.stdout)))
}

/// Splits lines such as `Sweep 1.234 s` and `total 5.678 s, peak 910 MiB` into names, in lower case, and values.
fn rows(output: &str) -> Vec<(String, String)> {
    let parts = output.lines().flat_map(|line| line.split(", "));
    let rows = parts.filter_map(|part| part.split_once(' '));
    rows.map(|(name, value)| (name.to_lowercase(), value.to_owned())).collect()
}

fn print_table(profiles: &[Vec<(String, String)>]) {
    print!("\n{:12}", "depth map");
    for [width, height, views, planes] in SIZES {
        print!("{:>34}", format!("{width}×{height}, {views} views, {planes} planes"));
    }
    println!();
    let stages = profiles.first().map_or(0, Vec::len);
    for stage in 0..stages {
        print!("{:12}", profiles[0][stage].0);
        for profile in profiles {
            print!("{:>34}", profile.get(stage).map_or("", |(_, value)| value));
        }
        println!();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_profile_is_read() {
        let rows = rows("Encode 0.3 s\nSweep 1.25 s\ntotal 1.55 s, peak 910 MiB\n");
        let expected = [("encode", "0.3 s"), ("sweep", "1.25 s"), ("total", "1.55 s"), ("peak", "910 MiB")];
        assert_eq!(rows, expected.map(|(name, value)| (name.to_owned(), value.to_owned())));
    }
}
