//! `cargo xtask dist`: packs the command with all that it needs to run on a machine where nothing is installed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::Value;

use crate::cargo;
use crate::files::{copy, create_folder, list, remove, write};
use crate::step::{root, run, target};

/// Pack the `vamvs` command, which needs no libtorch, with man pages, completions and licences into a .tar.gz.
#[derive(Args)]
pub struct Dist {
    /// Folder for the archive and for the folder that it is packed from.
    #[arg(long, value_name = "DIR", default_value = "target/dist")]
    out: PathBuf,
}

impl Dist {
    pub fn run(&self) -> Result<()> {
        ensure!(cfg!(target_os = "linux"), "cargo xtask dist works on Linux only");
        run("build", &mut cargo(&["build", "--release", "-p", "vamvs-cli"]))?;
        let name = format!("vamvs-{}-{}-linux", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH);
        let (out, folder) = (root().join(&self.out), root().join(&self.out).join(&name));
        remove(&folder)?;
        fill(&folder)?;
        let archive = out.join(format!("{name}.tar.gz"));
        let mut tar = Command::new("tar");
        tar.arg("--create").arg("--gzip").arg("--file").arg(&archive).arg("--directory").arg(&out).arg(&name);
        run("pack", &mut tar)?;
        let size = fs::metadata(&archive).context("the archive")?.len();
        println!("{}: {:.0} MB", archive.display(), size as f64 / 1e6);
        Ok(())
    }
}

/// Fills the folder that is packed.
fn fill(folder: &Path) -> Result<()> {
    let program = folder.join("bin/vamvs");
    copy(&target()?.join("release/vamvs"), &program)?;
    // Debug information, for the line numbers of panics, is most of the size. If there is no `strip`, the program is
    // larger and otherwise the same.
    Command::new("strip").arg("--strip-debug").arg(&program).status().ok();
    for name in ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"] {
        copy(&root().join(name), &folder.join(name))?;
    }
    write(&folder.join("LICENSES.txt"), &licences()?)?;
    let manual = folder.join("share/man/man1");
    create_folder(&manual)?;
    run("man pages", Command::new(&program).arg("man").arg(&manual))?;
    let shells = [
        ("bash", "bash-completion/completions/vamvs"),
        ("zsh", "zsh/site-functions/_vamvs"),
        ("fish", "fish/vendor_completions.d/vamvs.fish"),
    ];
    for (shell, place) in shells {
        let completions = Command::new(&program).args(["completions", shell]).output().context("vamvs")?;
        ensure!(completions.status.success(), "vamvs completions {shell} failed");
        write(&folder.join("share").join(place), &String::from_utf8_lossy(&completions.stdout))?;
    }
    Ok(())
}

/// The text of LICENSES.txt: the licence and its text for each crate in the command.
fn licences() -> Result<String> {
    let output =
        cargo(&["metadata", "--format-version", "1", "--filter-platform", "x86_64-unknown-linux-gnu"])
            .output()?;
    ensure!(output.status.success(), "cargo metadata failed: {}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).context("cargo metadata")?;
    let used = used_by(&metadata, "vamvs-cli");
    let mut text = String::from("bin/vamvs contains these crates:\n");
    for package in metadata["packages"].as_array().into_iter().flatten() {
        let of = |key: &str| package[key].as_str().unwrap_or_default();
        if package["source"].is_null() || !used.contains(&of("id")) {
            continue;
        }
        text.push_str(&format!(
            "\n{0}\n{1} {2}: {3}\n{0}\n",
            "=".repeat(80),
            of("name"),
            of("version"),
            of("license")
        ));
        text.push_str(&texts(Path::new(of("manifest_path")).parent().context("a manifest is in a folder")?)?);
    }
    Ok(text)
}

/// The ids of a package and of all its dependencies, direct and indirect, without build and dev dependencies.
fn used_by<'a>(metadata: &'a Value, name: &str) -> Vec<&'a str> {
    let nodes = || metadata["resolve"]["nodes"].as_array().into_iter().flatten();
    let root = metadata["packages"].as_array().into_iter().flatten().find(|package| package["name"] == name);
    let mut used: Vec<&str> = root.and_then(|package| package["id"].as_str()).into_iter().collect();
    let mut next = 0;
    while let Some(&id) = used.get(next) {
        next += 1;
        let node = nodes().find(|node| node["id"] == id);
        for dependency in node.into_iter().flat_map(|node| node["deps"].as_array().into_iter().flatten()) {
            let kinds = || dependency["dep_kinds"].as_array().into_iter().flatten();
            let package = dependency["pkg"].as_str().unwrap_or_default();
            if kinds().any(|kind| kind["kind"].is_null()) && !used.contains(&package) {
                used.push(package);
            }
        }
    }
    used
}

/// The texts of all licence files in a crate's folder, joined.
fn texts(folder: &Path) -> Result<String> {
    let is_licence = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_uppercase();
        path.is_file()
            && ["LICENSE", "LICENCE", "COPYING", "NOTICE"].iter().any(|start| name.starts_with(start))
    };
    let files: Vec<PathBuf> = list(folder)?.into_iter().filter(is_licence).collect();
    let read = |path: &PathBuf| fs::read(path).with_context(|| path.display().to_string());
    let texts: Vec<String> = files
        .iter()
        .map(|path| Ok(String::from_utf8_lossy(&read(path)?).into_owned()))
        .collect::<Result<_>>()?;
    Ok(texts.join("\n"))
}
