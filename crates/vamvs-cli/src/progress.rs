//! Shows progress on standard error: a bar in a terminal, plain lines elsewhere.

use std::cell::Cell;
use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use vamvs::{Event, Pass};

use crate::arguments::CommonFlags;

/// Draws events.
pub struct Progress {
    quiet: bool,
    verbose: bool,
    /// The total seconds of depth maps, and their number.
    made: Cell<(f64, usize)>,
    bar: ProgressBar,
    terminal: bool,
}

impl Progress {
    /// If `quiet`, only warnings are printed.
    pub fn new(quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let visible = terminal && !quiet;
        let target = if visible { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(0), target);
        if let Ok(style) =
            ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} [{elapsed}, {eta} left]")
        {
            bar.set_style(style);
        }
        Self { quiet, verbose: false, made: Cell::default(), bar, terminal }
    }

    /// As quiet or verbose as the flags say.
    pub fn of(flags: &CommonFlags) -> Self {
        let mut progress = Self::new(flags.quiet);
        progress.verbose = flags.verbose;
        progress
    }

    /// A line that is printed only if verbose.
    pub fn explain(&self, line: &str) {
        if self.verbose {
            self.say(line);
        }
    }

    /// A line about what is done.
    pub fn say(&self, line: &str) {
        if !self.quiet {
            self.bar.suspend(|| warn!("{line}"));
        }
    }

    /// A line about what is done, printed only if there is no bar.
    pub fn say_without_bar(&self, line: &str) {
        if !self.terminal {
            self.say(line);
        }
    }

    /// A warning.
    pub fn warn(&self, line: &str) {
        self.bar.suspend(|| warn!("warning: {line}"));
    }

    /// Draws an event. The work always goes on: Ctrl-C ends the process.
    pub fn show(&self, event: Event) -> ControlFlow<()> {
        match event {
            Event::Warning(text) => self.warn(&text),
            Event::DepthMap { name, pass, done, total, resumed, time } => {
                let (bar, what, until) = match pass {
                    Pass::Photometric => ("depth maps, first pass", "first pass", "left of this pass"),
                    _ => ("depth maps", "depth", "left"),
                };
                self.step(bar, done, total);
                let how =
                    if resumed { "already there".to_owned() } else { self.paced(time, total - done, until) };
                let line = format!("{what} {done}/{total} {name}: {how}");
                if self.verbose { self.say(&line) } else { self.say_without_bar(&line) }
            }
            Event::Fusion { done, total } => {
                self.step("fusion", done, total);
                if !self.terminal && (done == total || done * 2 == total) {
                    self.say(&format!("fusion {done}/{total}"));
                }
            }
            Event::Draft { done, total } => self.step("draft", done, total),
            Event::Mesh { done, total } => self.step("mesh", done, total),
            Event::Report { done, total } => self.step("report", done, total),
            Event::Export { done, total } => self.step("export", done, total),
            _ => {}
        }
        ControlFlow::Continue(())
    }

    /// The time of a depth map, and an estimate for the remaining ones.
    fn paced(&self, time: Duration, others: usize, until: &str) -> String {
        let (seconds, made) = self.made.get();
        let (seconds, made) = (seconds + time.as_secs_f64(), made + 1);
        self.made.set((seconds, made));
        let left = seconds / made as f64 * others as f64;
        let left = HumanDuration(Duration::from_secs_f64(left.ceil()));
        let left = if others > 0 { format!(", {left:#} {until}") } else { String::new() };
        format!("{:.1} s{left}", time.as_secs_f64())
    }

    /// Ends the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// Moves the bar.
    pub fn step(&self, what: &'static str, done: usize, total: usize) {
        if self.bar.message() != what {
            self.bar.reset();
            self.bar.set_message(what);
            self.made.set((0.0, 0));
        }
        self.bar.set_length(total as u64);
        self.bar.set_position(done as u64);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}
