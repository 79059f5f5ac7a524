//! `cargo xtask soak`: random small runs that are disturbed, and must end as if they had not been.

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

/// Run small random reconstructions, disturb them, and compare what they end with.
///
/// Each round makes a synthetic scene of random size, number of views, layout, lens, masks and options and
/// reconstructs it undisturbed, then disturbs the same run: kill -9, SIGTERM, SIGSTOP and SIGCONT, a full disk, a
/// photograph that cannot be read, damaged results, or a memory budget from absurdly small up. After it, nothing may
/// be half-written, no thread may have panicked, resident memory may not exceed the budget, and the
/// run that finishes must leave the same bytes. Of a round that fails, the folder is kept.
#[derive(Args)]
pub struct Soak {
    /// Folder for the rounds.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Hours to go on.
    #[arg(long, value_name = "H", default_value_t = 1.0)]
    hours: f64,
    /// The first round's seed; the next rounds count up from it. A failure names its seed, and with
    /// `--rounds 1` it is repeated.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Stop after so many rounds.
    #[arg(long, value_name = "N")]
    rounds: Option<u64>,
    /// The program; by default the release build beside this one.
    #[arg(long, value_name = "FILE")]
    vamvs: Option<PathBuf>,
}

/// What a round works with.
struct Round<'a> {
    case: &'a Case,
    scene: Scene,
    program: &'a Program,
    /// Where results go.
    out: PathBuf,
    /// Results of the undisturbed run.
    reference: PathBuf,
    /// How the undisturbed run ended.
    undisturbed: Ended,
    /// What was wrong, one sentence each.
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

    /// Whether a round found nothing.
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
    /// Makes the scene and reconstructs it undisturbed.
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

    /// Runs the program into the folder of results, with further arguments, and sends it signals.
    fn run(&mut self, more: &[String], signals: &[process::Timed]) -> Result<Ended> {
        let arguments = [self.case.arguments(&self.scene.arguments, &self.out), more.to_vec()].concat();
        let ended = self.program.run(&arguments, self.out.parent().context("a folder")?, signals)?;
        self.check_ended(&ended);
        Ok(ended)
    }

    /// The run that goes on after a disturbance ends as the undisturbed one, with the same files.
    fn finish(&mut self, ignored: &[&str]) -> Result<()> {
        let ended = self.run(&[], &[])?;
        self.expect(ended.code == self.undisturbed.code, || {
            format!("the run that goes on ends with {ended}: {}", ended.last_line())
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
