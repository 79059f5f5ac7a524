//! The `vamvs` command: photographs with known cameras in, one dense, coloured cloud out.

#[macro_use]
mod output;

mod arguments;
mod command;
mod interrupt;
mod progress;
mod settings;
mod timing;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

/// Runs the command with these arguments, of which the first is the name of the program. Wrong
/// arguments and `--help` end the process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = arguments::Arguments::parse_from(arguments);
    let run = || interrupt::watch(arguments.command.resumption()).and_then(|()| command::run(&arguments));
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            warn!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
