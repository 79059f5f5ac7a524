//! The training loop: sample, forward pass, loss, optimiser step, with validations and checkpoints in between.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tch::Tensor;
use vamvs_io::atomic;
use vamvs_net::{Estimator, EstimatorOptions, Mode, Network, Profile};

use crate::checkpoint::{Checkpoints, State, hash, load_network, load_state, system, write_json};
use crate::curves::Log;
use crate::event::{StepRecord, TrainEvent, ValidationRecord};
use crate::forward::{Learning, forward};
use crate::loader::Loader;
use crate::loss::{Losses, losses};
use crate::optimizer::Optimizer;
use crate::options::{TrainOptions, Validation};
use crate::schedule::learning_rate;
use crate::validate::validate;
use crate::{Dataset, TrainError, sheet};

/// A training run.
pub struct TrainJob {
    /// The training scenes.
    pub training: Dataset,
    /// The validation scenes; empty: no validation.
    pub validation: Dataset,
    /// The options of training.
    pub options: TrainOptions,
    /// The options of validation.
    pub measure: Validation,
    /// Steps between validations.
    pub validate_every: usize,
    /// Time between checkpoints.
    pub checkpoint_every: Duration,
    /// The run's folder.
    pub out: PathBuf,
}

/// Trains `network`, or continues from the last checkpoint in the run's folder. Returns the network after the last
/// step, in evaluation mode. It is also written to `OUT/module.pt`, and the best one in validation to `OUT/best.pt`.
///
/// # Errors
/// If an option is out of range, the run's folder belongs to another run, a file is wrong, the loss diverges, or memory
/// runs out.
pub fn train(
    job: &TrainJob,
    network: Network,
    events: &mut dyn FnMut(&TrainEvent),
) -> Result<Network, TrainError> {
    job.options.check()?;
    let trains_flow =
        job.options.flow_alone || job.options.iterations.as_ref().is_some_and(|all| !all.is_empty());
    if trains_flow && network.manifest().cascade.is_some() {
        let name = if job.options.flow_alone { "flow-alone" } else { "iterations" };
        return Err(TrainError::option(name, "a network with a flow", &"a cascade, which has none"));
    }
    std::fs::create_dir_all(&job.out).map_err(|source| system("make the folder", &job.out, source))?;
    let mut run = Run::begin(job, network, events)?;
    run.go()?;
    Ok(run.estimator.into_network())
}

struct Run<'a> {
    job: &'a TrainJob,
    estimator: Estimator,
    optimizer: Optimizer,
    state: State,
    checkpoints: Checkpoints,
    log: Log,
    events: &'a mut dyn FnMut(&TrainEvent),
}

impl<'a> Run<'a> {
    fn begin(
        job: &'a TrainJob,
        network: Network,
        events: &'a mut dyn FnMut(&TrainEvent),
    ) -> Result<Self, TrainError> {
        let checkpoints = Checkpoints::of(&job.out);
        let names = |set: &Dataset| set.scenes.iter().map(|scene| scene.name.clone()).collect();
        let fresh = State {
            step: 0,
            network: hash(&network)?,
            options: job.options.clone(),
            scenes: names(&job.training),
            measured: (names(&job.validation), job.measure.clone()),
            best: None,
        };
        let (network, optimizer, state) = match checkpoints.last()? {
            None => {
                expect_no_others(&job.out)?;
                let network = described(network, job)?;
                let optimizer = Optimizer::new(&network, &job.options.optimizer)?;
                (network, optimizer, fresh)
            }
            Some(folder) => {
                let network = load_network(&folder, network.device())?;
                let mut optimizer = Optimizer::new(&network, &job.options.optimizer)?;
                let state = load_state(&folder, &mut optimizer)?;
                check_same_run(&folder, &state, &fresh)?;
                // Scores measured on other views or with other options cannot be compared.
                let best = state.best.filter(|_| state.measured == fresh.measured);
                (network, optimizer, State { best, measured: fresh.measured, ..state })
            }
        };
        let log = Log::open(&job.out.join("log.jsonl"), state.step)?;
        let options = EstimatorOptions { slab_bytes: usize::MAX, ..EstimatorOptions::of(&network) };
        let estimator = Estimator::new(network, options)?;
        let mut run = Self { job, estimator, optimizer, state, checkpoints, log, events };
        let scenes = job.training.scenes.len();
        run.tell(&TrainEvent::Begun { scenes, step: run.state.step, steps: job.options.steps })?;
        Ok(run)
    }

    fn go(&mut self) -> Result<(), TrainError> {
        let TrainOptions { steps, batch, seed, ref sample, .. } = self.job.options;
        let first = (self.state.step * batch) as u64;
        let sample = (sample.clone(), self.estimator.network().manifest().plane_step);
        let loader = Loader::new(Arc::new(self.job.training.clone()), sample, seed, first);
        let mut saved = Instant::now();
        while self.state.step < steps {
            let record = self.step(&loader)?;
            self.tell(&TrainEvent::Step(record))?;
            let last = self.state.step == steps;
            if last || self.state.step.is_multiple_of(self.job.validate_every) {
                self.measure()?;
            }
            if last || saved.elapsed() >= self.job.checkpoint_every {
                self.save()?;
                saved = Instant::now();
            }
        }
        self.estimator.network_mut().set_mode(Mode::Evaluation)?;
        write_module(self.estimator.network(), &self.job.out.join("module.pt"))
    }

    /// One step of the optimiser on one batch.
    fn step(&mut self, loader: &Loader) -> Result<StepRecord, TrainError> {
        let began = Instant::now();
        let options = &self.job.options;
        let step = self.state.step;
        let learning = match options.flow_alone {
            true => Learning::Flow,
            false if step < options.coarse_steps => Learning::Coarse,
            false => Learning::All,
        };
        let mode = if step < options.freeze_norm_after { Mode::Training } else { Mode::Evaluation };
        self.estimator.network_mut().set_mode(mode)?;
        let (mut batch, mut waited) = (Vec::new(), 0.0);
        for _ in 0..options.batch {
            let waiting = Instant::now();
            let sample = loader.next_sample()?;
            waited += waiting.elapsed().as_secs_f64();
            let output = forward(
                &self.estimator,
                &sample,
                (learning, options.iterations.as_deref()),
                &mut Profile::default(),
            )?;
            let hypotheses = self.estimator.network().manifest().hypotheses;
            let losses = losses(&output, hypotheses, learning, &options.loss)?;
            if let Some(total) = &losses.total {
                total.f_div_scalar(options.batch as f64)?.f_backward()?;
            }
            batch.push(losses);
        }
        let learning_rate = learning_rate(&options.optimizer, step, options.steps);
        let mut record = summary(&batch);
        let diverged = |what, value| Err(TrainError::Diverged { what, value, step });
        if !record.loss.is_finite() {
            return diverged("loss", record.loss);
        }
        record.gradient = self.optimizer.step(learning_rate)?;
        if !record.gradient.is_finite() {
            return diverged("gradient's norm", record.gradient);
        }
        self.state.step += 1;
        record.step = self.state.step;
        record.learning_rate = learning_rate;
        record.waited = waited;
        record.seconds = began.elapsed().as_secs_f64();
        Ok(record)
    }

    /// Validates the network, keeps it if it is the best so far, and draws depth maps and curves.
    fn measure(&mut self) -> Result<(), TrainError> {
        if self.job.validation.scenes.is_empty() {
            return self.log.draw(&self.job.out.join("curves.html"));
        }
        self.estimator.network_mut().set_mode(Mode::Evaluation)?;
        let mut sheet = sheet::Sheet::default();
        let scores = validate(&self.estimator, &self.job.validation, &self.job.measure, |example| {
            sheet.add(example);
        })?;
        sheet.save(&self.job.out.join("validation.png"))?;
        let outliers = scores.outliers();
        let mut manifest = self.estimator.network().manifest().clone();
        manifest.scores.insert("validation outlier rate".to_owned(), outliers.into());
        self.estimator.network_mut().set_manifest(manifest)?;
        let best = self.state.best.is_none_or(|best| outliers < best);
        if best {
            self.state.best = Some(outliers);
            write_module(self.estimator.network(), &self.job.out.join("best.pt"))?;
        }
        let record = ValidationRecord { step: self.state.step, scores, best };
        self.tell(&TrainEvent::Validated(record))?;
        self.log.draw(&self.job.out.join("curves.html"))
    }

    fn save(&mut self) -> Result<(), TrainError> {
        let folder = self.checkpoints.save(self.estimator.network(), &self.optimizer, &self.state)?;
        write_json(&self.job.out.join("options.json"), &self.state.options)?;
        self.tell(&TrainEvent::Saved { step: self.state.step, folder })
    }

    fn tell(&mut self, event: &TrainEvent) -> Result<(), TrainError> {
        self.log.add(event)?;
        (self.events)(event);
        Ok(())
    }
}

/// Refuses a folder whose files would be overwritten and are not those of a run that ended before its first checkpoint.
fn expect_no_others(out: &std::path::Path) -> Result<(), TrainError> {
    let began = std::fs::read(out.join("log.jsonl")).is_ok_and(|log| log.starts_with(b"{"));
    let files = ["module.pt", "best.pt", "log.jsonl", "options.json", "curves.html", "validation.png"];
    match files.into_iter().find(|file| !began && out.join(file).exists()) {
        None => Ok(()),
        Some(file) => {
            let problem = format!(
                "{file} is not of a run in this folder and would be overwritten: choose another --out"
            );
            Err(TrainError::Run { folder: out.to_owned(), problem })
        }
    }
}

/// The network with this training added to its manifest, and without the scores and the calibrations of its earlier
/// weights.
fn described(mut network: Network, job: &TrainJob) -> Result<Network, TrainError> {
    let mut manifest = network.manifest().clone();
    let TrainOptions { steps, batch, sample, .. } = &job.options;
    let [[width, height], [fewest, most]] = [sample.crop, sample.views];
    let now = format!(
        "{} samples of {width}×{height} pixels, {fewest} to {most} views, from {} scenes",
        steps * batch,
        job.training.scenes.len()
    );
    let before = manifest.trained_on;
    manifest.trained_on = if before.starts_with("nothing") { now } else { format!("{before}; {now}") };
    manifest.scores.clear();
    manifest.calibration = None;
    manifest.refined_calibration = None;
    network.set_manifest(manifest)?;
    Ok(network)
}

/// Checks that the checkpoint is of the same run: it began with the same network, options and training scenes.
fn check_same_run(folder: &std::path::Path, state: &State, fresh: &State) -> Result<(), TrainError> {
    let problem = if state.network != fresh.network {
        "the run in this folder began with another network"
    } else if state.options != fresh.options {
        "the run in this folder began with other options"
    } else if state.scenes != fresh.scenes {
        "the run in this folder began with other scenes"
    } else {
        return Ok(());
    };
    let problem = format!("{problem}: use the same, or another --out and --network with its module.pt");
    Err(TrainError::Run { folder: folder.to_owned(), problem })
}

/// Writes a module atomically: completely or not at all.
///
/// # Errors
/// If the file cannot be written; a previous file then stays as it was.
pub fn write_module(network: &Network, path: &std::path::Path) -> Result<(), TrainError> {
    // libtorch writes only to paths, and stores the file's name in the file, so the name is always the same.
    let folder = tempfile::tempdir().map_err(|source| system("make a folder for", path, source))?;
    let whole = folder.path().join("module.pt");
    network.save(&whole)?;
    let bytes = std::fs::read(&whole).map_err(|source| system("read", &whole, source))?;
    Ok(atomic::write(path, |out| out.write_all(&bytes))?)
}

/// The means of the losses over a batch; the other fields of the record are set by the caller.
fn summary(batch: &[Losses]) -> StepRecord {
    let value = |total: &Tensor| total.double_value(&[]);
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let known: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    };
    let stages = batch.first().map_or(0, |losses| losses.stages.len());
    let totals: f64 = batch.iter().filter_map(|losses| losses.total.as_ref().map(value)).sum();
    StepRecord {
        step: 0,
        loss: totals / batch.len() as f64,
        stages: (0..stages).map(|i| mean(&mut batch.iter().map(|losses| losses.stages[i]))).collect(),
        visibility: mean(&mut batch.iter().map(|losses| losses.visibility)),
        gradient: 0.0,
        learning_rate: 0.0,
        seconds: 0.0,
        waited: 0.0,
    }
}
