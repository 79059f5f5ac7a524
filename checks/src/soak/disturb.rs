//! The disturbances of a run, and what must hold after each.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result};

use super::case::Disturbance;
use super::process::{Ended, Signal, Timed};
use super::random::Random;
use super::{Round, check, scene};
use crate::files::save;

/// Result files that record the memory budget, so that they differ between budgets.
const OF_THE_BUDGET: [&str; 3] = ["run.toml", "fusion.json", "report.html"];

/// The least budget that a run must keep to, bytes: about what a process with libtorch takes before it starts to
/// work.
const LEAST_BUDGET: u64 = 768 << 20;

/// The program's exit code after SIGTERM.
const TERMINATED: i32 = 128 + 15;

impl Round<'_> {
    /// Disturbs the run and returns the problems found, one sentence each.
    pub fn disturbed(mut self) -> Result<Vec<String>> {
        let mut random = self.case.random();
        match self.case.disturbance {
            Disturbance::Killed(times) => self.killed(times, &mut random)?,
            Disturbance::Terminated => self.terminated(&mut random)?,
            Disturbance::Paused(times) => self.paused(times, &mut random)?,
            Disturbance::FullDisk(share) => self.full_disk(share)?,
            Disturbance::BadPhotograph => self.bad_photograph(&mut random)?,
            Disturbance::DamagedResults(count) => self.damaged_results(count, &mut random)?,
            Disturbance::Budget(bytes) => self.budget(bytes)?,
            Disturbance::SynthKilled => self.synth_killed(&mut random)?,
        }
        Ok(self.findings)
    }

    /// A random time, uniform over the duration of the undisturbed run.
    fn some_time(&self, random: &mut Random) -> Duration {
        Duration::from_secs_f64(self.undisturbed.seconds * random.share())
    }

    fn killed(&mut self, times: usize, random: &mut Random) -> Result<()> {
        for _ in 0..times {
            let at = self.some_time(random);
            self.run(&[], &[Timed { at, signal: Signal::Kill }])?;
            self.whole_if_there(true)?;
        }
        self.finish(&[])
    }

    fn terminated(&mut self, random: &mut Random) -> Result<()> {
        let at = self.some_time(random);
        let ended = self.run(&[], &[Timed { at, signal: Signal::Terminate }])?;
        // Until the program has installed its handler, the signal ends it directly.
        let expected =
            ended.code == Some(TERMINATED) || ended.signal == Some(15) || ended.code == self.undisturbed.code;
        self.expect(expected, || {
            format!("after SIGTERM the program ends with {ended}: {}", ended.last_line())
        });
        self.whole_if_there(false)?;
        self.finish(&[])
    }

    fn paused(&mut self, times: usize, random: &mut Random) -> Result<()> {
        let mut signals = Vec::new();
        for _ in 0..times {
            let at = self.some_time(random);
            signals.push(Timed { at, signal: Signal::Stop });
            let pause = Duration::from_secs_f64(random.between(0.05, 1.5));
            signals.push(Timed { at: at + pause, signal: Signal::Continue });
        }
        let ended = self.run(&[], &signals)?;
        self.ends_as_undisturbed(&ended);
        self.check_whole(false)?;
        self.check_same(&[])
    }

    fn full_disk(&mut self, share: f64) -> Result<()> {
        let sizes = check::files(&self.reference)?.into_values().map(|path| Ok(path.metadata()?.len()));
        let all: u64 = sizes.sum::<Result<u64>>()?;
        fs::create_dir_all(&self.out)?;
        let bytes = ((all as f64 * share) as u64).max(64 << 10);
        let Some(disk) = Disk::mount(&self.out, bytes)? else {
            println!("   skipped: mounting a small tmpfs needs root");
            return Ok(());
        };
        let ended = self.run(&[], &[])?;
        let full = ended.code == Some(1) && ended.messages.contains("No space left");
        let fits = ended.code == self.undisturbed.code;
        self.expect(full || fits, || {
            format!("on a full disk the program ends with {ended}: {}", ended.last_line())
        });
        self.check_whole(false)?;
        disk.enlarge()?;
        self.finish(&[])
    }

    fn bad_photograph(&mut self, random: &mut Random) -> Result<()> {
        let path = random.one_of(&self.scene.photographs);
        let (good, changed) = (fs::read(&path)?, fs::metadata(&path)?.modified()?);
        let half = good[..good.len() / 2].to_vec();
        save(&path, random.one_of(&[Vec::new(), b"no image".to_vec(), half]))?;
        let ended = self.run(&[], &[])?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.expect(matches!(ended.code, Some(0 | 1)), || format!("with a bad photograph: {ended}"));
        // A run that is refused for another reason may not come to the photograph.
        let named = ended.messages.contains(&name) || self.undisturbed.code != Some(0);
        self.expect(named, || format!("no message mentions the bad photograph {name}"));
        self.whole_if_there(false)?;
        save(&path, &good)?;
        // Records hold the time of change.
        File::options().write(true).open(&path)?.set_modified(changed)?;
        self.finish(&[])
    }

    fn damaged_results(&mut self, count: usize, random: &mut Random) -> Result<()> {
        let ended = self.run(&[], &[])?;
        self.ends_as_undisturbed(&ended);
        for _ in 0..count {
            let files: Vec<(String, PathBuf)> = check::files(&self.out)?.into_iter().collect();
            // Only files in these folders are read by a resumed run. `run.toml` is left alone: it is for users to edit.
            let resumed = |name: &str| {
                ["depths/", "confidence/", "cams/", "images/"].iter().any(|f| name.starts_with(f))
            };
            let files: Vec<PathBuf> =
                files.into_iter().filter(|(name, _)| resumed(name)).map(|(_, path)| path).collect();
            if files.is_empty() {
                break;
            }
            let path = random.one_of(&files);
            let content = fs::read(&path)?;
            match random.below(3) {
                0 => fs::remove_file(&path)?,
                1 => save(&path, [])?,
                _ => save(&path, &content[..random.below(content.len().max(1))])?,
            }
        }
        self.finish(&[])
    }

    fn budget(&mut self, bytes: u64) -> Result<()> {
        let ended = self.run(&["--max-memory".to_owned(), format!("{bytes}B")], &[])?;
        self.whole_if_there(false)?;
        self.expect(matches!(ended.code, Some(0 | 1)), || format!("with {bytes} bytes of memory: {ended}"));
        let over = ended.peak_bytes > bytes && bytes >= LEAST_BUDGET;
        self.expect(!over, || {
            format!("a budget of {} MiB, a peak of {} MiB", bytes >> 20, ended.peak_bytes >> 20)
        });
        let told = ["memory", "reduced"].iter().any(|word| ended.messages.contains(word));
        if ended.code == Some(0) && !ended.messages.contains("reduced") {
            self.check_same(&OF_THE_BUDGET)?;
        } else if ended.code != self.undisturbed.code {
            self.expect(told, || format!("with {bytes} bytes: {ended}, unexplained: {}", ended.last_line()));
        }
        self.finish(&[])
    }

    fn synth_killed(&mut self, random: &mut Random) -> Result<()> {
        let folder = self.out.with_file_name("set-again");
        let arguments = scene::synth_arguments(self.case, &folder);
        let parent = self.out.parent().context("a folder")?.to_owned();
        let at = Duration::from_secs_f64(random.between(0.0, 3.0));
        let killed = self.program.run(&arguments, &parent, &[Timed { at, signal: Signal::Kill }])?;
        let ended = self.program.run(&arguments, &parent, &[])?;
        [killed, ended.clone()].iter().for_each(|ended| self.check_ended(ended));
        self.expect(ended.code == Some(0), || format!("the resumed vamvs synth ends with {ended}"));
        for part in ["images", "cams", "depths", "visibility", "objects"] {
            let whole = |set: &str| self.out.with_file_name(set).join("scene-00000").join(part);
            self.findings.extend(check::differences(&whole("set"), &whole("set-again"), &[])?);
        }
        Ok(())
    }

    fn ends_as_undisturbed(&mut self, ended: &Ended) {
        let same = ended.code == self.undisturbed.code;
        self.expect(same, || format!("the run ends with {ended}: {}", ended.last_line()));
    }

    /// Checks that files are whole. Makes the output folder first, since a run that ended early may have made none.
    fn whole_if_there(&mut self, may_have_temporary: bool) -> Result<()> {
        fs::create_dir_all(&self.out)?;
        self.check_whole(may_have_temporary)
    }
}

/// A small tmpfs, unmounted when it is dropped.
struct Disk(PathBuf);

impl Disk {
    /// Mounts a tmpfs of `bytes` bytes at `path`; `None` if this user cannot.
    fn mount(path: &Path, bytes: u64) -> Result<Option<Self>> {
        let options = format!("size={bytes}");
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &options, "tmpfs"]).arg(path).stderr(Stdio::null());
        Ok(mount.status().is_ok_and(|status| status.success()).then(|| Self(path.to_owned())))
    }

    fn enlarge(&self) -> Result<()> {
        let done = Command::new("mount").args(["-o", "remount,size=1g"]).arg(&self.0).status()?;
        anyhow::ensure!(done.success(), "the small disk cannot be enlarged");
        Ok(())
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}
