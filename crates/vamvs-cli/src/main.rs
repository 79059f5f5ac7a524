//! The `vamvs` command as a program.

#[cfg(all(feature = "torch", target_os = "linux"))]
mod allocator;
#[cfg(feature = "torch")]
mod openmp;

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(feature = "torch")]
    openmp::wait_asleep();
    #[cfg(all(feature = "torch", target_os = "linux"))]
    allocator::register();
    vamvs_cli::run(std::env::args_os())
}
