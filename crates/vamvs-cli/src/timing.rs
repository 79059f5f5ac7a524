//! A short table of where the time of a run went.

use std::time::{Duration, Instant};

use vamvs::FuseSummary;

use crate::progress::Progress;

/// Steps of a run with the time that they took.
pub struct Timing {
    begin: Instant,
    steps: Vec<(String, Duration)>,
}

impl Timing {
    /// Begins to measure the whole.
    pub fn begin() -> Self {
        Self { begin: Instant::now(), steps: Vec::new() }
    }

    /// Adds a step.
    pub fn add(&mut self, step: &str, time: Duration) {
        self.steps.push((step.to_owned(), time));
    }

    /// Runs a step and adds its time.
    pub fn of<T>(&mut self, step: &str, work: impl FnOnce() -> T) -> T {
        let begin = Instant::now();
        let result = work();
        self.add(step, begin.elapsed());
        result
    }

    /// Adds the steps of estimating depth.
    pub fn add_depth(&mut self, summary: &vamvs::DepthSummary) {
        self.add("reading", summary.reading);
        for (name, time) in &summary.stages {
            match name.as_str() {
                "plane-sweep" => self.add("plane sweep", *time),
                name => self.add(&format!("network: {name}"), *time),
            }
        }
        self.add("refinement", summary.refining);
        self.add("geometric pass", summary.refining_again);
        self.add("writing maps", summary.writing);
    }

    /// Adds the steps of fusing.
    pub fn add_fusion(&mut self, summary: &FuseSummary) {
        self.add("fusion", summary.fusing);
        self.add("cloud and exports", summary.exporting);
    }

    /// Prints the steps, and the time since the beginning.
    pub fn say(mut self, progress: &Progress) {
        self.add("all", self.begin.elapsed());
        let width = self.steps.iter().map(|(step, _)| step.len()).max().unwrap_or(0);
        for (step, time) in &self.steps {
            progress.say(&format!("{step:width$} {:8.2} s", time.as_secs_f64()));
        }
    }
}
