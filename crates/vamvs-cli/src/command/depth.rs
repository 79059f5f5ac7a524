//! `vamvs depth`: photographs and cameras to depth maps.

use anyhow::{Context, Result};
use serde_json::json;
use vamvs::core::Scene;
use vamvs::depth::{DepthJob, DepthStep, collect, estimate_part};
use vamvs::io::masks::Masks;
use vamvs::{DepthSummary, OutputFolder, Plan, Prepared, ViewPlan};

use crate::arguments::{CommonFlags, DepthArguments, DepthCommand, DepthStepFlags, DepthTask};
use crate::progress::Progress;
use crate::settings::Settings;
use crate::timing::Timing;

/// Runs the command.
pub fn run(DepthCommand { depth: arguments, step }: &DepthCommand) -> Result<()> {
    let settings = settings(arguments)?;
    let (progress, mut timing) = (Progress::of(&arguments.common), Timing::begin());
    let summary = match step.step {
        None => estimate(arguments, &settings, &progress)?,
        Some(task) => estimate_step(arguments, &settings, (task, step), &progress)?,
    };
    progress.finish();
    timing.add_depth(&summary);
    timing.say(&progress);
    if arguments.common.json {
        say!("{}", as_json(&summary));
    }
    super::expect_all_views(&arguments.common, &summary.skipped)
}

/// The settings with all flags of the command.
pub fn settings(arguments: &DepthArguments) -> Result<Settings> {
    let mut settings = Settings::load(&arguments.common)?;
    settings.apply_input(&arguments.input);
    settings.apply_depth(&arguments.depth)?;
    Ok(settings)
}

/// Makes the depth maps and says what was done.
pub fn estimate(
    arguments: &DepthArguments,
    settings: &Settings,
    progress: &Progress,
) -> Result<DepthSummary> {
    with_job(arguments, settings, progress, |job| {
        say_work(job.work, progress);
        begin(job, settings)?;
        Ok(vamvs::estimate(job, &mut |event| progress.show(event))?)
    })
}

/// Does one step, for a part of the views where it is one.
fn estimate_step(
    arguments: &DepthArguments,
    settings: &Settings,
    (task, flags): (DepthTask, &DepthStepFlags),
    progress: &Progress,
) -> Result<DepthSummary> {
    with_job(arguments, settings, progress, |job| {
        let mut show = |event| progress.show(event);
        let part = || flags.part.context("--part is missing");
        let summary = match task {
            DepthTask::Photometric => estimate_part(job, DepthStep::Photometric, part()?, &mut show)?,
            DepthTask::Geometric => estimate_part(job, DepthStep::Geometric, part()?, &mut show)?,
            DepthTask::Collect => {
                let parts = flags.parts.context("--parts is missing")?.get();
                collect(job, parts, &mut show)?
            }
        };
        Ok(summary)
    })
}

/// Prepares the job, runs it, and says what was done.
fn with_job(
    arguments: &DepthArguments,
    settings: &Settings,
    progress: &Progress,
    run: impl FnOnce(&DepthJob<'_>) -> Result<DepthSummary>,
) -> Result<DepthSummary> {
    settings.use_threads()?;
    let out = OutputFolder::new(&arguments.out());
    let work = prepared(settings, &out, (&arguments.common, progress))?;
    let summary = run(&DepthJob { work: &work, output: &out, force: arguments.force })?;
    say_summary(&summary, progress);
    Ok(summary)
}

/// The scene, the method and the plan for depth maps that go to `out`.
pub fn prepared(
    settings: &Settings,
    out: &OutputFolder,
    (common, progress): (&CommonFlags, &Progress),
) -> Result<Prepared> {
    let loaded = settings.input.scene()?.load()?;
    super::expect_all_cameras(common, &loaded)?;
    out.expect_apart(settings.input.cams.as_deref())?;
    let inputs = settings.input.given().chain([loaded.images.as_path()]);
    settings.export.expect_apart(out.root(), inputs)?;
    super::expect_masks(settings.input.masks.as_deref(), &loaded.scene.views)?;
    Ok(settings.reconstruction(loaded)?.prepare(&mut |event| progress.show(event))?)
}

/// Makes the output folder and keeps the settings in it.
pub fn begin(job: &DepthJob<'_>, settings: &Settings) -> Result<()> {
    vamvs::depth::prepare(job)?;
    settings.absolute()?.save(&job.output.root().join("run.toml"))
}

/// Prints the method, the masks and the plan.
fn say_work(work: &Prepared, progress: &Progress) {
    progress.say(&work.method.name());
    say_masks(work.photographs.masks(), &work.scene, progress);
    say_plan(&work.scene, &work.plan, work.options.views - 1, progress);
}

/// Prints which masks are used, with a warning if some views have none.
fn say_masks(masks: &Masks, scene: &Scene, progress: &Progress) {
    let views = scene.views.len();
    let masked = scene.views.iter().filter(|view| masks.find(&view.file()).is_some()).count();
    let place = match masks {
        Masks::None => return,
        Masks::Folder(folder) => format!("in {}", folder.display()),
        Masks::Files(_) => "named in the scene's file".to_owned(),
    };
    let line = format!("masks {place}: {masked} of {views} views have one");
    match masked == views {
        true => progress.say(&format!("{line} (--no-masks uses none)")),
        false => progress.warn(&format!("{line}, the others are used whole (--no-masks uses none)")),
    }
}

/// Prints how many views have a plan and, if verbose, what was chosen for each.
fn say_plan(scene: &Scene, plan: &Plan, most: usize, progress: &Progress) {
    let planned = plan.views.iter().flatten().count();
    progress.say(&format!(
        "{planned} of {} views will have a depth map{}",
        scene.views.len(),
        compared_with(plan, most)
    ));
    for (view, plan) in scene.views.iter().zip(&plan.views) {
        let Ok(ViewPlan { planes, origin, sources, .. }) = plan else { continue };
        let origin = origin.map_or("given".to_owned(), |origin| format!("from {origin}"));
        let sources: Vec<&str> = sources.iter().map(|&source| scene.views[source].name.as_str()).collect();
        progress.explain(&format!(
            "{}: depth {:.4} to {:.4} ({origin}), {} planes, compared with {}",
            view.name,
            planes.range.near,
            planes.range.far,
            planes.count,
            sources.join(", ")
        ));
    }
}

/// With how many others the views are compared, and why not with `most`.
fn compared_with(plan: &Plan, most: usize) -> String {
    let counts = || plan.views.iter().flatten().map(|view| view.sources.len());
    match (counts().min(), counts().max()) {
        (Some(fewest), Some(_)) if fewest == most => format!(", compared with {most} others each"),
        (Some(fewest), Some(found)) => format!(
            ", compared with {}{found} others: no more of the {most} that are wanted show the same surfaces",
            if fewest < found { format!("{fewest} to ") } else { String::new() }
        ),
        _ => String::new(),
    }
}

fn say_summary(summary: &DepthSummary, progress: &Progress) {
    let skipped = summary.skipped.len();
    progress.say(&format!(
        "{} depth maps made, {} were there, {skipped} views left out",
        summary.made, summary.resumed
    ));
}

/// The summary for scripts.
pub fn as_json(summary: &DepthSummary) -> serde_json::Value {
    let others = [
        ("read", summary.reading),
        ("refine", summary.refining),
        ("refine-again", summary.refining_again),
        ("write", summary.writing),
    ];
    let times = summary.stages.iter().cloned().chain(others.map(|(name, time)| (name.to_owned(), time)));
    let seconds = times.map(|(name, time)| (name, time.as_secs_f64().into()));
    json!({
        "made": summary.made,
        "resumed": summary.resumed,
        "skipped": summary.skipped,
        "seconds": serde_json::Map::from_iter(seconds),
    })
}
