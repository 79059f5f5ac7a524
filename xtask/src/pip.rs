//! Downloads and installs Python wheels with pip.

use std::io::ErrorKind;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};

use crate::libtorch::Wheel;

/// Checks that `python3` is there and has pip.
pub fn check() -> Result<()> {
    let quiet =
        python().args(["-m", "pip", "--version"]).stdout(Stdio::null()).stderr(Stdio::null()).status();
    match quiet {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => bail!(
            "python3 has no pip, which downloads libtorch. Install it (Debian, Ubuntu: \
             `sudo apt install python3-pip`; anywhere: `python3 -m ensurepip`) and run the command again"
        ),
        Err(error) if error.kind() == ErrorKind::NotFound => bail!(
            "there is no python3 in PATH; its pip downloads libtorch. Install Python 3 with pip (Debian, \
             Ubuntu: `sudo apt install python3 python3-pip`) and run the command again"
        ),
        Err(error) => Err(error).context("python3 could not be started"),
    }
}

/// Downloads one wheel into a folder, for the wheel's platform whatever Python and platform pip itself runs on.
pub fn download(wheel: &Wheel, folder: &Path) -> Result<()> {
    let mut command = python();
    command.args(["-m", "pip", "download", "--no-deps", "--only-binary=:all:", "--python-version", "3.12"]);
    command.args(["--platform", wheel.platform, "--dest"]).arg(folder).arg(wheel.requirement);
    let status = command.status().context("python3 could not be started")?;
    ensure!(
        status.success(),
        "pip could not download {} (its message is above). Is this machine online, and is there space on the \
         disk? To set up offline, put {} into {} and run the command again",
        wheel.requirement,
        wheel.file,
        folder.display()
    );
    Ok(())
}

/// Installs packages and their dependencies into a folder. `room` is the disk space that this needs, for the message.
pub fn install(requirements: &[&str], folder: &Path, room: &str) -> Result<()> {
    let mut command = python();
    command.args(["-m", "pip", "install", "--quiet", "--only-binary=:all:", "--upgrade", "--target"]);
    let status = command.arg(folder).args(requirements).status().context("python3 could not be started")?;
    ensure!(
        status.success(),
        "pip could not install {} (its message is above). Is this machine online, and are there {room} free on \
         the disk?",
        requirements.join(", ")
    );
    Ok(())
}

fn python() -> Command {
    Command::new("python3")
}
