//! Refines existing depth maps to the size of their photographs.
//!
//! [`refine_view`] and [`refine_view_geometric`] are the solver for one view; [`refine`] does all views of a folder.

mod cache;
mod run;

pub(crate) use cache::PhotoCache;

use std::time::Duration;

use vamvs_core::Scene;

use crate::event::OnEvent;
use crate::output::LeftOut;
use crate::{Maps, MemoryLimit, OutputFolder, Photographs, VamvsError};

#[cfg(feature = "gpu")]
pub use crate::method::refining_device;
pub use vamvs_refine::{RefineError, RefineOptions, Refined, Surface, matching, peak_bytes, plane_sweep};
pub use vamvs_refine::{refine as refine_view, refine_geometric as refine_view_geometric};

/// What refinement works on.
#[derive(Clone, Copy, Debug)]
pub struct RefineJob<'a> {
    /// The depth maps to begin with.
    pub maps: &'a Maps,
    /// The scene with the photographs. Depth maps find their views by name, see
    /// [`crate::output::names`].
    pub scene: &'a Scene,
    /// The photographs, at the size of the refined maps.
    pub photographs: &'a Photographs,
    /// The solver's options.
    pub options: &'a RefineOptions,
    /// Number of views that are compared, the reference included.
    pub views: usize,
    /// Whether a geometric pass follows the photometric one.
    pub geometric: bool,
    /// Where refined maps go.
    pub output: &'a OutputFolder,
    /// How much memory the process may take. A view's own photographs and maps are in memory whatever the limit.
    pub max_memory: MemoryLimit,
    /// Whether to refine again what exists already.
    pub force: bool,
    /// What matches planes in place of the processor.
    pub device: Option<&'a dyn matching::Device>,
}

/// What became of the views.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct RefineSummary {
    /// Depth maps refined now.
    pub made: usize,
    /// Depth maps that were there already.
    pub resumed: usize,
    /// Views without refined depth map.
    pub skipped: Vec<LeftOut>,
    /// Time to read depth maps and photographs.
    pub reading: Duration,
    /// Time of the photometric pass.
    pub photometric: Duration,
    /// Time of the geometric pass.
    pub geometric: Duration,
    /// Time to write.
    pub writing: Duration,
}

/// Refines all depth maps and writes them, with `normals/`, to an output folder. Those in it that
/// were made from the same depth maps, photographs and options are kept.
///
/// # Errors
/// If the output folder is one of the inputs, a file cannot be written, or no view can be refined. A view whose
/// photograph or depth map cannot be read is left out.
pub fn refine(job: &RefineJob, on_event: &mut OnEvent<'_>) -> Result<RefineSummary, VamvsError> {
    run::Run::new(job).views(on_event)
}
