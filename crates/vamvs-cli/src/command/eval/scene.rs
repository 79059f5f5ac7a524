//! `vamvs eval scene`: depth maps and cloud of a scene against its true depth maps.

use anyhow::Result;
use serde_json::json;
use vamvs::eval::{DepthScene, SceneEvaluation};
use vamvs_picture::Page;

use super::table::Table;
use super::{begin, cloud};
use crate::arguments::EvalSceneArguments;

/// Runs the command.
pub fn run(arguments: &EvalSceneArguments) -> Result<()> {
    let EvalSceneArguments { out, ground_truth, thresholds, distances, general, .. } = arguments;
    let progress = begin(general)?;
    let maps =
        DepthScene::open(out, ground_truth, thresholds.plane_distance, &mut |event| progress.show(event))?;
    let html = arguments.html.clone().unwrap_or_else(|| maps.prediction().root().join("eval.html"));
    Page::expect_replaceable(&html)?;
    let default_cloud = maps.prediction().default_cloud();
    let cloud = arguments.cloud.clone().or_else(|| default_cloud.is_file().then_some(default_cloud));
    if cloud.is_none() {
        progress.say("there is no cloud; depth maps alone are compared");
    }
    let limits = thresholds.thresholds(maps.knows_planes());
    let evaluation = SceneEvaluation::new(maps, cloud.as_deref(), &limits, distances.as_deref())?;
    evaluation.page()?.save(&html)?;
    let scores = &evaluation.scores;
    if general.json {
        say!("{}", json!({"depth": scores.depth, "cloud": scores.cloud, "page": html}));
        return Ok(());
    }
    let mut table = Table::of_depth(&scores.depth.total[0]);
    scores.depth.views.iter().for_each(|view| table.depth_rows(&view.view, &view.regions));
    table.depth_rows("all views", &scores.depth.total);
    table.print();
    if let Some(errors) = &scores.cloud {
        say!("");
        cloud::print_errors(errors);
    }
    say!("\n{}", html.display());
    Ok(())
}
