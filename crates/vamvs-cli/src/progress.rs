//! Events of the pipeline on the terminal: a bar there, plain lines elsewhere, all on standard error.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use vamvs::Event;

/// Draws events.
pub struct Progress {
    quiet: bool,
    bar: ProgressBar,
    terminal: bool,
}

impl Progress {
    /// `quiet` leaves nothing but warnings.
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
        Self { quiet, bar, terminal }
    }

    /// A line about what is done.
    pub fn say(&self, line: &str) {
        if !self.quiet {
            self.bar.suspend(|| eprintln!("{line}"));
        }
    }

    /// A line about what is done, where no bar tells it.
    pub fn say_without_bar(&self, line: &str) {
        if !self.terminal {
            self.say(line);
        }
    }

    /// A warning.
    pub fn warn(&self, line: &str) {
        self.bar.suspend(|| eprintln!("warning: {line}"));
    }

    /// Draws an event.
    pub fn show(&self, event: Event) {
        match event {
            Event::Warning(text) => self.warn(&text),
            Event::DepthMap { name, done, total, resumed, time } => {
                self.step("depth maps", done, total);
                let how =
                    if resumed { "is there".to_owned() } else { format!("{:.1} s", time.as_secs_f64()) };
                self.say_without_bar(&format!("depth {done}/{total} {name}: {how}"));
            }
            Event::Fusion { done, total } => {
                self.step("fusion", done, total);
                if !self.terminal && (done == total || done * 2 == total) {
                    self.say(&format!("fusion {done}/{total}"));
                }
            }
            Event::Export { done, total } => self.step("export", done, total),
        }
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
        }
        self.bar.set_length(total as u64);
        self.bar.set_position(done as u64);
    }
}
