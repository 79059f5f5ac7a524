//! `vamvs completions` and `vamvs man`: the command line told to shells and to `man`.

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
            save(&command, "vamvs", folder)
        }
    }
}

/// Writes the pages of a command and of those below it, `NAME.1`.
fn save(command: &clap::Command, name: &str, folder: &Path) -> Result<()> {
    let text = page(&command.clone().name(name.to_owned()))?;
    atomic::write(&folder.join(format!("{name}.1")), |out| out.write_all(&text))?;
    let commands = command.get_subcommands().filter(|command| command.get_name() != "help");
    commands
        .into_iter()
        .try_for_each(|command| save(command, &format!("{name}-{}", command.get_name()), folder))
}

fn page(command: &clap::Command) -> Result<Vec<u8>> {
    let mut text = Vec::new();
    Man::new(command.clone()).render(&mut text).context("the manual cannot be made")?;
    Ok(text)
}

/// Prints; a reader that has seen enough is no error.
fn print(text: &[u8]) -> Result<()> {
    match std::io::stdout().write_all(text) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("cannot print"),
        _ => Ok(()),
    }
}
