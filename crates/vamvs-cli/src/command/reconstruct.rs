//! `vamvs reconstruct`: photographs and cameras to depth maps and one cloud.

use anyhow::Result;
use serde_json::json;
use vamvs::io::masks::Masks;
use vamvs::{Maps, OutputFolder};

use super::{depth, fuse, mesh, report};
use crate::arguments::ReconstructArguments;
use crate::progress::Progress;
use crate::timing::Timing;

/// Runs the command.
pub fn run(arguments: &ReconstructArguments) -> Result<()> {
    let mut settings = depth::settings(&arguments.depth)?;
    settings.apply_fusion(&arguments.fusion);
    settings.apply_export(&arguments.export);
    settings.fusion.validate()?;
    settings.export.validate()?;
    let common = &arguments.depth.common;
    let (progress, mut timing) = (Progress::of(common), Timing::begin());
    let maps = depth::estimate(&arguments.depth, &settings, &progress)?;
    super::expect_all_views(common, &maps.skipped)?;
    timing.add_depth(&maps);
    let folder = OutputFolder::new(&arguments.depth.out());
    // Masked pixels have no depth already.
    let made = Maps::open(folder.root(), Masks::None, &mut |event| progress.show(event))?;
    let (made, fused) = fuse::merge_readable(made, &folder.cloud(), &settings, (common, &progress))?;
    timing.add_fusion(&fused);
    let mesh = match arguments.mesh {
        true => Some(
            timing.of("mesh", || mesh::make(&made, &folder.root().join("mesh.ply"), &settings, &progress))?,
        ),
        false => None,
    };
    let kept = (&made, &*folder.cloud(), &fused);
    timing.of("report", || report::keep(kept, &settings, !arguments.no_report, &progress))?;
    progress.finish();
    timing.say(&progress);
    if common.json {
        let mesh = mesh.as_ref().map(mesh::as_json);
        say!("{}", json!({"depth": depth::as_json(&maps), "fusion": fuse::as_json(&fused), "mesh": mesh}));
    } else {
        say!("{}", folder.cloud().display());
        mesh.iter().for_each(|mesh| say!("{}", mesh.file.display()));
    }
    super::expect_all_views(common, &fused.skipped)
}
