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
    /// The package `vamvs-torch` instead, the extra `torch` of `vamvs`: with it that has TorchScript modules, GPUs by CUDA and training, by
    /// the libtorch of the package torch.
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
        let folder = if self.torch { package().join("torch") } else { package() };
        maturin.args(["build", "--release", "--out"]).arg(&out).current_dir(folder);
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

/// Puts both packages and a stand-in for torch into the folder of installed packages `site`.
fn assemble(site: &Path) -> Result<()> {
    let [vamvs, with_torch, torch] = ["vamvs", "vamvs_torch", "torch"].map(|name| site.join(name));
    [&vamvs, &with_torch, &torch].into_iter().try_for_each(|folder| remove(folder))?;
    copy(&package().join("python/vamvs/__init__.py"), &vamvs.join("__init__.py"))?;
    copy(&package().join("torch/python/vamvs_torch/__init__.py"), &with_torch.join("__init__.py"))?;
    copy(&target()?.join("debug/lib_vamvs.so"), &with_torch.join("_vamvs.abi3.so"))?;
    copy(&package().join("tests/no_torch.py"), &torch.join("__init__.py"))?;
    setup::symlink(&setup::used_folder().join("lib"), &torch.join("lib"))
}

fn package() -> PathBuf {
    root().join("crates/vamvs-python")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extra_is_of_the_same_version() {
        let about = std::fs::read_to_string(package().join("pyproject.toml")).unwrap();
        let pinned = format!("torch = [\"vamvs-torch=={}\"]", env!("CARGO_PKG_VERSION"));
        assert!(about.contains(&pinned), "expected {pinned}");
    }
}
