//! `vamvs reconstruct`: photographs and cameras to depth maps and one cloud.

use anyhow::Result;
use serde_json::json;
use vamvs::io::masks::Masks;
use vamvs::{Maps, OutputFolder};

use super::{depth, fuse};
use crate::arguments::ReconstructArguments;
use crate::progress::Progress;

/// Runs the command.
pub fn run(arguments: &ReconstructArguments) -> Result<()> {
    let mut settings = depth::settings(&arguments.depth)?;
    settings.apply_fusion(&arguments.fusion);
    settings.apply_export(&arguments.export);
    settings.fusion.filter.validate()?;
    let common = &arguments.depth.common;
    let progress = Progress::new(common.quiet);
    let maps = depth::estimate(&arguments.depth, &settings, &progress)?;
    super::expect_all_views(common, &maps.skipped)?;
    let folder = OutputFolder::new(&arguments.depth.out());
    // Masked pixels have no depth already.
    let made = Maps::open(folder.root(), Masks::None, &mut |event| progress.show(event))?;
    let fused = fuse::merge(&made, &folder.cloud(), &settings, &progress);
    progress.finish();
    let fused = fused?;
    if common.json {
        println!("{}", json!({"depth": depth::as_json(&maps), "fusion": fuse::as_json(&fused)}));
    } else {
        println!("{}", folder.cloud().display());
    }
    super::expect_all_views(common, &fused.skipped)
}
