//! `vamvs mesh`: depth maps to a triangle mesh.

use std::path::Path;

use anyhow::{Context, Result};
use serde_json::json;
use vamvs::{Maps, MeshSummary, PartialMesh};

use super::fuse;
use crate::arguments::{MeshArguments, MeshStepFlags, MeshTask};
use crate::progress::Progress;
use crate::settings::{self, Settings, roi, set};

/// Runs the command.
pub fn run(arguments: &MeshArguments) -> Result<()> {
    let mut settings = Settings::load(&arguments.common)?;
    settings.apply_fusion(&arguments.fusion);
    settings.apply_mesh(&arguments.mesh);
    set(&mut settings.fusion.roi, roi(arguments.roi.as_deref())?.map(Some));
    settings.use_threads()?;
    let progress = Progress::of(&arguments.common);
    let folder = (arguments.depths.as_path(), settings.export.png_step);
    let masks = settings::masks_of(&arguments.input)?;
    super::expect_scene(&arguments.input)?;
    let maps = super::open_maps(folder, (&arguments.input, &arguments.common), masks, &mut |event| {
        progress.show(event)
    })?;
    super::expect_masks(arguments.input.masks.as_deref(), &maps.scene().views)?;
    let file = arguments.out.clone().unwrap_or_else(|| maps.root().join("mesh.ply"));
    let common = &arguments.common;
    let (maps, made) = match arguments.step.step {
        None => {
            let make = |maps: &Maps| make(maps, &file, &settings, &progress);
            fuse::of_readable(maps, &settings, (common, &progress), make)?
        }
        Some(MeshTask::Join) => {
            let made = join(&maps, &file, &settings, (&arguments.step, &progress))?;
            (maps, made)
        }
        Some(step) => return part(&maps, &settings, (step, &arguments.step), &progress),
    };
    if arguments.step.step.is_none() && !arguments.no_report && vamvs::report::shows_mesh(&maps, &made.file) {
        let page =
            vamvs::report::write(&maps, settings.fusion.max_memory, &mut |event| progress.show(event))?;
        progress.say(&format!("report {}", page.display()));
    }
    progress.finish();
    if common.json {
        say!("{}", as_json(&made));
    } else {
        say!("{}", made.file.display());
    }
    super::expect_all_views(common, maps.left_out())
}

/// Makes and writes the mesh, and says how large it is.
pub fn make(maps: &Maps, file: &Path, settings: &Settings, progress: &Progress) -> Result<MeshSummary> {
    let wanted = (&settings.mesh, &settings.fusion);
    let made = vamvs::mesh(maps, file, wanted, &mut |event| progress.show(event))?;
    say_made(&made, progress);
    Ok(made)
}

/// Does a part of one of the passes.
fn part(
    maps: &Maps,
    settings: &Settings,
    (step, flags): (MeshTask, &MeshStepFlags),
    progress: &Progress,
) -> Result<()> {
    let mesh = PartialMesh::new(maps, &settings.mesh, &settings.fusion)?;
    let part = flags.part.context("--part is missing")?;
    let mut show = |event| progress.show(event);
    let did = match step {
        MeshTask::Outline => mesh.outline(part, &mut show)?,
        MeshTask::Surface | MeshTask::Join => mesh.surface(part, &mut show)?,
    };
    super::say_part(part, did, progress);
    Ok(())
}

/// Makes the mesh of all parts.
fn join(
    maps: &Maps,
    file: &Path,
    settings: &Settings,
    (flags, progress): (&MeshStepFlags, &Progress),
) -> Result<MeshSummary> {
    let mesh = PartialMesh::new(maps, &settings.mesh, &settings.fusion)?;
    let parts = flags.parts.context("--parts is missing")?.get();
    let made = mesh.join(parts, file, &mut |event| progress.show(event))?;
    say_made(&made, progress);
    Ok(made)
}

fn say_made(made: &MeshSummary, progress: &Progress) {
    let MeshSummary { vertices, triangles, time, .. } = made;
    progress.say(&format!("mesh: {vertices} vertices, {triangles} triangles, {:.1} s", time.as_secs_f64()));
}

/// The summary for scripts.
pub fn as_json(made: &MeshSummary) -> serde_json::Value {
    let MeshSummary { file, vertices, triangles, time, .. } = made;
    json!({"mesh": file, "vertices": vertices, "triangles": triangles, "seconds": time.as_secs_f64()})
}
