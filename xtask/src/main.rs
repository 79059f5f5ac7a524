//! `cargo xtask COMMAND`: the repository's tasks besides building, such as set-up, tests and packaging.
//!
//! This program starts other programs and depends on no crate of the workspace, so that it compiles in seconds.
//! Commands that read depth maps and clouds are in `vamvs-checks`, which is built together with the `vamvs` command.

mod bench;
mod book;
mod check;
mod dist;
mod files;
mod fuzz;
mod libtorch;
mod pip;
mod platforms;
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

/// Set-up, tests, packaging and demonstrations of the repository.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", disable_help_subcommand = true)]
enum Command {
    Setup(setup::Setup),
    /// Reconstruct a rendered still life, compare the result with the ground truth and show all on one page.
    Demo(Check),
    Test(test::Test),
    Dist(dist::Dist),
    Wheel(python::Wheel),
    PublishCheck(publish::PublishCheck),
    Book(book::Book),
    Bench(bench::Bench),
    Fuzz(fuzz::Fuzz),
    Cluster(workflow::Cluster),
    /// Render a PLY cloud to a PNG, from a viewpoint that sees most of its surface.
    Picture(Check),
    /// Reconstruct real photographs, draw the results and write a table of them.
    Real(Check),
    /// Run the paper's experiments on small synthetic sets and write its tables, with the paper's own figures.
    Paper(Check),
    /// Fuse a scene of many depth maps within several memory budgets, and compare results, time and memory.
    Stress(Check),
    /// Plan a run of many aerial photographs with `vamvs tasks`, and print its time and memory.
    Aerial(Check),
    /// Disturb small random reconstructions, and compare their results with those of undisturbed runs.
    Soak(Check),
    /// Open a report in headless Chromium and take a screenshot; fail on an empty cloud or any console message.
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
        Command::Paper(check) => check.run_with_libtorch("paper"),
        Command::Stress(check) => check.run("stress"),
        Command::Aerial(check) => check.run("aerial"),
        Command::Soak(check) => check.run_with_synth("soak"),
        Command::ReportCheck(check) => check.run("report-check"),
    };
    if let Err(error) = &done {
        eprintln!("error: {error:#}");
    }
    ExitCode::from(u8::from(done.is_err()))
}

/// A command of the Cargo that started this program, run in the repository's root.
fn cargo(arguments: &[&str]) -> process::Command {
    let mut command =
        process::Command::new(std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")));
    command.args(arguments).current_dir(root());
    command
}
