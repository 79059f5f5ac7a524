//! `cargo xtask soak`: disturbs small random runs and checks that they end with the results of undisturbed ones.

mod case;
mod check;
mod disturb;
mod process;
mod random;
mod scene;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::vamvs;
use case::Case;
use process::{Ended, Program};
use scene::Scene;

/// Disturb small random reconstructions, and compare their results with those of undisturbed runs.
///
/// Each round renders a synthetic scene of random size, number of views, layout, lens and masks and reconstructs
/// it undisturbed with random options. Then it disturbs the same run: by kill -9, SIGTERM, SIGSTOP and SIGCONT, a
/// full disk, a photograph that cannot be read, damaged results, or a memory budget from 1 MiB to 4 GiB. Or it kills
/// `vamvs synth`. Afterwards no file may be half-written, no thread may have panicked, resident memory may not have
/// exceeded the budget, and the run that completes must give the same bytes. The folder of a failed round is kept.
#[derive(Args)]
pub struct Soak {
    /// Folder for the rounds.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Start no further round after this many hours.
    #[arg(long, value_name = "H", default_value_t = 1.0)]
    hours: f64,
    /// Seed of the first round; the next rounds count up from it. To repeat a failed round, give its seed and
    /// `--rounds 1`.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Stop after this many rounds.
    #[arg(long, value_name = "N")]
    rounds: Option<u64>,
    /// The `vamvs` program to test [default: the release build in the target folder].
    #[arg(long, value_name = "FILE")]
    vamvs: Option<PathBuf>,
}

/// The state of a round.
struct Round<'a> {
    case: &'a Case,
    scene: Scene,
    program: &'a Program,
    /// Output folder of the disturbed run.
    out: PathBuf,
    /// Output folder of the undisturbed run.
    reference: PathBuf,
    /// How the undisturbed run ended.
    undisturbed: Ended,
    /// Problems found so far, one sentence each.
    findings: Vec<String>,
}

impl Soak {
    pub fn run(&self) -> Result<()> {
        let program = Program::new(self.vamvs.clone().map_or_else(vamvs::binary, Ok)?)?;
        fs::create_dir_all(&self.folder).with_context(|| self.folder.display().to_string())?;
        let end = Instant::now() + Duration::from_secs_f64(3600.0 * self.hours);
        let (mut done, mut failed) = (0, Vec::new());
        while Instant::now() < end && self.rounds.is_none_or(|rounds| done < rounds) {
            let case = Case::draw(self.seed + done);
            if !self.round(&case, &program)? {
                failed.push(case.seed);
            }
            done += 1;
        }
        println!("── {done} rounds, {} failed: {failed:?}", failed.len());
        ensure!(failed.is_empty(), "rounds failed; repeat one with --seed N --rounds 1");
        Ok(())
    }

    /// Runs a round and prints what it finds; true if it finds no problem.
    fn round(&self, case: &Case, program: &Program) -> Result<bool> {
        println!("── seed {}: {case}", case.seed);
        let folder = self.folder.join(format!("round-{}", case.seed));
        remove(&folder)?;
        let begin = Instant::now();
        let findings = Round::begin(case, program, &folder).and_then(Round::disturbed)?;
        findings.iter().for_each(|finding| println!("   FOUND: {finding}"));
        println!(
            "   {:.0} s, {}",
            begin.elapsed().as_secs_f64(),
            if findings.is_empty() { "good" } else { "bad" }
        );
        if findings.is_empty() {
            remove(&folder)?;
        }
        Ok(findings.is_empty())
    }
}

impl<'a> Round<'a> {
    /// Renders the scene and reconstructs it undisturbed.
    fn begin(case: &'a Case, program: &'a Program, folder: &Path) -> Result<Self> {
        fs::create_dir_all(folder)?;
        let scene = scene::make(program, case, folder)?;
        let (out, reference) = (folder.join("out"), folder.join("reference"));
        let undisturbed = program.run(&case.arguments(&scene.arguments, &out), folder, &[])?;
        let mut round = Self { case, scene, program, out, reference, undisturbed, findings: Vec::new() };
        let ended = round.undisturbed.clone();
        round.check_ended(&ended);
        if ended.code != Some(0) {
            println!("   the undisturbed run ends with {}: {}", ended, ended.last_line());
        }
        fs::create_dir_all(&round.out)?;
        round.check_whole(false)?;
        fs::rename(&round.out, &round.reference)?;
        Ok(round)
    }

    /// Runs the reconstruction into `out` with the further arguments `more`, and sends it signals.
    fn run(&mut self, more: &[String], signals: &[process::Timed]) -> Result<Ended> {
        let arguments = [self.case.arguments(&self.scene.arguments, &self.out), more.to_vec()].concat();
        let ended = self.program.run(&arguments, self.out.parent().context("a folder")?, signals)?;
        // A run that is refused makes no folder.
        fs::create_dir_all(&self.out)?;
        self.check_ended(&ended);
        Ok(ended)
    }

    /// Resumes the run after a disturbance. It must end with the exit code of the undisturbed run and the same files,
    /// except `ignored` ones.
    fn finish(&mut self, ignored: &[&str]) -> Result<()> {
        let ended = self.run(&[], &[])?;
        self.expect(ended.code == self.undisturbed.code, || {
            format!("the resumed run ends with {ended}: {}", ended.last_line())
        });
        self.check_whole(true)?;
        self.check_same(ignored)
    }

    fn check_ended(&mut self, ended: &Ended) {
        self.expect(!ended.panicked(), || format!("a panic: {}", ended.panic_line()));
        let crashed = ended.signal.is_some_and(|signal| ![9, 15].contains(&signal));
        self.expect(!crashed, || format!("the program crashed: {ended}"));
    }

    fn check_whole(&mut self, may_have_temporary: bool) -> Result<()> {
        self.findings.extend(check::half_written(&self.out, may_have_temporary)?);
        Ok(())
    }

    fn check_same(&mut self, ignored: &[&str]) -> Result<()> {
        self.findings.extend(check::differences(&self.reference, &self.out, ignored)?);
        Ok(())
    }

    fn expect(&mut self, holds: bool, finding: impl FnOnce() -> String) {
        if !holds {
            self.findings.push(finding());
        }
    }
}

fn remove(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| format!("removing {}", folder.display()))?;
    }
    Ok(())
}
