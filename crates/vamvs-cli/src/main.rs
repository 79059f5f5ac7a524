//! The `vamvs` command as a program.

#[cfg(all(feature = "net", target_os = "linux"))]
mod allocator;
#[cfg(feature = "net")]
mod openmp;

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(feature = "net")]
    openmp::wait_asleep();
    #[cfg(all(feature = "net", target_os = "linux"))]
    allocator::register();
    vamvs_cli::run(std::env::args_os())
}
