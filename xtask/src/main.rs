//! What the repository needs done beside building: `cargo xtask COMMAND`.

mod bench;
mod convert;
mod demo;
mod frames;
mod fuzz;
mod libtorch;
mod maps;
mod paper;
mod picture;
mod pip;
mod real;
mod report_check;
mod setup;
mod soak;
mod step;
mod stress;
mod test;
mod unpack;
mod vamvs;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

/// Set-up, tests and demonstrations of the repository.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
enum Command {
    Setup(setup::Setup),
    Demo(demo::Demo),
    Picture(picture::Picture),
    Real(real::Real),
    Paper(paper::Paper),
    Bench(bench::Bench),
    Stress(stress::Stress),
    Soak(soak::Soak),
    Fuzz(fuzz::Fuzz),
    ReportCheck(report_check::ReportCheck),
    Test(test::Test),
}

fn main() -> ExitCode {
    let done = match Command::parse() {
        Command::Setup(setup) => setup.run(),
        Command::Demo(demo) => demo.run(),
        Command::Picture(picture) => picture.run(),
        Command::Real(real) => real.run(),
        Command::Paper(paper) => paper.run(),
        Command::Bench(bench) => bench.run(),
        Command::Stress(stress) => stress.run(),
        Command::Soak(soak) => soak.run(),
        Command::Fuzz(fuzz) => fuzz.run(),
        Command::ReportCheck(check) => check.run(),
        Command::Test(test) => test.run(),
    };
    if let Err(error) = &done {
        eprintln!("error: {error:#}");
    }
    ExitCode::from(u8::from(done.is_err()))
}

/// The repository's root folder.
fn root() -> PathBuf {
    let mut root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    root.pop();
    root
}
