//! The `vamvs` command as a program.

#[cfg(feature = "net")]
mod openmp;

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(feature = "net")]
    openmp::wait_asleep();
    vamvs_cli::run(std::env::args_os())
}
