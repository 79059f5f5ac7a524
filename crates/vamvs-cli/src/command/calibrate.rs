//! `vamvs calibrate`: calibrates the confidence of a network.

use std::path::Path;

use anyhow::{Result, ensure};
use serde_json::json;
use vamvs::net::{Estimator, EstimatorOptions, Network, open_device};
use vamvs_picture::{Chart, Curve, Page};
use vamvs_train::{Calibration, Dataset, Validation, calibrate, write_module};

use crate::arguments::CalibrateArguments;
use crate::settings::Settings;

/// Runs the command.
pub fn run(arguments: &CalibrateArguments) -> Result<()> {
    Settings { threads: arguments.threads, ..Settings::default() }.use_threads()?;
    ensure!(arguments.views >= 2, "--views must be 2 at least, got {}", arguments.views);
    let dataset = Dataset::open(&arguments.data)?;
    let network = Network::load(&arguments.weights, open_device(&arguments.device)?)?;
    let options = EstimatorOptions::of(&network);
    let mut estimator = Estimator::new(network, options)?;
    let options =
        Validation { views: arguments.views, references: arguments.references, ..Validation::default() };
    let calibration = calibrate(&mut estimator, &dataset, &options)?;
    write_module(estimator.network(), &arguments.out)?;
    if let Some(path) = &arguments.page {
        draw(&calibration, path)?;
    }
    tell(&calibration, arguments);
    Ok(())
}

fn tell(calibration: &Calibration, arguments: &CalibrateArguments) {
    let Calibration { before, after } = calibration;
    if arguments.json {
        println!("{}", json!({"before": before, "after": after}));
        return;
    }
    println!("{:>10}  {:>18}  {:>18}", "confidence", "kept, right before", "kept, right after");
    for (before, after) in before.above_confidences().iter().zip(after.above_confidences()).step_by(2) {
        let cell = |share: f64, right: f64| format!("{:.1} %, {:.1} %", 100.0 * share, 100.0 * right);
        let cells = [cell(before.share, before.right), cell(after.share, after.right)];
        println!("{:>10.2}  {:>18}  {:>18}", before.confidence, cells[0], cells[1]);
    }
    let [off_before, off_after] = [before, after].map(|reliability| 100.0 * reliability.error());
    println!("mean calibration error of the confidence: {off_before:.1} % before, {off_after:.1} % after");
    println!("{}", arguments.out.display());
}

fn draw(calibration: &Calibration, path: &Path) -> Result<()> {
    let curve = |name: &str, points| Curve { name: name.to_owned(), points };
    let mut page = Page::new("Calibration", "How often depths of each confidence are right, to 1 %");
    page.chart(&Chart {
        title: "Share of right pixels by confidence, on views not used for the fit",
        across: ("confidence", 1.0),
        top: 1.0,
        curves: vec![
            curve("before", calibration.before.curve()),
            curve("after", calibration.after.curve()),
            curve("ideal", vec![[0.0; 2], [1.0; 2]]),
        ],
    });
    Ok(page.save(path)?)
}
