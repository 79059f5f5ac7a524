//! `vamvs completions` and `vamvs man`: shell completions and manual pages.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use clap::CommandFactory;
use clap_mangen::Man;
use vamvs::io::atomic;

use crate::arguments::{Arguments, CompletionsArguments, ManArguments};

/// Runs `completions`.
pub fn completions(arguments: &CompletionsArguments) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut Arguments::command(), "vamvs", &mut text);
    print(&text)
}

/// Runs `man`.
pub fn run(arguments: &ManArguments) -> Result<()> {
    let mut command = Arguments::command();
    command.build();
    match &arguments.folder {
        None => print(&page(&command)?),
        Some(folder) => {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("{} cannot be made", folder.display()))?;
            save(&command, folder)
        }
    }
}

/// Writes the pages of a command and of those below it, each named as `vamvs-eval-cloud.1`.
fn save(command: &clap::Command, folder: &Path) -> Result<()> {
    let (name, text) = (command.get_display_name().unwrap_or("vamvs"), page(command)?);
    atomic::write(&folder.join(format!("{name}.1")), |out| out.write_all(&text))?;
    let mut commands = command.get_subcommands().filter(|command| command.get_name() != "help");
    commands.try_for_each(|command| save(command, folder))
}

fn page(command: &clap::Command) -> Result<Vec<u8>> {
    let mut text = Vec::new();
    Man::new(command.clone()).render(&mut text).context("the manual cannot be made")?;
    Ok(text)
}

/// Prints; a closed pipe is no error.
fn print(text: &[u8]) -> Result<()> {
    match std::io::stdout().write_all(text) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("cannot print"),
        _ => Ok(()),
    }
}
