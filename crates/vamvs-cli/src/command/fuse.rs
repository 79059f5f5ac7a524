//! `vamvs fuse`: depth maps to one cloud.

use std::path::Path;

use anyhow::{Context, Result, bail};
use serde_json::json;
use vamvs::fusion::{FuseError, ViewReport};
use vamvs::{FuseSummary, Maps, PartialFusion, VamvsError};

use super::report;
use crate::arguments::{CommonFlags, FuseArguments, FusionStepFlags, FusionTask};
use crate::progress::Progress;
use crate::settings::{self, Settings, roi, set};
use crate::timing::Timing;

/// Runs the command.
pub fn run(arguments: &FuseArguments) -> Result<()> {
    let mut settings = Settings::load(&arguments.common)?;
    settings.apply_fusion(&arguments.fusion);
    set(&mut settings.fusion.roi, roi(arguments.roi.as_deref())?.map(Some));
    settings.use_threads()?;
    settings.apply_export(&arguments.export);
    let (progress, mut timing) = (Progress::of(&arguments.common), Timing::begin());
    let folder = (arguments.depths.as_path(), settings.export.png_step);
    let masks = settings::masks_of(&arguments.input)?;
    super::expect_scene(&arguments.input)?;
    let maps = super::open_maps(folder, (&arguments.input, &arguments.common), masks, &mut |event| {
        progress.show(event)
    })?;
    super::expect_masks(arguments.input.masks.as_deref(), &maps.scene().views)?;
    let cloud = arguments.out.clone().unwrap_or_else(|| maps.default_cloud());
    let wants_page = !arguments.no_report;
    if matches!(arguments.step.step, None | Some(FusionTask::Concatenate)) {
        vamvs::report::expect_replaceable(&maps, &cloud, wants_page)?;
    }
    let (maps, fused) = match arguments.step.step {
        None => merge_readable(maps, &cloud, &settings, (&arguments.common, &progress))?,
        Some(FusionTask::Concatenate) => {
            let fused = concatenate(&maps, &cloud, &settings, (&arguments.step, &progress))?;
            (maps, fused)
        }
        Some(step) => return part(&maps, &settings, (step, &arguments.step), &progress),
    };
    timing.add_fusion(&fused);
    let kept = (&maps, &*cloud, &fused);
    timing.of("report", || report::keep(kept, &settings, wants_page, &progress))?;
    progress.finish();
    timing.say(&progress);
    if arguments.common.json {
        say!("{}", as_json(&fused));
    } else {
        say!("{}", cloud.display());
    }
    super::expect_all_views(&arguments.common, &fused.skipped)
}

/// Fuses all readable depth maps, as [`of_readable`].
pub fn merge_readable(
    maps: Maps,
    cloud: &Path,
    settings: &Settings,
    (common, progress): (&CommonFlags, &Progress),
) -> Result<(Maps, FuseSummary)> {
    of_readable(maps, settings, (common, progress), |maps| merge(maps, cloud, settings, progress))
}

/// Makes something of all readable depth maps; with `--strict` all must be readable. Maps are read when they are needed. Only if
/// one cannot be read, all are checked and it is made again of the readable ones.
pub fn of_readable<T>(
    maps: Maps,
    settings: &Settings,
    (common, progress): (&CommonFlags, &Progress),
    make: impl Fn(&Maps) -> Result<T>,
) -> Result<(Maps, T)> {
    match make(&maps) {
        Err(error) if is_unreadable(&error) => {
            let maps = maps.readable(settings.fusion.max_memory, &mut |event| progress.show(event))?;
            super::expect_all_views(common, maps.left_out())?;
            let made = make(&maps)?;
            Ok((maps, made))
        }
        made => Ok((maps, made?)),
    }
}

/// Does a part of one of the passes.
fn part(
    maps: &Maps,
    settings: &Settings,
    (step, flags): (FusionTask, &FusionStepFlags),
    progress: &Progress,
) -> Result<()> {
    let fusion = PartialFusion::new(maps, &settings.fusion)?;
    let part = flags.part.context("--part is missing")?;
    let mut show = |event| progress.show(event);
    let did = match step {
        FusionTask::Confirm => fusion.confirm(part, &mut show)?,
        FusionTask::Merge | FusionTask::Concatenate => fusion.merge(part, &mut show)?,
    };
    super::say_part(part, did, progress);
    Ok(())
}

/// Makes the cloud of all parts.
fn concatenate(
    maps: &Maps,
    cloud: &Path,
    settings: &Settings,
    (flags, progress): (&FusionStepFlags, &Progress),
) -> Result<FuseSummary> {
    let fusion = PartialFusion::new(maps, &settings.fusion)?;
    let parts = flags.parts.context("--parts is missing")?.get();
    let fused = fusion.concatenate(parts, cloud, &settings.export, &mut |event| progress.show(event))?;
    say_fused(maps, (cloud, &fused), settings, progress)?;
    Ok(fused)
}

/// Whether a view could not be read or its files do not fit together.
fn is_unreadable(error: &anyhow::Error) -> bool {
    let fusion = error.downcast_ref::<VamvsError>();
    matches!(fusion, Some(VamvsError::Fuse(FuseError::Load { .. } | FuseError::Size { .. })))
}

/// Fuses and says what became of the pixels.
fn merge(maps: &Maps, cloud: &Path, settings: &Settings, progress: &Progress) -> Result<FuseSummary> {
    let mut show = |event| progress.show(event);
    let fused = vamvs::fuse(maps, cloud, &settings.fusion, &settings.export, &mut show)?;
    say_fused(maps, (cloud, &fused), settings, progress)?;
    Ok(fused)
}

/// Says what became of the pixels; no points at all are an error.
fn say_fused(
    maps: &Maps,
    (cloud, fused): (&Path, &FuseSummary),
    settings: &Settings,
    progress: &Progress,
) -> Result<()> {
    if fused.points == 0 {
        let total = fused.total();
        bail!("no point survived the filters, so no cloud was written: {total}. {}", advice(&total, maps));
    }
    progress.say(&fused.total().to_string());
    if !fused.skipped.is_empty() {
        progress.say(&format!("{} views left out", fused.skipped.len()));
    }
    say_exports(cloud, settings, progress);
    Ok(())
}

/// What to do if there are no points: it depends on what took most pixels.
fn advice(total: &ViewReport, maps: &Maps) -> String {
    let fuse = format!("`vamvs fuse {}`", maps.root().display());
    let ViewReport { without_depth, masked, unconfident, outside_roi, inconsistent, .. } = *total;
    let counts = [
        (
            without_depth,
            "Look at the depth range (--depth-range), the masks and the brightness limits of the depth maps"
                .to_owned(),
        ),
        (masked, "Look at the masks (--masks)".to_owned()),
        (unconfident, format!("Lower --confidence, with {fuse}")),
        (outside_roi, "Look at the region of interest (--roi)".to_owned()),
        (
            inconsistent,
            format!(
                "Loosen --min-support, --min-views, --max-reprojection or --max-relative-depth, with {fuse}"
            ),
        ),
    ];
    counts.into_iter().max_by_key(|(count, _)| *count).map(|(_, advice)| advice).unwrap_or_default()
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
