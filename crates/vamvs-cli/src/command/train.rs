//! `vamvs train`: weights from scenes with true depth.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use vamvs::net::{Network, open_device};
use vamvs_train::{Dataset, TrainEvent, TrainJob, TrainOptions, Validation, train};

use crate::arguments::{SampleFlags, TrainArguments, TrainPreset, TrainingFlags};
use crate::progress::Progress;
use crate::settings::{Settings, set};

/// Runs the command.
pub fn run(arguments: &TrainArguments) -> Result<()> {
    Settings { threads: arguments.threads, ..Settings::default() }.use_threads()?;
    let minutes = arguments.watching.checkpoint_minutes;
    let pause = Duration::try_from_secs_f64(60.0 * minutes);
    ensure!(arguments.watching.validate_every > 0, "--validate-every must be 1 at least, got 0");
    let job = TrainJob {
        training: Dataset::open(&arguments.data)?,
        validation: Dataset::open(&arguments.validation)?,
        options: options(&arguments.training, &arguments.samples),
        measure: Validation {
            references: arguments.watching.validation_views,
            true_visibility: arguments.samples.true_visibility,
            ..Validation::default()
        },
        validate_every: arguments.watching.validate_every,
        checkpoint_every: pause.with_context(|| format!("--checkpoint-minutes {minutes} is invalid"))?,
        out: arguments.out.clone(),
    };
    let network = Network::load(&arguments.network, open_device(&arguments.device)?)?;
    let mut report = Report { progress: Progress::new(arguments.quiet), json: arguments.json, steps: 0 };
    let trained = train(&job, network, &mut |event| report.show(event));
    report.progress.finish();
    trained?;
    if !arguments.json {
        say!("{}", module(&arguments.out).display());
    }
    Ok(())
}

fn module(out: &std::path::Path) -> PathBuf {
    out.join("module.pt")
}

/// The preset's options, changed by flags.
fn options(training: &TrainingFlags, samples: &SampleFlags) -> TrainOptions {
    let mut options = match training.preset {
        TrainPreset::Compact => TrainOptions::compact(training.steps.unwrap_or(40_000)),
        TrainPreset::Paper => TrainOptions::paper(training.steps.unwrap_or(40_000)),
    };
    let none = training.flow_alone.then_some(0);
    options.flow_alone = training.flow_alone;
    set(&mut options.coarse_steps, training.coarse_steps.or(none));
    set(&mut options.freeze_norm_after, training.freeze_norm_after.or(none));
    set(&mut options.batch, training.batch);
    set(&mut options.seed, training.seed);
    set(&mut options.loss.visibility, training.visibility_weight);
    set(&mut options.loss.flow_reach, training.flow_reach);
    set(&mut options.loss.cross_entropy, training.cross_entropy);
    set(&mut options.loss.surface, training.surface_weight);
    let optimizer = &mut options.optimizer;
    set(&mut optimizer.rule, training.optimizer);
    set(&mut optimizer.learning_rate, training.learning_rate);
    set(&mut optimizer.warm_up, training.warm_up);
    set(&mut optimizer.weight_decay, training.weight_decay);
    set(&mut optimizer.clip, training.clip);
    let sample = &mut options.sample;
    set(&mut sample.crop, samples.crop.as_deref().map(two));
    set(&mut sample.views, samples.views.as_deref().map(two));
    set(&mut sample.max_planes, samples.max_planes);
    set(&mut sample.min_scale, samples.min_scale);
    set(&mut sample.range_jitter, samples.range_jitter);
    set(&mut sample.beyond, samples.beyond);
    set(&mut sample.camera_noise, samples.camera_noise);
    sample.augment &= !samples.no_augmentation;
    sample.true_visibility = samples.true_visibility;
    options
}

/// Two numbers; the parser checks that there are two.
fn two(numbers: &[usize]) -> [usize; 2] {
    [numbers[0], numbers[1]]
}

/// Draws events.
struct Report {
    progress: Progress,
    json: bool,
    steps: usize,
}

impl Report {
    fn show(&mut self, event: &TrainEvent) {
        if self.json {
            say!("{}", serde_json::to_string(event).expect("events are plain data"));
        }
        match event {
            TrainEvent::Begun { scenes, step, steps } => {
                self.steps = *steps;
                let from = if *step > 0 { format!(", on from step {step}") } else { String::new() };
                self.progress.say(&format!("training on {scenes} scenes, {steps} steps{from}"));
            }
            TrainEvent::Step(record) => {
                self.progress.step("training", record.step, self.steps);
                if record.step.is_multiple_of(100) {
                    let (step, loss, seconds) = (record.step, record.loss, record.seconds);
                    self.progress.say_without_bar(&format!("step {step}: loss {loss:.3}, {seconds:.2} s"));
                }
            }
            TrainEvent::Validated(record) => {
                let stage = |s: &vamvs_train::validate::StageScores| {
                    format!("{:.1}", 100.0 * s.overall.share(s.overall.outliers))
                };
                let outliers: Vec<String> = record.scores.stages.iter().map(stage).collect();
                let best = if record.best { ", the best so far" } else { "" };
                self.progress.say(&format!(
                    "step {}: {} % of validation pixels with an error > 1 % (coarse, then each iteration){best}",
                    record.step,
                    outliers.join(", "),
                ));
            }
            TrainEvent::Saved { .. } => {}
        }
    }
}
