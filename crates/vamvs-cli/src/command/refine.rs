//! `vamvs refine`: depth maps of the photographs' full size from smaller ones.

use std::path::PathBuf;

use anyhow::{Result, bail};
use serde_json::json;
use vamvs::core::Scene;
use vamvs::io::masks::Masks;
use vamvs::output::is_same;
use vamvs::refine::{RefineJob, RefineOptions, RefineSummary, refine};
use vamvs::{DepthOptions, Maps, OutputFolder, Photographs};

use crate::arguments::RefineArguments;
use crate::progress::Progress;
use crate::settings::Settings;

/// Runs the command.
pub fn run(arguments: &RefineArguments) -> Result<()> {
    let mut settings = Settings::load(&arguments.common)?;
    settings.use_threads()?;
    let progress = Progress::of(&arguments.common);
    let mut show = |event| progress.show(event);
    let limit = settings.depth.max_memory;
    let folder = (arguments.depths.as_path(), arguments.png_step);
    let maps = super::open_maps(folder, (&arguments.input, &arguments.common), Masks::None, &mut show)?;
    let maps = maps.readable(limit, &mut show)?;
    super::expect_all_views(&arguments.common, maps.left_out())?;
    if settings.input.given().next().is_none() {
        settings.apply_run(maps.root())?;
    }
    settings.apply_input(&arguments.input);
    let given = Photographed::new(arguments, &settings, &maps, &progress)?;
    let output = OutputFolder::new(&out(arguments, &maps));
    if settings.input.given().chain([maps.root()]).any(|input| is_same(input, output.root())) {
        bail!("--out {}: is an input, choose another folder", output.root().display());
    }
    let views = arguments.views.unwrap_or(settings.depth.views);
    if views < 2 {
        bail!("--views must be at least 2, got {views}");
    }
    #[cfg(feature = "gpu")]
    let gpu = vamvs::refine::refining_device(arguments.device.as_deref())?;
    let job = RefineJob {
        maps: &maps,
        scene: &given.scene,
        photographs: &given.photographs,
        options: &RefineOptions::default(),
        views,
        geometric: !arguments.no_geometric,
        output: &output,
        max_memory: limit,
        force: arguments.force,
        #[cfg(feature = "gpu")]
        device: gpu.as_ref().map(|gpu| gpu as _),
        #[cfg(not(feature = "gpu"))]
        device: None,
    };
    let summary = refine(&job, &mut |event| progress.show(event))?;
    progress.finish();
    say(&summary, &progress);
    if arguments.common.json {
        say!("{}", as_json(&summary));
    } else {
        say!("{}", output.root().display());
    }
    super::expect_all_views(&arguments.common, &summary.skipped)
}

/// The scene with its photographs.
struct Photographed {
    scene: Scene,
    photographs: Photographs,
}

impl Photographed {
    /// The scene that is given, or the one beside the depth maps.
    fn new(
        arguments: &RefineArguments,
        settings: &Settings,
        maps: &Maps,
        progress: &Progress,
    ) -> Result<Self> {
        let max_size = arguments.max_size.unwrap_or(settings.depth.max_size);
        let mut options = settings.depth.clone();
        options.max_size = max_size;
        if settings.input.given().next().is_none() {
            let beside = || maps.root().join("images");
            let images = settings.input.images.clone().unwrap_or_else(beside);
            progress.say(&format!("photographs of the depth maps' names, in {}", images.display()));
            let masks = settings.input.masks(&Masks::None)?;
            let scene = maps.scene().clone();
            return Ok(Self::of(scene, &Photographs::new(&images, masks, &options), &options, progress));
        }
        let loaded = settings.input.scene()?.load()?;
        super::expect_all_cameras(&arguments.common, &loaded)?;
        loaded.warnings.iter().for_each(|warning| progress.warn(warning));
        let masks = settings.input.masks(&loaded.masks)?;
        let photographs = Photographs::new(&loaded.images, masks, &options);
        Ok(Self::of(loaded.scene, &photographs, &options, progress))
    }

    fn of(scene: Scene, photographs: &Photographs, options: &DepthOptions, progress: &Progress) -> Self {
        let (photographs, note) = photographs.full().stretched(&scene.views, options);
        note.iter().for_each(|note| progress.warn(note));
        Self { scene, photographs }
    }
}

fn out(arguments: &RefineArguments, maps: &Maps) -> PathBuf {
    arguments.out.clone().unwrap_or_else(|| maps.root().join("refined"))
}

fn say(summary: &RefineSummary, progress: &Progress) {
    let RefineSummary { made, resumed, skipped, .. } = summary;
    progress
        .say(&format!("{made} depth maps refined, {resumed} were there, {} views left out", skipped.len()));
}

/// The summary for scripts.
fn as_json(summary: &RefineSummary) -> serde_json::Value {
    let RefineSummary { made, resumed, skipped, reading, photometric, geometric, writing, .. } = summary;
    let [read, photometric, geometric, write] =
        [reading, photometric, geometric, writing].map(|time| time.as_secs_f64());
    let seconds = json!({"read": read, "photometric": photometric, "geometric": geometric, "write": write});
    json!({"made": made, "resumed": resumed, "skipped": skipped, "seconds": seconds})
}
