//! The `vamvs` command: photographs with known cameras in, one dense, coloured cloud out.

mod arguments;
mod command;
#[cfg(feature = "net")]
mod heap;
mod interrupt;
#[cfg(feature = "net")]
mod openmp;
mod progress;
mod settings;
mod timing;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    #[cfg(feature = "net")]
    openmp::wait_asleep();
    let arguments = arguments::Arguments::parse();
    let run = || interrupt::watch(arguments.command.resumption()).and_then(|()| command::run(&arguments));
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
