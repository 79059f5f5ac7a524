//! `cargo xtask fuzz`: coverage-guided fuzzing of the file readers.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::step::run;
use crate::{cargo, root};

/// Compiler flags with which stable Rust instruments code for libFuzzer: it counts edges and records compared values.
const INSTRUMENTED: &str = "-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing -Ccodegen-units=1";

/// Longest input, bytes. The seeds, small valid files, are shorter.
const LONGEST: usize = 4096;

/// Limits of one input: seconds and MiB.
const LIMITS: (usize, usize) = (30, 4096);

/// Fuzz the file readers with libFuzzer, which g++ builds.
///
/// Each reader starts from small valid files. Inputs that reach new code are kept in a folder for each reader. An
/// input at which a reader panics, exceeds 4 GiB or exceeds 30 seconds is saved in --folder as READER-crash-…,
/// READER-oom-… or READER-timeout-….
#[derive(Args)]
pub struct Fuzz {
    /// Names of readers, from crates/vamvs-io/tests/malformed/readers.rs [default: all].
    #[arg(value_name = "READER")]
    readers: Vec<String>,
    /// Minutes for each reader.
    #[arg(long, value_name = "N", default_value_t = 10.0)]
    minutes: f64,
    /// Folder for inputs that failed and inputs that reached new code [default: target/fuzz/corpus].
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// The result of a reader.
struct Fuzzed {
    reader: String,
    /// Number of inputs tried.
    inputs: u64,
    /// Number of inputs in the reader's folder.
    kept: usize,
    /// Whether no input failed.
    good: bool,
}

impl Fuzz {
    pub fn run(&self) -> Result<()> {
        let (target, host) = (root().join("target/fuzz"), host()?);
        // With --target, RUSTFLAGS do not apply to build scripts, which must not be instrumented.
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

/// The target triple of this machine, from `rustc -vV`.
fn host() -> Result<String> {
    let told = Command::new("rustc").arg("-vV").output().context("rustc could not be started")?;
    let told = String::from_utf8_lossy(&told.stdout).into_owned();
    let host = told.lines().find_map(|line| line.strip_prefix("host: ")).map(str::to_owned);
    host.context("`rustc -vV` prints no line `host: …`")
}

/// The names of all readers, from the source file that the tests and the fuzzer share.
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
