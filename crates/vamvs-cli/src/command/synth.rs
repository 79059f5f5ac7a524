//! `vamvs synth`: synthetic scenes with ground truth.

use std::path::Path;

use anyhow::{Context, Result};
use serde_json::{Value, json};
use vamvs_synth::{
    AssetFilter, AssetFolders, Assets, Effects, RenderOptions, Style, SynthEvent, SynthJob, SynthOptions,
};

use crate::arguments::{AssetFlags, SynthArguments};
use crate::progress::Progress;
use crate::settings::Settings;

/// Runs the command.
pub fn run(arguments: &SynthArguments) -> Result<()> {
    Settings { threads: arguments.general.threads, ..Settings::default() }.use_threads()?;
    let (assets, options) = (load(&arguments.assets)?, options(arguments));
    let SynthArguments { out, seed, force, first, scenes, .. } = arguments;
    let last = first.checked_add(*scenes).context("--first plus --scenes is too large")?;
    let job = SynthJob { assets: &assets, options: &options, seed: *seed, out, force: *force };
    let mut report = Report::new(arguments);
    let made = job.run(*first..last, &mut |event| report.show(&event));
    report.progress.finish();
    let made = made?;
    report.progress.say(&format!("{} scenes made, {} were there", made.made, made.kept));
    if arguments.general.json {
        say!("{}", json!({"made": made.made, "kept": made.kept, "scenes": report.scenes}));
    } else {
        say!("{}", out.display());
    }
    Ok(())
}

fn load(flags: &AssetFlags) -> Result<Assets> {
    let AssetFlags { meshes, textures, environments, exclude, only } = flags;
    let folders = AssetFolders {
        meshes: meshes.clone(),
        textures: textures.clone(),
        environments: environments.clone(),
    };
    let filter = AssetFilter::new(&names(only.as_deref())?, &names(exclude.as_deref())?)?;
    Ok(Assets::load(&folders, &filter)?)
}

/// The lines of a file that are neither empty nor begin with `#`.
fn names(file: Option<&Path>) -> Result<Vec<String>> {
    let Some(file) = file else { return Ok(Vec::new()) };
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let lines = text.lines().map(str::trim);
    Ok(lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(str::to_owned).collect())
}

fn options(arguments: &SynthArguments) -> SynthOptions {
    let flags = &arguments.photographs;
    let default = RenderOptions::default();
    SynthOptions {
        styles: if arguments.styles.is_empty() { Style::ALL.to_vec() } else { arguments.styles.clone() },
        rigs: flags.rig.rigs(),
        views: flags.views,
        size: flags.size,
        render: RenderOptions { samples: flags.samples.unwrap_or(default.samples), ..default },
        effects: if flags.no_effects { Effects::NONE } else { Effects::default() },
        normals: flags.normals,
    }
}

/// Draws events and collects the summary for `--json`.
struct Report {
    progress: Progress,
    views: usize,
    first: u64,
    total: usize,
    scenes: Vec<Value>,
}

impl Report {
    fn new(arguments: &SynthArguments) -> Self {
        let views = arguments.photographs.views;
        Self {
            progress: Progress::new(arguments.general.quiet),
            views,
            first: arguments.first,
            total: (arguments.scenes as usize).saturating_mul(views),
            scenes: Vec::new(),
        }
    }

    fn show(&mut self, event: &SynthEvent) {
        let before = |scene: u64| (scene - self.first) as usize * self.views;
        match *event {
            SynthEvent::View { scene, done, .. } => {
                self.progress.step("views", before(scene) + done, self.total);
            }
            SynthEvent::Scene { scene, style, kept, time } => {
                self.progress.step("views", before(scene + 1), self.total);
                let (style, seconds) = (style.name(), time.as_secs_f64());
                let how = if kept { "already there".to_owned() } else { format!("{seconds:.1} s") };
                self.progress.say_without_bar(&format!("scene {scene} {style}: {how}"));
                self.scenes.push(json!({"scene": scene, "style": style, "kept": kept, "seconds": seconds}));
            }
        }
    }
}
