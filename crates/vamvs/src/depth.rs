//! Depth maps of all views: kept in an output folder ([`estimate`]), or handed over one by one ([`DepthMaps`]).

pub(crate) mod draft;
mod in_memory;
mod less_memory;
mod maker;
mod parts;
mod region;
mod run;
mod second_pass;

use std::time::Duration;

pub use in_memory::DepthMaps;
pub use parts::{DepthStep, collect, estimate_part, record_file};

use crate::event::OnEvent;
use crate::output::Lock;
use crate::output::{LeftOut, names};
use crate::{OutputFolder, Prepared, VamvsError};
use run::{Run, first_folder};

/// What became of the views.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct DepthSummary {
    /// Depth maps made now.
    pub made: usize,
    /// Depth maps that were there already.
    pub resumed: usize,
    /// Views without depth map.
    pub skipped: Vec<LeftOut>,
    /// Where the time of the network, or of the plane sweep without one, went.
    pub stages: Vec<(String, Duration)>,
    /// Time to read, undistort and reduce photographs.
    pub reading: Duration,
    /// Time of the first refinement pass, which uses photographs alone.
    pub refining: Duration,
    /// Time of the geometric pass, which uses the depth maps of the source views too.
    pub refining_again: Duration,
    /// Time to write depth maps.
    pub writing: Duration,
}

/// Depth maps that go to a folder.
#[derive(Clone, Copy, Debug)]
pub struct DepthJob<'a> {
    /// What they are made of.
    pub work: &'a Prepared,
    /// Where they go.
    pub output: &'a OutputFolder,
    /// Whether to make depth maps again that exist already.
    pub force: bool,
}

/// Estimates the depth maps of all planned views. Those in the output folder that were made from
/// the same photographs, cameras, network and options are kept.
///
/// # Errors
/// If no view has a depth map in the end, a file cannot be written, or `on_event` breaks. Depth
/// maps that are finished by then stay. A view is left out, also as a source view, if its
/// photograph cannot be read or memory runs out even at half the size.
pub fn estimate(job: &DepthJob<'_>, on_event: &mut OnEvent<'_>) -> Result<DepthSummary, VamvsError> {
    let _lock = prepare_alone(job)?;
    Run::new(job).all_views(on_event)
}

/// Makes the output folder for the views that will have a depth map; [`estimate`] does this too.
///
/// # Errors
/// If the folder is the scene's own, holds depth maps of other views or files that vamvs has not written and would
/// overwrite, another run writes to it, or it cannot be made.
pub fn prepare(job: &DepthJob<'_>) -> Result<(), VamvsError> {
    prepare_alone(job).map(drop)
}

/// As [`prepare`]; keeps other runs from the folder.
fn prepare_alone(job: &DepthJob<'_>) -> Result<Lock, VamvsError> {
    let DepthJob { work, output, .. } = job;
    output.expect_apart(work.photographs.folder())?;
    let (maps, views) = (planned_maps(work), names(&work.scene.views));
    let maps: Vec<&str> = maps.iter().map(String::as_str).collect();
    let views: Vec<&str> = views.iter().map(String::as_str).collect();
    let lock = output.prepare_alone(&maps, &views)?;
    let first = first_folder(job);
    if first == **output {
        // An interrupted run with two passes may have left first-pass maps.
        let left = output.photometric();
        if left.is_own() {
            left.remove(&maps)?;
        }
    } else {
        first.expect_apart(work.photographs.folder())?;
        first.prepare_alone(&maps, &views)?;
    }
    output.forget_views()?;
    Ok(lock)
}

/// The names of all depth maps that are planned.
fn planned_maps(work: &Prepared) -> Vec<String> {
    let names = names(&work.scene.views);
    let planned = (0..names.len()).filter(|&view| work.plan.views[view].is_ok());
    planned.flat_map(|view| work.map_names(view, &names[view])).collect()
}
