//! `vamvs pseudo`: training scenes from reconstructions.

use anyhow::{Result, bail, ensure};
use serde_json::json;
use vamvs::Maps;
use vamvs::io::masks::Masks;
use vamvs::pseudo::{self, PseudoSummary};

use crate::arguments::PseudoArguments;
use crate::progress::Progress;
use crate::settings::Settings;

/// Runs the command.
pub fn run(arguments: &PseudoArguments) -> Result<()> {
    let settings = Settings::load(&arguments.common)?;
    settings.use_threads()?;
    let mut options = pseudo::strict();
    options.max_memory = settings.fusion.max_memory;
    let progress = Progress::of(&arguments.common);
    let names = arguments.runs.iter().map(|run| pseudo::scene_name(run)).collect::<Result<Vec<_>, _>>()?;
    for (index, name) in names.iter().enumerate() {
        ensure!(
            !names[..index].contains(name),
            "two reconstructions are called {name}, and so would be their scenes: rename one of the folders"
        );
    }
    let mut scenes = Vec::new();
    for (run, name) in arguments.runs.iter().zip(&names) {
        let mut show = |event| progress.show(event);
        let maps = Maps::open(run, Masks::None, &mut show)?;
        let summary = pseudo::write(&maps, &arguments.out.join(name), &options, &mut show)?;
        let PseudoSummary { pixels, verified } = summary;
        let share = 100.0 * verified as f64 / pixels.max(1) as f64;
        if summary.is_enough() {
            progress.say(&format!("{name}: {share:.1} % of the pixels are verified"));
            scenes.push(json!({"scene": name, "pixels": pixels, "verified": verified}));
        } else {
            progress.warn(&format!(
                "{name} is left out: {verified} of {pixels} pixels are verified ({share:.1} %), expected 5 % at least"
            ));
        }
    }
    progress.finish();
    if scenes.is_empty() {
        bail!(
            "none of the reconstructions has enough verified pixels: more views, or better ones, are needed"
        );
    }
    if arguments.common.json {
        say!("{}", json!({ "scenes": scenes }));
    } else {
        say!("{}", arguments.out.display());
    }
    Ok(())
}
