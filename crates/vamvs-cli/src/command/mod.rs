//! The commands, one a file.

#[cfg(feature = "net")]
mod depth;
mod fuse;
mod info;
#[cfg(feature = "net")]
mod reconstruct;

use anyhow::Result;

use crate::arguments::{Arguments, Command};

/// Runs a command.
pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        #[cfg(feature = "net")]
        Command::Reconstruct(arguments) => reconstruct::run(arguments),
        #[cfg(feature = "net")]
        Command::Depth(arguments) => depth::run(arguments),
        Command::Fuse(arguments) => fuse::run(arguments),
        Command::Info(arguments) => info::run(arguments),
    }
}
