//! `cargo xtask publish-check`: checks that the crates work for others when they are published. Publishes nothing.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::files::{create_folder, write};
use crate::step::{root, run, target};
use crate::test::ALL;
use crate::{cargo, setup};

/// The crates that other programs embed. docs/api has a list of the public API of each.
const EMBEDDED: [&str; 6] = ["vamvs", "vamvs-core", "vamvs-eval", "vamvs-fusion", "vamvs-io", "vamvs-refine"];

/// Members of the workspace that are not published.
const OWN: [&str; 4] = ["vamvs-checks", "vamvs-python", "vamvs-tests", "xtask"];

/// Check the crates as others use them: packages, the lowest Rust version, documentation without libtorch,
/// a program outside the workspace, and the list of the public API.
///
/// Needs more than the tests: rustup with the toolchain of `rust-version`, a nightly toolchain, and
/// cargo-public-api.
#[derive(Args)]
pub struct PublishCheck {
    /// Write docs/api anew instead of comparing with it.
    #[arg(long)]
    update_api: bool,
}

impl PublishCheck {
    pub fn run(&self) -> Result<()> {
        setup::ensure_any()?;
        package()?;
        lowest_rust()?;
        documentation_without_libtorch()?;
        outside(&["--features", "torch"], "with libtorch")?;
        outside(&[], "without libtorch")?;
        self.public_api()
    }

    /// Lists the public API of the embedded crates and compares it with docs/api, or writes it there.
    fn public_api(&self) -> Result<()> {
        for name in EMBEDDED {
            println!("── public API of {name}");
            let manifest = format!("crates/{name}/Cargo.toml");
            let mut list = cargo(&["public-api", "-sss", "--color", "never", "--manifest-path", &manifest]);
            let listed = list.output().context("cargo public-api")?;
            let problem = String::from_utf8_lossy(&listed.stderr);
            ensure!(
                listed.status.success(),
                "{problem}\nit needs `cargo install cargo-public-api` and a nightly toolchain"
            );
            self.keep_or_compare(
                &root().join(format!("docs/api/{name}.txt")),
                &String::from_utf8(listed.stdout)?,
            )?;
        }
        Ok(())
    }

    fn keep_or_compare(&self, file: &Path, listed: &str) -> Result<()> {
        if self.update_api {
            return write(file, listed);
        }
        let kept = fs::read_to_string(file).with_context(|| file.display().to_string())?;
        let new = |a: &str, b: &str| -> Vec<String> {
            a.lines().filter(|line| !b.lines().any(|other| other == *line)).map(str::to_owned).collect()
        };
        let (added, gone) = (new(listed, &kept), new(&kept, listed));
        ensure!(
            added.is_empty() && gone.is_empty(),
            "the public API differs from {}; if that is intended, run this with --update-api and describe the change \
             in CHANGELOG.md\n+ {}\n- {}",
            file.display(),
            added.join("\n+ "),
            gone.join("\n- ")
        );
        Ok(())
    }
}

/// Packages all crates that are published, and builds each from its package.
fn package() -> Result<()> {
    let mut package = cargo(&["package", "--workspace", "--allow-dirty"]);
    OWN.iter().for_each(|own| {
        package.args(["--exclude", own]);
    });
    run("package", &mut package)
}

/// Type-checks with the lowest Rust version that Cargo.toml states.
fn lowest_rust() -> Result<()> {
    let manifest = fs::read_to_string(root().join("Cargo.toml")).context("Cargo.toml")?;
    let stated = manifest.lines().find_map(|line| line.strip_prefix("rust-version = \"")?.strip_suffix('"'));
    let version = stated.context("Cargo.toml states no rust-version")?;
    let mut check = rustup(version);
    check.args(["check", "--all-targets", "--target-dir", "target/lowest-rust"]).args(ALL);
    run(&format!("check with Rust {version}"), &mut check)
}

fn documentation_without_libtorch() -> Result<()> {
    let arguments =
        ["doc", "-p", "vamvs", "--no-deps", "--features", "doc-only", "--target-dir", "target/doc-only"];
    let mut doc = cargo(&arguments);
    doc.env("LIBTORCH", "no-libtorch-here").env("RUSTDOCFLAGS", "-D warnings");
    run("document without libtorch", &mut doc)
}

/// Builds and runs `checks/outside`. It must print one line and nothing else, with a median error below 0.02 m.
fn outside(arguments: &[&str], kind: &str) -> Result<()> {
    let folder = root().join("checks/outside");
    let target = target()?.join("outside");
    create_folder(&target)?;
    let mut build = cargo(&["build", "--release"]);
    run(
        &format!("build a program outside of the workspace, {kind}"),
        build.args(arguments).current_dir(&folder).env("CARGO_TARGET_DIR", &target),
    )?;
    let mut program = Command::new(target.join(format!("release/outside{}", std::env::consts::EXE_SUFFIX)));
    let done =
        program.env("LD_LIBRARY_PATH", setup::used_folder().join("lib")).output().context("outside")?;
    let (said, warned) = (String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
    ensure!(done.status.success(), "the program failed: {warned}");
    ensure!(
        warned.is_empty() && said.lines().count() == 1,
        "expected one line, found {said:?} and {warned:?}"
    );
    let error = said.split_whitespace().rev().nth(1).and_then(|error| error.parse::<f64>().ok());
    let Some(error) = error else { bail!("expected the median error, found {said:?}") };
    ensure!(error < 0.02, "expected a median error below 0.02 m, found {said:?}");
    print!("{said}");
    Ok(())
}

fn rustup(version: &str) -> Command {
    let mut command = Command::new("rustup");
    command.args(["run", version, "cargo"]).current_dir(root());
    // The cargo that started this program has set these variables to its own toolchain.
    ["CARGO", "RUSTC", "RUSTDOC", "RUSTUP_TOOLCHAIN"].iter().for_each(|name| {
        command.env_remove(name);
    });
    command
}
