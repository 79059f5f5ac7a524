//! `vamvs fuse`: depth maps to one cloud.

use std::path::Path;

use anyhow::{Result, bail};
use serde_json::json;
use vamvs::{FuseSummary, OutputFolder};

use crate::arguments::FuseArguments;
use crate::progress::Progress;
use crate::settings::{Settings, roi, set};

/// Runs the command.
pub fn run(arguments: &FuseArguments) -> Result<()> {
    let mut settings = Settings::load(&arguments.common)?;
    settings.apply_fusion(&arguments.fusion);
    set(&mut settings.fusion.roi, roi(arguments.roi.as_deref())?.map(Some));
    settings.use_threads()?;
    let progress = Progress::new(arguments.common.quiet);
    let folder = OutputFolder::find(&arguments.depths)?;
    let cloud = arguments.out.clone().unwrap_or_else(|| folder.cloud());
    let fused = merge(&folder, &cloud, arguments.masks.as_deref(), &settings, &progress);
    progress.finish();
    let fused = fused?;
    if arguments.common.json {
        println!("{}", as_json(&fused));
    } else {
        println!("{}", cloud.display());
    }
    Ok(())
}

/// Fuses and says what became of the pixels; no points at all are an error.
pub fn merge(
    folder: &OutputFolder,
    cloud: &Path,
    masks: Option<&Path>,
    settings: &Settings,
    progress: &Progress,
) -> Result<FuseSummary> {
    if let Some(missing) = masks.filter(|folder| !folder.is_dir()) {
        bail!("--masks {}: expected a folder", missing.display());
    }
    let fused = vamvs::fuse(folder, cloud, masks, &settings.fusion, &mut |event| progress.show(event))?;
    if fused.points == 0 {
        bail!(
            "no point survived the filters, so no cloud was written: {}. Loosen --min-views, --confidence, --max-reprojection or --max-relative-depth, with `vamvs fuse {}`",
            fused.total(),
            folder.root().display()
        );
    }
    progress.say(&fused.total().to_string());
    Ok(fused)
}

/// The summary for scripts.
pub fn as_json(fused: &FuseSummary) -> serde_json::Value {
    let views: Vec<_> =
        fused.views.iter().map(|(name, report)| json!({"view": name, "pixels": report})).collect();
    json!({"points": fused.points, "total": fused.total(), "views": views})
}
