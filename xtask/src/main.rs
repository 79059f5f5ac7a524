//! What the repository needs done beside building: `cargo xtask COMMAND`.
//!
//! This program starts others and needs none of the workspace's crates, so that it is compiled in seconds. What looks
//! at depth maps and clouds is in `vamvs-checks`, which is built with the `vamvs` command.

mod bench;
mod book;
mod check;
mod dist;
mod files;
mod fuzz;
mod libtorch;
mod pip;
mod publish;
mod python;
mod setup;
mod step;
mod test;
mod unpack;
mod workflow;

use std::ffi::OsString;
use std::process::{self, ExitCode};

use clap::Parser;

use check::Check;
use step::root;

/// Set-up, tests and demonstrations of the repository.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", disable_help_subcommand = true)]
enum Command {
    Setup(setup::Setup),
    /// Reconstruct a rendered still life, compare the cloud with the ground truth and show it all on one page.
    Demo(Check),
    Test(test::Test),
    Dist(dist::Dist),
    Wheel(python::Wheel),
    PublishCheck(publish::PublishCheck),
    Book(book::Book),
    Bench(bench::Bench),
    Fuzz(fuzz::Fuzz),
    Cluster(workflow::Cluster),
    /// Render a PLY cloud to a PNG, seen from where most of its surface is visible.
    Picture(Check),
    /// Reconstruct real photographs and show what comes out.
    Real(Check),
    /// Run the paper's experiments on a small synthetic set and write its tables, the paper's figures beside ours.
    Paper(Check),
    /// Fuse a scene of many depth maps within several memory budgets, and compare results, time and memory.
    Stress(Check),
    /// Plan a run of many aerial photographs, and tell time and memory.
    Aerial(Check),
    /// Run small random reconstructions, disturb them, and compare what they end with.
    Soak(Check),
    /// Open a report in headless Chromium: fail on any message on its console or an empty cloud, take a picture.
    ReportCheck(Check),
}

fn main() -> ExitCode {
    let done = match Command::parse() {
        Command::Setup(setup) => setup.run(),
        Command::Test(test) => test.run(),
        Command::Dist(dist) => dist.run(),
        Command::Wheel(wheel) => wheel.run(),
        Command::PublishCheck(check) => check.run(),
        Command::Book(book) => book.run(),
        Command::Bench(bench) => bench.run(),
        Command::Fuzz(fuzz) => fuzz.run(),
        Command::Cluster(cluster) => cluster.run(),
        Command::Demo(check) => check.run("demo"),
        Command::Picture(check) => check.run("picture"),
        Command::Real(check) => check.run("real"),
        Command::Paper(check) => check.run("paper"),
        Command::Stress(check) => check.run("stress"),
        Command::Aerial(check) => check.run("aerial"),
        Command::Soak(check) => check.run("soak"),
        Command::ReportCheck(check) => check.run("report-check"),
    };
    if let Err(error) = &done {
        eprintln!("error: {error:#}");
    }
    ExitCode::from(u8::from(done.is_err()))
}

/// The Cargo that runs this program, in the repository's root.
fn cargo(arguments: &[&str]) -> process::Command {
    let mut command =
        process::Command::new(std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")));
    command.args(arguments).current_dir(root());
    command
}
