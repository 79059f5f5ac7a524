//! `vamvs eval depth`: depth maps against true ones.

use anyhow::{Result, ensure};
use serde_json::json;
use vamvs::eval::depth::{are_only_files, compare_files, mean_over_scenes, scenes};
use vamvs::eval::{DepthScene, SceneErrors};

use super::begin;
use super::table::Table;
use crate::arguments::EvalDepthArguments;
use crate::progress::Progress;

/// Runs the command.
pub fn run(arguments: &EvalDepthArguments) -> Result<()> {
    let progress = begin(&arguments.general)?;
    let scenes = errors(arguments, &progress)?;
    let mean = mean_over_scenes(&scenes.iter().map(|(_, errors)| errors).collect::<Vec<_>>());
    if arguments.general.json {
        let by_name = |(name, errors): &(String, SceneErrors)| json!({"scene": name, "errors": errors});
        say!("{}", json!({"scenes": scenes.iter().map(by_name).collect::<Vec<_>>(), "mean": mean}));
        return Ok(());
    }
    let mut table = Table::of_depth(&scenes[0].1.total[0]);
    for (name, errors) in &scenes {
        if !arguments.general.quiet {
            errors.views.iter().for_each(|view| table.depth_rows(&view.view, &view.regions));
        }
        table.depth_rows(name, &errors.total);
    }
    if scenes.len() > 1 {
        table.depth_rows("mean of scenes", &mean);
    }
    table.print();
    Ok(())
}

/// The errors of each scene by name, at least one.
fn errors(arguments: &EvalDepthArguments, progress: &Progress) -> Result<Vec<(String, SceneErrors)>> {
    let EvalDepthArguments { prediction, ground_truth, thresholds, png_step, .. } = arguments;
    let distance = thresholds.plane_distance;
    if prediction.is_file() || are_only_files(ground_truth) {
        let limits = thresholds.thresholds(distance.is_some());
        let errors = compare_files([prediction, ground_truth], *png_step, distance, &limits)?;
        return Ok(vec![("all".to_owned(), errors)]);
    }
    let open = |(name, [prediction, ground_truth]): (String, [std::path::PathBuf; 2])| {
        let scene =
            DepthScene::open(&prediction, &ground_truth, distance, &mut |event| progress.show(event))?;
        Ok((name, scene))
    };
    let scenes = scenes(prediction, ground_truth)?.into_iter().map(open).collect::<Result<Vec<_>>>()?;
    ensure!(!scenes.is_empty(), "{}: no scenes", prediction.display());
    let limits = thresholds.thresholds(scenes.iter().all(|(_, scene)| scene.knows_planes()));
    scenes.into_iter().map(|(name, scene)| Ok((name, scene.errors(&limits)?))).collect()
}
