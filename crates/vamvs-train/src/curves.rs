//! The log of a run, one JSON object per line, and a page with its curves.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::Value;
use vamvs_io::atomic;
use vamvs_picture::{Chart, Curve, Page};

use crate::TrainError;
use crate::checkpoint::system;
use crate::event::{StepRecord, TrainEvent, ValidationRecord};
use crate::validate::stage_name;

/// The most points of a curve; a point is the mean over several steps.
const POINTS: usize = 300;
/// The log of a run.
pub struct Log {
    path: PathBuf,
    file: File,
    steps: Vec<StepRecord>,
    validations: Vec<ValidationRecord>,
}

impl Log {
    /// Opens the log of a run that has done `step` steps. Lines of later steps, which were written before an
    /// interruption, are dropped.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn open(path: &Path, step: usize) -> Result<Self, TrainError> {
        let text = if path.is_file() {
            fs::read_to_string(path).map_err(|source| system("read", path, source))?
        } else {
            String::new()
        };
        let kept: Vec<&str> = text.lines().filter(|line| is_of_first(line, step)).collect();
        atomic::write(path, |out| kept.iter().try_for_each(|line| writeln!(out, "{line}")))?;
        let file = OpenOptions::new().append(true).open(path);
        let mut log = Self {
            path: path.to_owned(),
            file: file.map_err(|source| system("open", path, source))?,
            steps: Vec::new(),
            validations: Vec::new(),
        };
        kept.iter().for_each(|line| log.remember(line));
        Ok(log)
    }

    fn remember(&mut self, line: &str) {
        let Ok(value) = serde_json::from_str::<Value>(line) else { return };
        match value["event"].as_str() {
            Some("step") => self.steps.extend(serde_json::from_value::<StepRecord>(value).ok()),
            Some("validated") => self.validations.extend(serde_json::from_value(value).ok()),
            _ => {}
        }
    }

    /// Adds an event as a line.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn add(&mut self, event: &TrainEvent) -> Result<(), TrainError> {
        match event {
            TrainEvent::Step(record) => self.steps.push(record.clone()),
            TrainEvent::Validated(record) => self.validations.push(record.clone()),
            TrainEvent::Begun { .. } | TrainEvent::Saved { .. } => {}
        }
        let line = serde_json::to_string(event).expect("events are plain data");
        writeln!(self.file, "{line}").map_err(|source| system("write", &self.path, source))
    }

    /// Writes the curves to an HTML page that needs no other file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn draw(&self, path: &Path) -> Result<(), TrainError> {
        let steps = self.steps.last().map_or(0, |record| record.step);
        let mut page = Page::new("Training", &format!("{steps} steps"));
        let mut draw = |title: &str, curves: Vec<Curve>| page.chart(&chart(title, curves));
        draw("Loss of each stage, in distances between its hypotheses (s)", self.losses());
        draw("Outlier rate: share of validation pixels with an error > 1 % of the depth", self.outliers());
        draw("Share of validation pixels within d", self.within());
        draw("Learning rate", vec![curve("learning rate", &self.steps, |r| Some(r.learning_rate))]);
        Ok(page.save(path)?)
    }

    fn losses(&self) -> Vec<Curve> {
        let stages = self.steps.iter().map(|record| record.stages.len()).max().unwrap_or(0);
        let of_stage = |i: usize| {
            curve(&stage_name(i), &self.steps, move |record| record.stages.get(i).copied().flatten())
        };
        (0..stages).map(of_stage).collect()
    }

    fn outliers(&self) -> Vec<Curve> {
        self.measured(|scores| {
            scores.stages.iter().map(|stage| stage.overall.share(stage.overall.outliers)).collect()
        })
    }

    fn within(&self) -> Vec<Curve> {
        self.measured(|scores| {
            scores.stages.iter().map(|stage| stage.overall.share(stage.overall.within_d)).collect()
        })
    }

    fn measured(&self, values: impl Fn(&crate::Scores) -> Vec<f64>) -> Vec<Curve> {
        let stages = self.validations.first().map_or(0, |record| record.scores.stages.len());
        let of_stage = |i: usize| Curve {
            name: stage_name(i),
            points: self.validations.iter().map(|r| [r.step as f64, values(&r.scores)[i]]).collect(),
        };
        (0..stages).map(of_stage).collect()
    }
}

/// Whether a line belongs to the first `step` steps.
fn is_of_first(line: &str, step: usize) -> bool {
    let value: Value = serde_json::from_str(line).unwrap_or(Value::Null);
    value["step"].as_u64().is_some_and(|of| of <= step as u64)
}

/// A curve of at most `POINTS` points, each the mean over the same number of steps.
fn curve(name: &str, steps: &[StepRecord], value: impl Fn(&StepRecord) -> Option<f64>) -> Curve {
    let mean = |records: &[StepRecord]| {
        let known: Vec<f64> = records.iter().filter_map(&value).collect();
        let step = records.last()?.step as f64;
        (!known.is_empty()).then(|| [step, known.iter().sum::<f64>() / known.len() as f64])
    };
    let points = steps.chunks(steps.len().div_ceil(POINTS).max(1)).filter_map(mean).collect();
    Curve { name: name.to_owned(), points }
}

/// A chart of curves over steps. Its vertical axis runs from 0 to the largest value after the first twentieth of the
/// steps.
fn chart(title: &str, curves: Vec<Curve>) -> Chart<'_> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let last = points().map(|point| point[0]).fold(1.0, f64::max);
    let settled = points().filter(|point| point[0] > 0.05 * last).map(|point| point[1]);
    let top = settled.fold(f64::MIN_POSITIVE, f64::max);
    Chart { title, across: ("steps", last), top, curves }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(step: usize) -> StepRecord {
        StepRecord {
            step,
            loss: 1.0 / step as f64,
            stages: vec![Some(1.0 / step as f64), None],
            visibility: None,
            gradient: 1.0,
            learning_rate: 1e-3,
            seconds: 0.1,
            waited: 0.0,
        }
    }

    #[test]
    fn a_log_goes_on_where_the_checkpoint_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.jsonl");
        let mut log = Log::open(&path, 0).unwrap();
        (1..=10).for_each(|step| log.add(&TrainEvent::Step(record(step))).unwrap());
        let mut log = Log::open(&path, 6).unwrap();
        log.add(&TrainEvent::Step(record(7))).unwrap();
        assert_eq!(log.steps.iter().map(|record| record.step).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 7);
        let page = folder.path().join("curves.html");
        log.draw(&page).unwrap();
        let page = fs::read_to_string(&page).unwrap();
        assert!(page.contains("7 steps") && page.contains("<polyline") && !page.contains("NaN"));
    }

    #[test]
    fn curves_average_and_leave_out_what_is_unknown() {
        let steps: Vec<_> = (1..=600).map(record).collect();
        let coarse = curve("coarse", &steps, |record| record.stages[0]);
        assert_eq!(coarse.points.len(), 300);
        assert!((coarse.points[0][1] - 0.75).abs() < 1e-12);
        assert!(curve("none", &steps, |record| record.stages[1]).points.is_empty());
    }
}
