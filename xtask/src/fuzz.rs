//! `cargo xtask fuzz`: coverage-guided fuzzing of the readers of files.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::step::run;
use crate::{cargo, root};

/// What stable Rust needs to instrument code for libFuzzer: counters of edges, the values of comparisons.
const INSTRUMENTED: &str = "-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing -Ccodegen-units=1";

/// Longest input, bytes: the whole files are shorter.
const LONGEST: usize = 4096;

/// An input may take so many seconds, and so many MiB.
const LIMITS: (usize, usize) = (30, 4096);

/// Try the readers of files with inputs that reach new code (libFuzzer; g++ builds it).
///
/// Each reader begins with small whole files and keeps what reached new code in a folder of its own. An input
/// at which a reader panics, takes 4 GiB or 30 seconds is saved there as crash-…, oom-… or timeout-….
#[derive(Args)]
pub struct Fuzz {
    /// Readers, by the names in crates/vamvs-io/tests/malformed/readers.rs [default: all].
    #[arg(value_name = "READER")]
    readers: Vec<String>,
    /// Minutes a reader.
    #[arg(long, value_name = "N", default_value_t = 10.0)]
    minutes: f64,
    /// Folder of what was found and of the inputs that reached new code [default: target/fuzz/corpus].
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// How it went with a reader.
struct Fuzzed {
    reader: String,
    inputs: u64,
    kept: usize,
    good: bool,
}

impl Fuzz {
    pub fn run(&self) -> Result<()> {
        let (target, host) = (root().join("target/fuzz"), host()?);
        // With a target of its own, build scripts are not instrumented.
        let mut build = cargo(&["build", "--release", "--target", &host]);
        build
            .current_dir(root().join("fuzz"))
            .env("RUSTFLAGS", INSTRUMENTED)
            .env("CARGO_TARGET_DIR", &target);
        run("build", &mut build)?;
        let folder = self.folder.clone().unwrap_or_else(|| target.join("corpus"));
        let readers = if self.readers.is_empty() { all_readers()? } else { self.readers.clone() };
        let mut fuzzed = Vec::new();
        for reader in readers {
            let done = self.fuzz(&target.join(&host).join("release/vamvs-fuzz"), &reader, &folder)?;
            let Fuzzed { reader, inputs, kept, good } = &done;
            println!(
                "{reader:<20} {inputs:>12} inputs {kept:>6} kept  {}",
                if *good { "good" } else { "FOUND" }
            );
            fuzzed.push(done);
        }
        println!("{:<20} {:>12} inputs", "all", fuzzed.iter().map(|done| done.inputs).sum::<u64>());
        let bad: Vec<&str> =
            fuzzed.iter().filter(|done| !done.good).map(|done| done.reader.as_str()).collect();
        ensure!(
            bad.is_empty(),
            "{}: see crash-…, oom-… and timeout-… in {}",
            bad.join(", "),
            folder.display()
        );
        Ok(())
    }

    fn fuzz(&self, program: &Path, reader: &str, folder: &Path) -> Result<Fuzzed> {
        let kept = folder.join(reader);
        fs::create_dir_all(&kept)?;
        let (seconds, megabytes) = LIMITS;
        let output = Command::new(program)
            .env("VAMVS_READER", reader)
            .env("VAMVS_SEEDS", &kept)
            .arg(&kept)
            .arg(format!("-max_total_time={}", (60.0 * self.minutes).ceil()))
            .arg(format!("-artifact_prefix={}/{reader}-", folder.display()))
            .args([
                format!("-max_len={LONGEST}"),
                format!("-timeout={seconds}"),
                format!("-rss_limit_mb={megabytes}"),
            ])
            .args(["-malloc_limit_mb=8192", "-print_final_stats=1", "-verbosity=1", "-use_value_profile=1"])
            .output()
            .with_context(|| format!("{} could not be started", program.display()))?;
        let log = String::from_utf8_lossy(&output.stderr);
        let number = |line: &str| line.strip_prefix("stat::number_of_executed_units:")?.trim().parse().ok();
        if !output.status.success() {
            log.lines()
                .filter(|line| line.contains("panicked") || line.contains("ERROR"))
                .for_each(|l| println!("{l}"));
        }
        Ok(Fuzzed {
            reader: reader.to_owned(),
            inputs: log.lines().find_map(number).unwrap_or(0),
            kept: fs::read_dir(&kept)?.count(),
            good: output.status.success(),
        })
    }
}

/// The name of this machine's target, as the compiler tells it.
fn host() -> Result<String> {
    let told = Command::new("rustc").arg("-vV").output().context("rustc could not be started")?;
    let told = String::from_utf8_lossy(&told.stdout).into_owned();
    let host = told.lines().find_map(|line| line.strip_prefix("host: ")).map(str::to_owned);
    host.context("`rustc -vV` tells no line `host: …`")
}

/// The names of all readers, from the list that tests and fuzzing share.
fn all_readers() -> Result<Vec<String>> {
    let list = root().join("crates/vamvs-io/tests/malformed/readers.rs");
    let text = fs::read_to_string(&list).with_context(|| list.display().to_string())?;
    let entry = |line: &str| {
        let (name, rest) = line.trim().split_once(": fixture::")?;
        rest.contains("|f|").then(|| name.to_owned())
    };
    let readers: Vec<String> = text.lines().filter_map(entry).collect();
    ensure!(!readers.is_empty(), "{}: expected lines NAME: fixture::…, found none", list.display());
    Ok(readers)
}
