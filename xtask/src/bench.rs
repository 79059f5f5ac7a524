//! `cargo xtask bench`: runs the benchmarks and prints the time and speed of a depth map by stage.

use std::process::Stdio;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::step::run;
use crate::{cargo, setup};

/// Files of the networks that are measured: the paper's, without training, and those that are built in.
const MODULES: [&str; 6] = [
    "tests/modules/paper-var.pt",
    "weights/vis-corr.pt",
    "weights/vis-max.pt",
    "weights/vis-var.pt",
    "weights/var.pt",
    "weights/photometric.pt",
];

/// The default network as it runs without libtorch.
const WITHOUT_LIBTORCH: &str = "weights/vis-corr.safetensors";

/// The depth maps that are measured: width and height in pixels, views, planes.
const SIZES: [[&str; 4]; 2] = [["640", "512", "5", "48"], ["1280", "960", "5", "96"]];

/// Run the benchmarks of geometry, fusion and refinement, and measure the machine, and a depth map's time and speed by stage
/// and peak memory for each network.
///
/// Sets up libtorch first, if there is none.
#[derive(Args)]
pub struct Bench {
    /// Measure the default network and refinement on this GPU, and nothing else but the network on the processor: its number in `vamvs info device`.
    #[arg(long, value_name = "GPU", value_parser = gpu_number)]
    device: Option<usize>,
}

/// The number of `gpu:N`, 0 of `gpu`.
fn gpu_number(device: &str) -> Result<usize, String> {
    let number = device.strip_prefix("gpu").and_then(|rest| match rest {
        "" => Some(0),
        rest => rest.strip_prefix(':')?.parse().ok(),
    });
    number.ok_or_else(|| "expected gpu or gpu:N".to_owned())
}

impl Bench {
    pub fn run(&self) -> Result<()> {
        if let Some(number) = self.device {
            return on_gpu(number);
        }
        setup::ensure_any()?;
        for package in ["vamvs-core", "vamvs-fusion", "vamvs-refine"] {
            run(&format!("bench {package}"), &mut cargo(&["bench", "-p", package, "--bench", "*"]))?;
        }
        let packages = ["build", "--release", "-p", "vamvs-net", "-p", "vamvs-corr", "--examples"];
        run("build", &mut cargo(&packages))?;
        println!("\nthis machine");
        rows(&example("vamvs-net", "speed", &[])?)
            .iter()
            .for_each(|(name, value)| println!("{name:12}{value:>34}"));
        for module in MODULES {
            print_table(module, &profiles("vamvs-net", "profile", module)?);
        }
        print_table(WITHOUT_LIBTORCH, &profiles("vamvs-corr", "stages", WITHOUT_LIBTORCH)?);
        let [width, height, _, planes] = SIZES[1];
        println!("\n{WITHOUT_LIBTORCH}, convolutions at {width}×{height}, {planes} planes, on one thread");
        let layers = example("vamvs-corr", "layers", &[WITHOUT_LIBTORCH, width, height, planes])?;
        println!("{}", layers.trim_end());
        Ok(())
    }
}

/// The default network on a GPU, beside the processor.
fn on_gpu(number: usize) -> Result<()> {
    let packages = ["build", "--release", "-p", "vamvs-gpu", "-p", "vamvs-corr", "--examples"];
    run("build", &mut cargo(&packages))?;
    let number = number.to_string();
    let profile = |size: &[&str; 4]| {
        let arguments = [&[WITHOUT_LIBTORCH], &size[..], &[&number]].concat();
        Ok(rows(&example("vamvs-gpu", "gpu_stages", &arguments)?))
    };
    let on_gpu: Result<Vec<_>> = SIZES.iter().map(profile).collect();
    print_table(&format!("{WITHOUT_LIBTORCH} on gpu:{number}"), &on_gpu?);
    print_table(
        &format!("{WITHOUT_LIBTORCH} on the processor"),
        &profiles("vamvs-corr", "stages", WITHOUT_LIBTORCH)?,
    );
    Ok(())
}

/// What an example prints of a network, for each size.
fn profiles(package: &str, name: &str, network: &str) -> Result<Vec<Vec<(String, String)>>> {
    let profile = |size: &[&str; 4]| Ok(rows(&example(package, name, &[&[network], &size[..]].concat())?));
    SIZES.iter().map(profile).collect()
}

/// Runs an example of a network's crate and returns what it prints.
fn example(package: &str, name: &str, arguments: &[&str]) -> Result<String> {
    let mut command = cargo(&["run", "--release", "--quiet", "-p", package, "--example", name, "--"]);
    let output = command.args(arguments).stderr(Stdio::inherit()).output();
    let output = output.with_context(|| format!("the example {name} could not be started"))?;
    ensure!(output.status.success(), "the example {name} failed ({}); its message is above", output.status);
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Splits lines such as `Sweep 1.234 s` and `total 5.678 s, peak 910 MiB` into names, in lower case, and values.
fn rows(output: &str) -> Vec<(String, String)> {
    let parts = output.lines().flat_map(|line| line.split(", "));
    let rows = parts.filter_map(|part| part.split_once(' '));
    rows.map(|(name, value)| (name.to_lowercase(), value.to_owned())).collect()
}

/// Prints the times of a network's stages, one column a size.
fn print_table(module: &str, profiles: &[Vec<(String, String)>]) {
    print!("\n{module}\n{:15}", "");
    for [width, height, views, planes] in SIZES {
        print!("{:>36}", format!("{width}×{height}, {views} views, {planes} planes"));
    }
    println!();
    let stages = profiles.first().map_or(0, Vec::len);
    for stage in 0..stages {
        print!("{:15}", profiles[0][stage].0);
        for profile in profiles {
            print!("{:>36}", profile.get(stage).map_or("", |(_, value)| value));
        }
        println!();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gpu_has_a_number() {
        assert_eq!(gpu_number("gpu"), Ok(0));
        assert_eq!(gpu_number("gpu:3"), Ok(3));
        assert!(gpu_number("cuda").is_err() && gpu_number("gpu3").is_err());
    }

    #[test]
    fn the_profile_is_read() {
        let rows = rows("Encode 0.3 s 40.1 GFLOP/s\nSweep 1.25 s\ntotal 1.55 s, peak 910 MiB\n");
        let expected =
            [("encode", "0.3 s 40.1 GFLOP/s"), ("sweep", "1.25 s"), ("total", "1.55 s"), ("peak", "910 MiB")];
        assert_eq!(rows, expected.map(|(name, value)| (name.to_owned(), value.to_owned())));
    }
}
