//! `cargo xtask setup`: installs the pinned libtorch in `.libtorch/`.
//!
//! Folders are filled under another name and renamed when they are complete. A stamp file, written last, marks a
//! complete set-up. An interrupted set-up starts again and uses the wheels that it has already downloaded.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::files::{create_folder, remove, replace, write};
use crate::{libtorch, pip, root, unpack};

/// Install the pinned libtorch in `.libtorch/`, where every build finds it.
///
/// Set LIBTORCH to use a libtorch 2.11.0 of your own instead.
#[derive(Args)]
pub struct Setup {
    /// Install the libtorch for NVIDIA GPUs: 4.7 GB instead of 0.5 GB.
    #[arg(long)]
    cuda: bool,
}

/// The kind of libtorch, recorded in the stamp file.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Cpu,
    Cuda,
}

impl Setup {
    pub fn run(&self) -> Result<()> {
        ensure_libtorch(&own_folder(), if self.cuda { Kind::Cuda } else { Kind::Cpu })
    }
}

/// The folder of the pinned libtorch.
pub fn own_folder() -> PathBuf {
    root().join(".libtorch")
}

/// The folder of the libtorch that builds use: the user's if LIBTORCH names one, else the pinned one.
pub fn used_folder() -> PathBuf {
    let folder = own_folder();
    users_libtorch(&folder).unwrap_or(folder)
}

/// Sets up the libtorch for the CPU, unless there is a libtorch that builds can use.
pub fn ensure_any() -> Result<()> {
    Setup { cuda: false }.run()
}

fn ensure_libtorch(folder: &Path, kind: Kind) -> Result<()> {
    if let Some(own) = users_libtorch(folder) {
        println!("LIBTORCH is set to {}: builds use that libtorch, nothing to set up", own.display());
        return Ok(());
    }
    if let Some(present) = present(folder, kind) {
        println!("libtorch {} ({}) is in place", libtorch::VERSION, present.name());
        return Ok(());
    }
    ensure!(
        cfg!(all(target_os = "linux", target_arch = "x86_64")),
        "the pinned libtorch is for Linux on x86-64. On this machine, install libtorch {} and set LIBTORCH to \
         its folder",
        libtorch::VERSION
    );
    pip::check()?;
    let start = Instant::now();
    println!("setting up libtorch {} ({}) in {}", libtorch::VERSION, kind.name(), folder.display());
    create_folder(folder)?;
    remove(&folder.join(STAMP))?;
    match kind {
        Kind::Cpu => install_cpu(folder)?,
        Kind::Cuda => install_cuda(folder)?,
    }
    write(&folder.join("build-version"), &format!("{}\n", libtorch::VERSION))?;
    write(&folder.join(STAMP), &kind.stamp())?;
    println!("done in {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// Name of the file that marks a complete set-up and names its kind.
const STAMP: &str = "stamp";

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Cpu => "CPU",
            Self::Cuda => "CUDA",
        }
    }

    fn stamp(self) -> String {
        format!("libtorch {} {}\n", libtorch::VERSION, self.name())
    }
}

/// The libtorch that the user chose with LIBTORCH. `None` if LIBTORCH is empty or `folder`, to which
/// `.cargo/config.toml` sets it by default.
fn users_libtorch(folder: &Path) -> Option<PathBuf> {
    let given = PathBuf::from(std::env::var_os("LIBTORCH")?);
    let same = given == folder
        || given.canonicalize().is_ok_and(|given| folder.canonicalize().is_ok_and(|f| f == given));
    (!same && !given.as_os_str().is_empty()).then_some(given)
}

/// The kind of the libtorch that is completely set up in `folder`, if it serves as `wanted`. The one for CUDA serves as
/// both.
fn present(folder: &Path, wanted: Kind) -> Option<Kind> {
    let stamp = fs::read_to_string(folder.join(STAMP)).ok()?;
    let kind = [Kind::Cpu, Kind::Cuda].into_iter().find(|kind| kind.stamp() == stamp)?;
    (kind == wanted || kind == Kind::Cuda).then_some(kind)
}

fn install_cpu(folder: &Path) -> Result<()> {
    let (wheels, partial) = (folder.join("wheels"), folder.join("partial"));
    create_folder(&wheels)?;
    remove(&partial)?;
    for wheel in &libtorch::WHEELS {
        fetch(wheel, &wheels)?;
        println!("unpacking {}", wheel.file);
        unpack::unpack(&wheels.join(wheel.file), wheel.parts, &partial)?;
    }
    let (name, text) = libtorch::LINKER_SCRIPT;
    write(&partial.join(name), text)?;
    for part in ["lib", "include", "licenses"] {
        replace(&folder.join(part), &partial.join(part))?;
    }
    remove(&partial)?;
    remove(&folder.join("site"))?;
    remove(&wheels)
}

/// Downloads a wheel unless it is there, and verifies its SHA-256.
fn fetch(wheel: &libtorch::Wheel, wheels: &Path) -> Result<()> {
    let file = wheels.join(wheel.file);
    if unpack::has_sha256(&file, wheel.sha256)? {
        return Ok(());
    }
    remove(&file)?;
    pip::download(wheel, wheels)?;
    if unpack::has_sha256(&file, wheel.sha256)? {
        return Ok(());
    }
    let found = if file.exists() { "another file" } else { "no file" };
    remove(&file)?;
    anyhow::bail!(
        "pip downloaded {found} named {}, expected one with SHA-256 {}. Does a mirror or PIP_FIND_LINKS offer \
         another build?",
        wheel.file,
        wheel.sha256
    )
}

fn install_cuda(folder: &Path) -> Result<()> {
    let (site, partial) = (folder.join("site"), folder.join("partial"));
    remove(&partial)?;
    pip::install(&[libtorch::WHEELS[0].requirement], &partial, "10 GB")?;
    replace(&site, &partial)?;
    for part in ["lib", "include"] {
        let link = folder.join(part);
        remove(&link)?;
        symlink(&Path::new("site/torch").join(part), &link)?;
    }
    remove(&folder.join("wheels"))
}

/// Makes a symbolic link at `link` that points to `target`.
#[cfg(unix)]
pub fn symlink(target: &Path, link: &Path) -> Result<()> {
    std::os::unix::fs::symlink(target, link).with_context(|| format!("{} could not be made", link.display()))
}

/// Always an error: libtorch is set up on Linux only.
#[cfg(not(unix))]
pub fn symlink(_: &Path, _: &Path) -> Result<()> {
    anyhow::bail!("the libtorch for CUDA is set up on Linux only")
}
