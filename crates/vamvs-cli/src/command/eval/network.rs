//! `vamvs eval network`: networks side by side on scenes with true depth.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use serde::Serialize;
use vamvs::eval::page::percent;
use vamvs::net::{Estimator, EstimatorOptions, open_device};
use vamvs::weights;
use vamvs_train::validate::{Region, StageScores, stage_name};
use vamvs_train::{Dataset, Scores, Validation, validate};

use super::begin;
use super::table::Table;
use crate::arguments::EvalNetworkArguments;

/// The scores of a network with a number of views.
#[derive(Serialize)]
struct Measured {
    network: String,
    views: usize,
    /// Time for a depth map: reading and encoding its views, estimating, comparing with the ground truth.
    seconds: f64,
    scores: Scores,
}

/// Runs the command.
pub fn run(arguments: &EvalNetworkArguments) -> Result<()> {
    begin(&arguments.general)?;
    for &views in &arguments.views {
        ensure!(views >= 2, "--views must be 2 at least (a reference and a source), got {views}");
    }
    ensure!(arguments.max_size >= 32, "--max-size must be 32 at least, got {}", arguments.max_size);
    ensure!(arguments.references >= 1, "--references must be 1 at least, got 0");
    ensure!(arguments.max_planes >= 8, "--max-planes must be 8 at least, got {}", arguments.max_planes);
    let dataset = Dataset::open(&arguments.data)?;
    let mut all = Vec::new();
    for name in &arguments.networks {
        let mut network = weights::load(Some(name), open_device(&arguments.device)?)?;
        if let Some(stride) = arguments.coarse_stride {
            network.set_coarse_stride(stride).context("--coarse-stride")?;
        }
        let options = EstimatorOptions::of(&network);
        let estimator = Estimator::new(network, options)?;
        for &views in &arguments.views {
            all.push(measure(arguments, (name, &estimator), &dataset, views)?);
        }
    }
    if arguments.general.json {
        say!("{}", serde_json::to_string(&all)?);
    } else {
        table(&all).print();
    }
    Ok(())
}

fn measure(
    arguments: &EvalNetworkArguments,
    (name, estimator): (&Path, &Estimator),
    dataset: &Dataset,
    views: usize,
) -> Result<Measured> {
    let EvalNetworkArguments { references, max_size, max_planes, true_visibility, .. } = *arguments;
    let options = Validation { views, max_size, max_planes, references, true_visibility };
    let (mut maps, begin) = (0, Instant::now());
    let scores = validate(estimator, dataset, &options, |_| maps += 1)?;
    let seconds = begin.elapsed().as_secs_f64() / f64::from(maps);
    Ok(Measured { network: name.display().to_string(), views, seconds, scores })
}

fn table(all: &[Measured]) -> Table {
    let mut table = Table::new(&["", "views", "stage", "", "pixels", "error > 1 %", "within d", "within 3d"]);
    for measured in all {
        for (index, stage) in measured.scores.stages.iter().enumerate() {
            let name = if index == 0 { measured.network.clone() } else { String::new() };
            rows(&mut table, [name, measured.views.to_string(), stage_name(index)], stage);
        }
    }
    table
}

fn rows(table: &mut Table, names: [String; 3], stage: &StageScores) {
    let regions = [("all", stage.overall), ("invisible in some source", stage.invisible)];
    let mut names = Some(names);
    for (region, scores) in regions.into_iter().chain([("visible in all sources", stage.fully_visible)]) {
        if scores.pixels == 0 {
            continue;
        }
        let share = |count| percent(scores.share(count));
        let Region { pixels, within_d, within_3d, outliers } = scores;
        let mut cells = names.take().unwrap_or_default().to_vec();
        cells.extend([
            region.to_owned(),
            pixels.to_string(),
            share(outliers),
            share(within_d),
            share(within_3d),
        ]);
        table.row(cells);
    }
}
