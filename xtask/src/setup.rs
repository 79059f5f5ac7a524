//! `cargo xtask setup`: brings the pinned libtorch into `.libtorch/`.
//!
//! Everything is made under another name and renamed when it is complete; a stamp, written last, says
//! so. A set-up that was interrupted starts again from the wheels that it already has.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::files::{create_folder, remove, replace, write};
use crate::{libtorch, pip, root, unpack};

/// Bring the pinned libtorch into `.libtorch/`, where every build finds it.
///
/// Set LIBTORCH to use a libtorch 2.11.0 of your own instead.
#[derive(Args)]
pub struct Setup {
    /// The libtorch for NVIDIA GPUs: 4.7 GB instead of 0.5.
    #[arg(long)]
    cuda: bool,
}

/// What kind of libtorch is in place; the stamp's text tells it.
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

/// Where the pinned libtorch is.
pub fn own_folder() -> PathBuf {
    root().join(".libtorch")
}

/// Where the libtorch is that builds use: the pinned one, or the user's.
pub fn used_folder() -> PathBuf {
    let folder = own_folder();
    users_libtorch(&folder).unwrap_or(folder)
}

/// Sets up whatever libtorch a build needs, unless there is one.
pub fn ensure_any() -> Result<()> {
    Setup { cuda: false }.run()
}

fn ensure_libtorch(folder: &Path, kind: Kind) -> Result<()> {
    if let Some(own) = users_libtorch(folder) {
        println!("LIBTORCH is set to {}: that libtorch is used, nothing to set up", own.display());
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

/// The file that says that all is in place, and what.
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

/// A libtorch that the user chose by LIBTORCH; Cargo itself sets it to the repository's folder.
fn users_libtorch(folder: &Path) -> Option<PathBuf> {
    let given = PathBuf::from(std::env::var_os("LIBTORCH")?);
    let same = given == folder
        || given.canonicalize().is_ok_and(|given| folder.canonicalize().is_ok_and(|f| f == given));
    (!same && !given.as_os_str().is_empty()).then_some(given)
}

/// The complete libtorch in place that serves for `wanted`; the one for CUDA serves for both.
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

/// Downloads a wheel, unless it is there, and checks it.
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
        "pip brought {found} of the name {}, where the one with SHA-256 {} was expected. Does a mirror or \
         PIP_FIND_LINKS offer another build?",
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

/// Makes a link.
#[cfg(unix)]
pub fn symlink(target: &Path, link: &Path) -> Result<()> {
    std::os::unix::fs::symlink(target, link).with_context(|| format!("{} could not be made", link.display()))
}

/// There is no libtorch to be set up elsewhere.
#[cfg(not(unix))]
pub fn symlink(_: &Path, _: &Path) -> Result<()> {
    anyhow::bail!("the libtorch for CUDA is set up on Linux only")
}
