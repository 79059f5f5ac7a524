//! `vamvs calibrate`: calibrates the confidence of a network and of the depth maps refined from it.

use std::error::Error;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde_json::json;
use vamvs::core::View;
use vamvs::io::{atomic, image};
use vamvs::net::{Estimator, EstimatorOptions, Network, open_device};
use vamvs::output::is_same;
use vamvs::{DepthOptions, PhotoSource, Picture, Reconstruction};
use vamvs_picture::{Chart, Curve, Page};
use vamvs_train::dataset::TrainingScene;
use vamvs_train::{Calibration, Dataset, Outcomes, Validation, calibrate, write_module};

use crate::arguments::CalibrateArguments;
use crate::progress::Progress;
use crate::settings::Settings;

/// Runs the command.
pub fn run(arguments: &CalibrateArguments) -> Result<()> {
    Settings { threads: arguments.threads, ..Settings::default() }.use_threads()?;
    ensure!(arguments.views >= 2, "--views must be 2 at least, got {}", arguments.views);
    ensure!(arguments.references >= 1, "--references must be 1 at least, got 0");
    for output in std::iter::once(&arguments.out).chain(&arguments.page) {
        let problem = "is the network that is calibrated, and would be overwritten: choose another file";
        ensure!(!is_same(output, &arguments.weights), "{} {problem}", output.display());
    }
    ensure!(
        arguments.page.as_ref() != Some(&arguments.out),
        "{}: network and page cannot be the same file",
        arguments.out.display()
    );
    // TorchScript files are ZIP archives.
    atomic::expect_kind(&arguments.out, |begin| begin.starts_with(b"PK"))?;
    arguments.page.as_deref().map_or(Ok(()), Page::expect_replaceable)?;
    let dataset = Dataset::open(&arguments.data)?;
    let network = Network::load(&arguments.weights, open_device(&arguments.device)?)?;
    let options = EstimatorOptions::of(&network);
    let mut estimator = Estimator::new(network, options)?;
    let options =
        Validation { views: arguments.views, references: arguments.references, ..Validation::default() };
    let mut calibrations = vec![("network", calibrate(&mut estimator, &dataset, &options)?)];
    if !arguments.no_refine {
        calibrations.push(("refined", calibrate_refined(&mut estimator, &dataset, arguments)?));
    }
    write_module(estimator.network(), &arguments.out)?;
    if let Some(path) = &arguments.page {
        draw(&calibrations, path)?;
    }
    tell(&calibrations, arguments);
    Ok(())
}

/// Fits the calibration of refined depth maps and writes it into the network's manifest. Scenes are taken whole, spread evenly
/// over the set, until they have as many views as are asked for.
fn calibrate_refined(
    estimator: &mut Estimator,
    dataset: &Dataset,
    arguments: &CalibrateArguments,
) -> Result<Calibration> {
    let folder = tempfile::tempdir().context("a temporary folder")?;
    let weights = folder.path().join("network.pt");
    write_module(estimator.network(), &weights)?;
    let per_scene = dataset.references().len().div_ceil(dataset.scenes.len());
    let wanted = arguments.references.div_ceil(per_scene).clamp(1, dataset.scenes.len());
    let mut outcomes = Outcomes::default();
    for index in 0..wanted {
        let scene = &dataset.scenes[index * dataset.scenes.len() / wanted];
        add_refined(scene, &weights, arguments, &mut outcomes)
            .with_context(|| format!("the scene {}", scene.name))?;
    }
    let (map, calibration) = outcomes.calibration()?;
    let mut manifest = estimator.network().manifest().clone();
    manifest.refined_calibration = Some(map);
    estimator.network_mut().set_manifest(manifest)?;
    Ok(calibration)
}

/// Adds the pixels of a scene's refined depth maps.
fn add_refined(
    scene: &TrainingScene,
    weights: &Path,
    arguments: &CalibrateArguments,
    outcomes: &mut Outcomes,
) -> Result<()> {
    let photographs = Photographs(scene.views.iter().map(|view| view.image.clone()).collect());
    let (progress, mut depth) = (Progress::new(true), DepthOptions::default());
    depth.views = arguments.views;
    let work = Reconstruction::with_photographs(scene.as_scene()?, photographs)
        .weights(weights)
        .device(arguments.device.as_str())
        .depth(depth)
        .prepare(&mut |event| progress.show(event))?;
    for made in work.depth_maps(Box::new(|event| progress.show(event))) {
        let made = made?;
        outcomes.add(&made.map, &scene.true_depths(made.view, made.map.depth.size())?);
    }
    Ok(())
}

/// The photographs of a scene, by the views' numbers.
struct Photographs(Vec<PathBuf>);

impl PhotoSource for Photographs {
    fn picture(&self, view: &View) -> Result<Picture, Box<dyn Error + Send + Sync>> {
        Ok(Picture { image: image::load_rgb(&self.0[view.id as usize])?, mask: None })
    }
}

fn tell(calibrations: &[(&str, Calibration)], arguments: &CalibrateArguments) {
    if arguments.json {
        let named = calibrations.iter().map(|(name, calibration)| ((*name).to_owned(), json!(calibration)));
        say!("{}", serde_json::Value::Object(named.collect()));
        return;
    }
    for (name, Calibration { before, after }) in calibrations {
        say!("{name:>10}  {:>18}  {:>18}", "kept, right before", "kept, right after");
        let rows = before.above_confidences().into_iter().zip(after.above_confidences());
        for (before, after) in rows.step_by(2) {
            let cell = |share: f64, right: f64| format!("{:.1} %, {:.1} %", 100.0 * share, 100.0 * right);
            let cells = [cell(before.share, before.right), cell(after.share, after.right)];
            say!("{:>10.2}  {:>18}  {:>18}", before.confidence, cells[0], cells[1]);
        }
        let [off_before, off_after] = [before, after].map(|reliability| 100.0 * reliability.error());
        say!("mean calibration error of the confidence: {off_before:.1} % before, {off_after:.1} % after\n");
    }
    say!("{}", arguments.out.display());
}

fn draw(calibrations: &[(&str, Calibration)], path: &Path) -> Result<()> {
    let curve = |name: &str, points| Curve { name: name.to_owned(), points };
    let mut page = Page::new("Calibration", "How often depths of each confidence are right, to 1 %");
    for (name, calibration) in calibrations {
        page.chart(&Chart {
            title: &format!("{name}: share of right pixels by confidence, on views not used for the fit"),
            across: ("confidence", 1.0),
            top: 1.0,
            curves: vec![
                curve("before", calibration.before.curve()),
                curve("after", calibration.after.curve()),
                curve("ideal", vec![[0.0; 2], [1.0; 2]]),
            ],
        });
    }
    Ok(page.save(path)?)
}
