//! The demo and the long-running checks of the built `vamvs` command. `cargo xtask COMMAND` builds `vamvs` and this
//! program, then runs it.

mod aerial;
mod convert;
mod demo;
mod files;
mod frames;
mod maps;
mod paper;
mod picture;
mod real;
mod report_check;
mod soak;
#[path = "../../xtask/src/step.rs"]
mod step;
mod stress;
mod vamvs;

use std::process::ExitCode;

use clap::Parser;

/// The demo and the long-running checks of the repository.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
enum Command {
    Demo(demo::Demo),
    Picture(picture::Picture),
    Real(real::Real),
    Paper(paper::Paper),
    Stress(stress::Stress),
    Aerial(aerial::Aerial),
    Soak(soak::Soak),
    ReportCheck(report_check::ReportCheck),
}

fn main() -> ExitCode {
    let done = match Command::parse() {
        Command::Demo(demo) => demo.run(),
        Command::Picture(picture) => picture.run(),
        Command::Real(real) => real.run(),
        Command::Paper(paper) => paper.run(),
        Command::Stress(stress) => stress.run(),
        Command::Aerial(aerial) => aerial.run(),
        Command::Soak(soak) => soak.run(),
        Command::ReportCheck(check) => check.run(),
    };
    if let Err(error) = &done {
        eprintln!("error: {error:#}");
    }
    ExitCode::from(u8::from(done.is_err()))
}
