//! `vamvs report`: a run on one page.

use std::path::Path;

use anyhow::Result;
use vamvs::io::masks::Masks;
use vamvs::report::{self, FusionRecord};
use vamvs::{FuseSummary, Maps, MemoryLimit};

use crate::arguments::ReportArguments;
use crate::progress::Progress;
use crate::settings::Settings;

/// Runs the command.
pub fn run(arguments: &ReportArguments) -> Result<()> {
    let progress = Progress::new(arguments.quiet);
    let mut show = |event| progress.show(event);
    let limit = MemoryLimit::default();
    let maps = Maps::open(&arguments.out, Masks::None, &mut show)?.readable(limit, &mut show)?;
    let path = report::write(&maps, limit, &mut show);
    progress.finish();
    say!("{}", path?.display());
    Ok(())
}

/// Saves the record of a fusion and, if `wanted`, writes the page. Does neither for a cloud outside
/// of the folder of the depth maps.
pub fn keep(
    (maps, cloud, fused): (&Maps, &Path, &FuseSummary),
    settings: &Settings,
    wanted: bool,
    progress: &Progress,
) -> Result<()> {
    let Some(record) = FusionRecord::of(maps, cloud, &settings.fusion, fused) else { return Ok(()) };
    record.save(maps.root())?;
    if wanted {
        let path = report::write(maps, settings.fusion.max_memory, &mut |event| progress.show(event))?;
        progress.say(&format!("report {}", path.display()));
    }
    Ok(())
}
