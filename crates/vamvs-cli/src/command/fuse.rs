//! `vamvs fuse`: depth maps to one cloud.

use std::path::Path;

use anyhow::{Result, bail};
use serde_json::json;
use vamvs::io::masks::Masks;
use vamvs::{FuseSummary, Maps};

use super::report;
use crate::arguments::{CommonFlags, FuseArguments};
use crate::progress::Progress;
use crate::settings::{Settings, roi, set};
use crate::timing::Timing;

/// Runs the command.
pub fn run(arguments: &FuseArguments) -> Result<()> {
    let mut settings = Settings::load(&arguments.common)?;
    settings.apply_fusion(&arguments.fusion);
    set(&mut settings.fusion.roi, roi(arguments.roi.as_deref())?.map(Some));
    settings.use_threads()?;
    settings.apply_export(&arguments.export);
    let (progress, mut timing) = (Progress::of(&arguments.common), Timing::begin());
    let maps = open(&arguments.depths, masks(arguments)?, &arguments.common, &progress)?;
    let cloud = arguments.out.clone().unwrap_or_else(|| maps.default_cloud());
    let fused = merge(&maps, &cloud, &settings, &progress)?;
    timing.add_fusion(&fused);
    let kept = (&maps, &*cloud, &fused);
    timing.of("report", || report::keep(kept, &settings, !arguments.no_report, &progress))?;
    progress.finish();
    timing.say(&progress);
    if arguments.common.json {
        println!("{}", as_json(&fused));
    } else {
        println!("{}", cloud.display());
    }
    super::expect_all_views(&arguments.common, &fused.skipped)
}

/// The depth maps in a folder that can be read; with `--strict` all must be.
pub fn open(folder: &Path, masks: Masks, common: &CommonFlags, progress: &Progress) -> Result<Maps> {
    let mut show = |event| progress.show(event);
    let maps = Maps::open(folder, masks, &mut show)?.readable(&mut show)?;
    super::expect_all_views(common, maps.left_out())?;
    Ok(maps)
}

/// The masks of the folder's own images, if there are any.
fn masks(arguments: &FuseArguments) -> Result<Masks> {
    match &arguments.masks {
        None => Ok(Masks::None),
        Some(folder) if folder.is_dir() => Ok(Masks::Folder(folder.clone())),
        Some(missing) => bail!("--masks {}: expected a folder of masks", missing.display()),
    }
}

/// Fuses and says what became of the pixels; no points at all are an error.
pub fn merge(maps: &Maps, cloud: &Path, settings: &Settings, progress: &Progress) -> Result<FuseSummary> {
    let mut show = |event| progress.show(event);
    let fused = vamvs::fuse(maps, cloud, &settings.fusion, &settings.export, &mut show)?;
    if fused.points == 0 {
        bail!(
            "no point survived the filters, so no cloud was written: {}. Loosen --min-views, --confidence, --max-reprojection or --max-relative-depth, with `vamvs fuse {}`",
            fused.total(),
            maps.root().display()
        );
    }
    progress.say(&fused.total().to_string());
    if !fused.skipped.is_empty() {
        progress.say(&format!("{} views left out", fused.skipped.len()));
    }
    say_exports(cloud, settings, progress);
    Ok(fused)
}

/// Where exports are.
fn say_exports(cloud: &Path, settings: &Settings, progress: &Progress) {
    let folder = cloud.parent().unwrap_or(Path::new(""));
    let programs = settings.export.programs.iter().map(|program| program.folder());
    let depths = (!settings.export.depth_formats.is_empty()).then_some("depths");
    programs
        .chain(depths)
        .for_each(|name| progress.say(&format!("exported {}", folder.join(name).display())));
}

/// The summary for scripts.
pub fn as_json(fused: &FuseSummary) -> serde_json::Value {
    let views: Vec<_> =
        fused.views.iter().map(|(name, report)| json!({"view": name, "pixels": report})).collect();
    let seconds = json!({"fuse": fused.fusing.as_secs_f64(), "export": fused.exporting.as_secs_f64()});
    json!({"points": fused.points, "total": fused.total(), "views": views, "skipped": fused.skipped, "seconds": seconds})
}
