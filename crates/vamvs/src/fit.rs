//! Makes depth maps fit into memory.

use vamvs_core::Scene;
use vamvs_net::{Device, Estimator};

use crate::event::{OnEvent, tell};
use crate::memory::format_bytes;
use crate::{DepthOptions, Event, Photographs, Plan, VamvsError, ViewPlan};

/// Factor from one tried size of photographs to the next.
const STEP: f64 = 0.9;

/// The smallest longer side that is tried, pixels.
const SMALLEST: usize = 256;

/// Factor by which the estimator's pieces (slabs and strips) become smaller before photographs do.
const SMALLER_PIECES: usize = 8;

/// The photographs and the plan with which every depth map is expected to fit into the memory of
/// `options`: where it would not, the estimator works in smaller pieces, and if that does not help,
/// photographs are reduced. A warning says what was reduced. The memory of a GPU is not checked.
///
/// # Errors
/// As [`plan`](fn@crate::plan).
pub(crate) fn fit_to_memory(
    scene: &Scene,
    photographs: &Photographs,
    options: &DepthOptions,
    estimator: &mut Estimator,
    on_event: &mut OnEvent<'_>,
) -> Result<(Photographs, Plan), VamvsError> {
    let plan = crate::plan(scene, photographs, options)?;
    let (free, needed) = (options.max_memory.remaining(), most_bytes(&plan, estimator));
    if needed <= free || estimator.network().device() != Device::Cpu {
        return Ok((photographs.clone(), plan));
    }
    let pieces = estimator.options_mut();
    pieces.slab_bytes /= SMALLER_PIECES;
    pieces.strip_points /= SMALLER_PIECES;
    let (photographs, plan) = reduced((photographs, plan), scene, options, (estimator, free))?;
    let size = longest_side(&plan);
    let text = format!(
        "a depth map takes about {}, and {} of --max-memory {} are free: it is made in smaller pieces, of photographs of {size} pixels, and takes about {}",
        format_bytes(needed),
        format_bytes(free),
        options.max_memory,
        format_bytes(most_bytes(&plan, estimator)),
    );
    tell(on_event, Event::Warning(text))?;
    Ok((photographs, plan))
}

/// The photographs, reduced until depth maps fit.
fn reduced(
    (photographs, mut plan): (&Photographs, Plan),
    scene: &Scene,
    options: &DepthOptions,
    (estimator, free): (&Estimator, u64),
) -> Result<(Photographs, Plan), VamvsError> {
    let mut photographs = photographs.clone();
    let sizes = std::iter::successors(Some(longest_side(&plan) as f64 * STEP), |size| Some(size * STEP));
    for size in sizes.map(|size| size as usize).take_while(|&size| size >= SMALLEST) {
        if most_bytes(&plan, estimator) <= free {
            break;
        }
        photographs = photographs.reduced_to(size);
        plan = crate::plan(scene, &photographs, options)?;
    }
    Ok((photographs, plan))
}

/// The longest side of all photographs, pixels.
fn longest_side(plan: &Plan) -> usize {
    plan.cameras.iter().map(|camera| camera.size.width.max(camera.size.height)).max().unwrap_or(0)
}

/// Memory of the network for the largest depth map, bytes. Refinement begins after it is freed.
pub(crate) fn most_bytes(plan: &Plan, estimator: &Estimator) -> u64 {
    let bytes = |(view, planned): (usize, &ViewPlan)| {
        estimator.peak_bytes(plan.cameras[view].size, planned.sources.len() + 1, planned.planes.count) as u64
    };
    let planned =
        plan.views.iter().enumerate().filter_map(|(view, planned)| Some((view, planned.as_ref().ok()?)));
    planned.map(bytes).max().unwrap_or(0)
}
