//! Depth maps of all views: kept in an output folder ([`estimate`]), or handed over one by one ([`DepthMaps`]).

mod in_memory;
mod less_memory;
mod maker;
mod region;
mod run;
mod second_pass;

use std::time::Duration;

use vamvs_net::Profile;

pub use in_memory::DepthMaps;

use crate::event::OnEvent;
use crate::output::{LeftOut, names};
use crate::{OutputFolder, Prepared, VamvsError};
use run::{Run, first_folder};

/// What became of the views.
#[derive(Clone, Debug, Default)]
pub struct DepthSummary {
    /// Depth maps made now.
    pub made: usize,
    /// Depth maps that were there already.
    pub resumed: usize,
    /// Views without depth map.
    pub skipped: Vec<LeftOut>,
    /// Where the network's time went.
    pub profile: Profile,
    /// Time to find out what is there already, and to read, undistort and reduce photographs.
    pub reading: Duration,
    /// Time to refine depth maps to the size of their photographs, by these alone.
    pub refining: Duration,
    /// Time to refine them once more with the depth maps of the source views.
    pub refining_again: Duration,
    /// Time to write depth maps.
    pub writing: Duration,
}

/// Depth maps that go to a folder.
pub struct DepthJob<'a> {
    /// What they are made of.
    pub work: &'a Prepared,
    /// Where they go.
    pub output: &'a OutputFolder,
    /// Whether to make depth maps anew that are there already.
    pub force: bool,
}

/// Estimates the depth maps of all planned views. Those that are in the output folder already, made of
/// the same photographs, cameras, network and options, are left as they are.
///
/// # Errors
/// If no view has a depth map in the end, a file cannot be written, or `on_event` breaks. Depth maps finished until then
/// stay. A view whose photograph cannot be read, or for which memory does not suffice, not even at half the size, is left
/// out and has no part in others.
pub fn estimate(job: &DepthJob<'_>, on_event: &mut OnEvent<'_>) -> Result<DepthSummary, VamvsError> {
    prepare(job)?;
    Run::new(job).all_views(on_event)
}

/// Makes the output folder for the views that will have a depth map; [`estimate`] does it too.
///
/// # Errors
/// If the folder is the scene's own, holds depth maps of other views, or cannot be made.
pub fn prepare(job: &DepthJob<'_>) -> Result<(), VamvsError> {
    let DepthJob { work, output, .. } = job;
    output.expect_apart(work.photographs.folder())?;
    let names = names(&work.scene.views);
    let planned = (0..names.len()).filter(|&view| work.plan.views[view].is_ok());
    let maps: Vec<String> = planned.flat_map(|view| work.map_names(view, &names[view])).collect();
    let maps: Vec<&str> = maps.iter().map(String::as_str).collect();
    output.prepare(&maps)?;
    let first = first_folder(job);
    if first == **output {
        // A run with two passes may have been stopped here.
        output.photometric().remove(&maps)?;
    } else {
        first.expect_apart(work.photographs.folder())?;
        first.prepare(&maps)?;
    }
    output.forget_views()
}
