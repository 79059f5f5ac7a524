//! Makes depth maps fit into memory.

use std::fmt;

use vamvs_core::Scene;
use vamvs_net::{Device, Estimator, free_device_memory};

use crate::event::{OnEvent, tell};
use crate::memory::format_bytes;
use crate::{DepthOptions, Event, MemoryLimit, Photographs, Plan, VamvsError, ViewPlan};

/// Factor from one tried size of photographs to the next.
const STEP: f64 = 0.9;

/// The smallest longer side that is tried, pixels.
const SMALLEST: usize = 256;

/// Factor by which the estimator's pieces (slabs and strips) become smaller before photographs do.
const SMALLER_PIECES: usize = 8;

/// Share of a GPU's free memory that the network may take; the rest is for the workspaces of its libraries.
const OF_THE_GPU: f64 = 0.8;

/// The memory that the network's tensors live in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NetworkMemory {
    /// What is left of the process's resident memory, bytes.
    Process { limit: MemoryLimit, free: u64 },
    /// What may be taken of a GPU's memory, bytes; not limited if the GPU does not report it.
    Gpu { free: u64 },
}

impl NetworkMemory {
    /// The memory of the device that the network is on.
    pub fn of(device: Device, limit: MemoryLimit) -> Self {
        Self::told_by(free_device_memory, device, limit)
    }

    fn told_by(free: impl Fn(Device) -> Option<u64>, device: Device, limit: MemoryLimit) -> Self {
        match device {
            Device::Cpu => Self::Process { limit, free: limit.remaining() },
            _ => Self::Gpu { free: free(device).map_or(u64::MAX, |free| (OF_THE_GPU * free as f64) as u64) },
        }
    }

    /// What may be taken, bytes.
    pub fn free(self) -> u64 {
        match self {
            Self::Process { free, .. } | Self::Gpu { free } => free,
        }
    }

    /// What the network takes of the process's memory for a depth map that takes `needed` bytes of this one.
    pub fn in_process(self, needed: u64) -> u64 {
        if matches!(self, Self::Process { .. }) { needed } else { 0 }
    }
}

impl fmt::Display for NetworkMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let free = format_bytes(self.free());
        match self {
            Self::Process { limit, .. } => write!(f, "{free} of --max-memory {limit} are free"),
            Self::Gpu { .. } => write!(f, "{free} of the GPU's memory may be taken"),
        }
    }
}

/// The photographs and the plan with which every depth map is expected to fit into `memory`: where it would not, the
/// estimator works in smaller pieces, and if that does not help, photographs are reduced. A warning says what was
/// reduced.
///
/// # Errors
/// As [`plan`](fn@crate::plan).
pub(crate) fn fit_to_memory(
    scene: &Scene,
    photographs: &Photographs,
    options: &DepthOptions,
    (estimator, memory): (&mut Estimator, NetworkMemory),
    on_event: &mut OnEvent<'_>,
) -> Result<(Photographs, Plan), VamvsError> {
    let plan = crate::plan(scene, photographs, options, plane_step(estimator))?;
    let needed = most_bytes(&plan, estimator);
    if needed <= memory.free() {
        return Ok((photographs.clone(), plan));
    }
    let pieces = estimator.options_mut();
    pieces.slab_bytes /= SMALLER_PIECES;
    pieces.strip_points /= SMALLER_PIECES;
    let (photographs, plan) = reduced((photographs, plan), scene, options, (estimator, memory.free()))?;
    let size = longest_side(&plan);
    let text = format!(
        "a depth map takes about {}, and {memory}: it is made in smaller pieces, of photographs of {size} pixels, and takes about {}",
        format_bytes(needed),
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
        plan = crate::plan(scene, &photographs, options, plane_step(estimator))?;
    }
    Ok((photographs, plan))
}

fn plane_step(estimator: &Estimator) -> f64 {
    estimator.network().manifest().plane_step
}

/// The longest side of all photographs, pixels.
fn longest_side(plan: &Plan) -> usize {
    plan.cameras.iter().map(|camera| camera.size.longer_side()).max().unwrap_or(0)
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use std::ops::ControlFlow;
    use std::path::Path;
    use vamvs_core::{Camera, DepthRange, Intrinsics, Lens, Pose, Size, View};
    use vamvs_io::masks::Masks;
    use vamvs_net::EstimatorOptions;

    const SIZE: Size = Size::new(800, 600);

    /// Three cameras side by side.
    fn scene() -> Scene {
        let intrinsics = Intrinsics { fx: 900.0, fy: 900.0, cx: 400.0, cy: 300.0 };
        let view = |x: f64| View {
            id: 0,
            name: format!("{x}"),
            camera: Camera { size: SIZE, intrinsics, lens: Lens::None },
            cam_from_world: Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() },
            depth_range: None,
        };
        Scene { views: [0.0, 0.5, 1.0].map(view).into(), points: Vec::new(), pairs: None }
    }

    /// The size of the photographs, the memory of a depth map and the warning, with so much memory.
    fn fitted(memory: NetworkMemory) -> (usize, u64, Option<String>) {
        let options = DepthOptions {
            depth_range: Some(DepthRange::try_new(2.0, 20.0).unwrap()),
            ..DepthOptions::default()
        };
        let network = crate::weights::load(Some(Path::new("photometric")), Device::Cpu).unwrap();
        let estimator_options = EstimatorOptions::of(&network);
        let mut estimator = Estimator::new(network, estimator_options).unwrap();
        let photographs = Photographs::new(Path::new("images"), Masks::None, &options);
        let mut warning = None;
        let mut on_event = |event: Event| {
            if let Event::Warning(text) = event {
                warning = Some(text);
            }
            ControlFlow::Continue(())
        };
        let (_, plan) =
            fit_to_memory(&scene(), &photographs, &options, (&mut estimator, memory), &mut on_event).unwrap();
        (longest_side(&plan), most_bytes(&plan, &estimator), warning)
    }

    #[test]
    fn photographs_are_reduced_to_what_a_gpu_has_free() {
        let gpu = |free: u64| {
            let told = |device| (device == Device::Cuda(1)).then_some(free);
            NetworkMemory::told_by(told, Device::Cuda(1), MemoryLimit::Bytes(1))
        };
        let (size, whole, warning) = fitted(gpu(80 << 30));
        assert_eq!((size, warning), (800, None), "the limit of the process does not count");
        let (size, bytes, warning) = fitted(gpu(whole));
        assert!(size < 800 && bytes <= (OF_THE_GPU * whole as f64) as u64, "{size} pixels, {bytes} bytes");
        let warning = warning.unwrap();
        assert!(
            warning.contains("of the GPU's memory") && warning.contains(&format!("{size} pixels")),
            "{warning}"
        );
        let silent = NetworkMemory::told_by(|_| None, Device::Cuda(0), MemoryLimit::Bytes(1));
        assert_eq!(fitted(silent).0, 800);
    }

    #[test]
    fn on_a_processor_the_limit_of_the_process_counts() {
        let nothing_left = NetworkMemory::told_by(|_| Some(80 << 30), Device::Cpu, MemoryLimit::Bytes(1));
        let (size, _, warning) = fitted(nothing_left);
        assert!(size < 800 && warning.unwrap().contains("--max-memory"));
        assert_eq!((nothing_left.in_process(7), NetworkMemory::Gpu { free: 9 }.in_process(7)), (7, 0));
    }
}
