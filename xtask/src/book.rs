//! `cargo xtask book`: builds the documents as a book with mdBook.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::files::{copy, list, remove, write};
use crate::step::{root, run, target};
use crate::{cargo, setup};

/// The version of mdBook to install.
const MDBOOK: &str = "0.5.4";

/// Documents outside `docs/`, and files that documents link to. All of `docs/` is in the book too.
const DOCUMENTS: [&str; 19] = [
    "README.md",
    "ARCHITECTURE.md",
    "CITATION.cff",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "CONVENTIONS.md",
    "models/README.md",
    "crates/vamvs/examples/embed.rs",
    "crates/vamvs/examples/in_memory.rs",
    "crates/vamvs-python/examples/depth_maps.py",
    "workflow/Snakefile",
    "workflow/slurm.sh",
    "crates/vamvs-python/README.md",
    "weights/hold-out.txt",
    "weights/photometric.md",
    "weights/var.md",
    "weights/vis-corr.md",
    "weights/vis-max.md",
    "weights/vis-var.md",
];

/// Build the documents and the command's reference as a book in target/book.
#[derive(Debug, Args)]
pub struct Book {}

impl Book {
    pub fn run(&self) -> Result<()> {
        setup::ensure_any()?;
        run("build", &mut cargo(&["build", "--release", "-p", "vamvs-cli"]))?;
        build(&target()?.join("release").join(format!("vamvs{}", std::env::consts::EXE_SUFFIX)))
    }
}

/// Builds the book. The command reference is the help of `program`, the `vamvs` command.
pub fn build(program: &Path) -> Result<()> {
    let source = target()?.join("book-source");
    remove(&source)?;
    let pages = source.join("src");
    for document in list(&root().join("docs"))?.iter().filter(|path| path.is_file()) {
        let name = document.file_name().context("a document has a name")?;
        copy(document, &pages.join("docs").join(name))?;
    }
    fs::rename(pages.join("docs/SUMMARY.md"), pages.join("SUMMARY.md"))?;
    fs::rename(pages.join("docs/book.toml"), source.join("book.toml"))?;
    DOCUMENTS.iter().try_for_each(|name| copy(&root().join(name), &pages.join(name)))?;
    let mut reference = "# Command reference\n\nWhat `vamvs COMMAND --help` prints.\n".to_owned();
    describe(program, &[], &mut reference)?;
    write(&pages.join("docs/commands.md"), &reference)?;
    check_links(&pages)?;
    let book = target()?.join("book");
    run("book", Command::new(mdbook()?).arg("build").arg(&source).arg("--dest-dir").arg(&book))?;
    println!("the book is {}", book.join("index.html").display());
    Ok(())
}

/// Appends the help of a command and of its subcommands to `page`.
fn describe(program: &Path, command: &[String], page: &mut String) -> Result<()> {
    // Help is wrapped at 100 columns.
    let help = Command::new(program).args(command).arg("--help").env("COLUMNS", "100").output();
    let help = help.with_context(|| format!("{} could not be started", program.display()))?;
    let help = String::from_utf8(help.stdout).context("the help is not valid UTF-8")?;
    ensure!(help.contains("Usage:"), "vamvs {} has no help", command.join(" "));
    let title = [&["vamvs".to_owned()], command].concat().join(" ");
    page.push_str(&format!("\n## {title}\n\n```text\n{}\n```\n", help.trim_end()));
    let below = help.split_once("Commands:\n").map_or("", |(_, below)| below);
    let names = below.lines().map_while(|line| line.strip_prefix("  "));
    // Continuation lines are indented further.
    for name in names.filter(|line| !line.starts_with(' ')).filter_map(|line| line.split(' ').next()) {
        if name != "help" {
            describe(program, &[command, &[name.to_owned()]].concat(), page)?;
        }
    }
    Ok(())
}

/// Checks that every file that a page links to exists.
fn check_links(pages: &Path) -> Result<()> {
    let mut folders = vec![pages.to_owned()];
    while let Some(folder) = folders.pop() {
        for path in list(&folder)? {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
                for link in links(&text) {
                    ensure!(
                        folder.join(link).exists(),
                        "{} links to {link}, which does not exist",
                        path.display()
                    );
                }
            }
        }
    }
    Ok(())
}

/// The paths of the files that a page links to, without `#…`. Web addresses do not count.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let targets = text.split("](").skip(1).filter_map(|after| after.split([')', '#']).next());
    targets.filter(|link| !link.is_empty() && !link.contains("://"))
}

/// The path of mdBook, which is installed in the target folder at the first call.
fn mdbook() -> Result<PathBuf> {
    let tools = target()?.join("book-tools");
    let program = tools.join("bin").join(format!("mdbook{}", std::env::consts::EXE_SUFFIX));
    if !program.exists() {
        let mut install = cargo(&[
            "install",
            "mdbook",
            "--version",
            MDBOOK,
            "--locked",
            "--debug",
            "--no-default-features",
        ]);
        install.arg("--root").arg(&tools).env("CARGO_TARGET_DIR", tools.join("build"));
        run("build mdBook", &mut install)?;
        remove(&tools.join("build"))?;
    }
    Ok(program)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_to_files_are_found_and_others_are_not() {
        let text = "[a](b.md), ![p](c/d.png) [e](f.md#g) [h](https://i.j) [k](#l)";
        assert_eq!(links(text).collect::<Vec<_>>(), ["b.md", "c/d.png", "f.md"]);
    }
}
