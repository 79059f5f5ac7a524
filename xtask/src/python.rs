//! `cargo xtask wheel`, and the tests of the Python package.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;
use clap::Args;

use crate::files::{copy, remove};
use crate::step::{root, run, target};
use crate::test::ALL;
use crate::{cargo, pip, setup};

/// Build the Python package `vamvs` as a wheel.
#[derive(Args)]
pub struct Wheel {
    /// With TorchScript modules, GPUs by CUDA and training. That wheel uses the libtorch of the package torch: `pip install
    /// "vamvs[torch]"` installs it.
    #[arg(long)]
    torch: bool,
    /// Folder for the wheel.
    #[arg(long, value_name = "DIR", default_value = "target/wheels")]
    out: PathBuf,
}

impl Wheel {
    pub fn run(&self) -> Result<()> {
        if self.torch {
            setup::ensure_any()?;
        }
        let tools = target()?.join("python-tools");
        pip::install(&["maturin==1.9.6"], &tools, "100 MB")?;
        let out = root().join(&self.out);
        let mut maturin =
            Command::new(tools.join("bin").join(format!("maturin{}", std::env::consts::EXE_SUFFIX)));
        maturin.args(["build", "--release", "--out"]).arg(&out).current_dir(package());
        if self.torch {
            maturin.args(["--features", "torch"]);
        }
        // maturin builds with other flags: in a shared target folder each would make the other rebuild everything.
        run("wheel", maturin.env("PYTHONPATH", &tools).env("CARGO_TARGET_DIR", target()?.join("wheel")))?;
        println!("the wheel is in {}", out.display());
        Ok(())
    }
}

/// Tests the package as it is in the repository. The libtorch of [`setup`] stands in for that of torch.
pub fn test() -> Result<()> {
    // The whole workspace with its examples, which use development dependencies as the tests do. Anything less would
    // build the dependencies with other features, and compile most of them again.
    run("build the Python package", cargo(&["build", "--lib", "--bins", "--examples"]).args(ALL))?;
    let site = target()?.join("python-site");
    pip::install(&["numpy>=1.24,<3", "pytest>=8,<10"], &site, "200 MB")?;
    assemble(&site)?;
    let mut pytest = Command::new("python3");
    pytest.args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"]).current_dir(package());
    run("test the Python package", pytest.env("PYTHONPATH", &site).env("PYTHONDONTWRITEBYTECODE", "1"))
}

/// Puts the package and a stand-in for torch into the folder of installed packages `site`.
fn assemble(site: &Path) -> Result<()> {
    let (vamvs, torch) = (site.join("vamvs"), site.join("torch"));
    [&vamvs, &torch].into_iter().try_for_each(|folder| remove(folder))?;
    copy(&target()?.join("debug/lib_vamvs.so"), &vamvs.join("_vamvs.abi3.so"))?;
    copy(&package().join("python/vamvs/__init__.py"), &vamvs.join("__init__.py"))?;
    copy(&package().join("tests/no_torch.py"), &torch.join("__init__.py"))?;
    setup::symlink(&setup::used_folder().join("lib"), &torch.join("lib"))
}

fn package() -> PathBuf {
    root().join("crates/vamvs-python")
}
