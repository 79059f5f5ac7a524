//! Makes depth maps fit into memory.

use std::fmt;

use vamvs_core::Scene;
#[cfg(feature = "torch")]
use vamvs_net::{Device, free_device_memory};

use crate::event::{OnEvent, tell};
use crate::memory::format_bytes;
use crate::{DepthOptions, Event, MemoryLimit, Method, Photographs, Plan, VamvsError, ViewPlan};

/// Factor from one tried size of photographs to the next.
const STEP: f64 = 0.9;

/// The smallest longer side that is tried, pixels.
const SMALLEST: usize = 256;

/// Factor by which the method's pieces (slabs and strips) become smaller before photographs do.
const SMALLER_PIECES: usize = 8;

/// Share of a GPU's free memory that the network may take; the rest is for the workspaces of its libraries.
#[cfg(feature = "torch")]
const OF_THE_GPU: f64 = 0.8;

/// The memory that a method works in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MethodMemory {
    /// What may be taken, bytes.
    free: u64,
    /// The limit of the process's resident memory; `None` for the memory of a GPU.
    limit: Option<MemoryLimit>,
    /// What features of photographs may take, if `free` is only the largest piece of a GPU's memory.
    features: Option<u64>,
}

impl MethodMemory {
    /// What is left of the process's resident memory.
    pub fn of_process(limit: MemoryLimit) -> Self {
        Self { free: limit.remaining(), limit: Some(limit), features: None }
    }

    /// The memory of the device that a network is on; not limited if a GPU does not report it.
    #[cfg(feature = "torch")]
    pub fn of_device(device: Device, limit: MemoryLimit) -> Self {
        Self::told_by(free_device_memory, device, limit)
    }

    #[cfg(feature = "torch")]
    fn told_by(free: impl Fn(Device) -> Option<u64>, device: Device, limit: MemoryLimit) -> Self {
        match device {
            Device::Cpu => Self::of_process(limit),
            _ => {
                let free = free(device).map_or(u64::MAX, |free| (OF_THE_GPU * free as f64) as u64);
                Self { free, limit: None, features: None }
            }
        }
    }

    /// A GPU that does not tell how much memory it has, but how large a piece of it may be. Its memory may be the processor's, so
    /// features take a quarter of the process's at most.
    #[cfg(feature = "gpu")]
    pub fn of_pieces(largest: u64, limit: MemoryLimit) -> Self {
        Self { free: largest, limit: None, features: Some(limit.remaining() / 4) }
    }

    /// What features of photographs may take beside what needs so much, bytes.
    pub fn for_features(self, others: u64) -> u64 {
        self.features.unwrap_or(self.free.saturating_sub(others))
    }

    /// What may be taken, bytes.
    pub fn free(self) -> u64 {
        self.free
    }

    /// What the method takes of the process's memory for a depth map that takes `needed` bytes of this one.
    pub fn in_process(self, needed: u64) -> u64 {
        if self.limit.is_some() { needed } else { 0 }
    }
}

impl fmt::Display for MethodMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let free = format_bytes(self.free);
        match self.limit {
            None if self.features.is_some() => write!(f, "{free} of the GPU's memory may be in one piece"),
            Some(limit) => write!(f, "{free} of --max-memory {limit} are free"),
            None => write!(f, "{free} of the GPU's memory may be taken"),
        }
    }
}

/// The photographs and the plan with which every depth map is expected to fit into `memory`: where it would not, the
/// method works in smaller pieces, and if that does not help, photographs are reduced. A warning says what was
/// reduced.
///
/// # Errors
/// As [`plan`](fn@crate::plan).
pub(crate) fn fit_to_memory(
    scene: &Scene,
    photographs: &Photographs,
    options: &DepthOptions,
    (method, memory): (&mut Method, MethodMemory),
    on_event: &mut OnEvent<'_>,
) -> Result<(Photographs, Plan), VamvsError> {
    let plan = crate::plan(scene, photographs, options, method.plane_step())?;
    let needed = most_bytes(&plan, method);
    if needed <= memory.free() {
        return Ok((photographs.clone(), plan));
    }
    let in_pieces = if method.use_smaller_pieces(SMALLER_PIECES) { "in smaller pieces, " } else { "" };
    let (photographs, plan) = reduced((photographs, plan), scene, options, (method, memory.free()))?;
    let (size, left) = (longest_side(&plan), most_bytes(&plan, method));
    let takes = if left > memory.free() { "but still takes" } else { "and takes" };
    let text = format!(
        "a depth map takes about {}, and {memory}: it is made {in_pieces}of photographs of {size} pixels, {takes} about {}",
        format_bytes(needed),
        format_bytes(left),
    );
    tell(on_event, Event::Warning(text))?;
    Ok((photographs, plan))
}

/// The photographs, reduced until depth maps fit.
fn reduced(
    (photographs, mut plan): (&Photographs, Plan),
    scene: &Scene,
    options: &DepthOptions,
    (method, free): (&Method, u64),
) -> Result<(Photographs, Plan), VamvsError> {
    let mut photographs = photographs.clone();
    let (longest, needed) = (longest_side(&plan) as f64, most_bytes(&plan, method) as f64);
    let sizes = std::iter::successors(Some(longest * STEP), |size| Some(size * STEP));
    let mut sizes: Vec<usize> =
        sizes.map(|size| size as usize).take_while(|&size| size >= SMALLEST).collect();
    // What does not depend on the size stays, so that depth maps of these sizes need more than that.
    let cannot_fit = |size: &usize| needed * (*size as f64 / longest).powi(2) > free as f64;
    let first = sizes.iter().position(|size| !cannot_fit(size)).unwrap_or(sizes.len().saturating_sub(1));
    for size in sizes.split_off(first) {
        if most_bytes(&plan, method) <= free {
            break;
        }
        photographs = photographs.reduced_to(size);
        plan = crate::plan(scene, &photographs, options, method.plane_step())?;
    }
    Ok((photographs, plan))
}

/// The longest side of all photographs, pixels.
fn longest_side(plan: &Plan) -> usize {
    plan.cameras.iter().map(|camera| camera.size.longer_side()).max().unwrap_or(0)
}

/// Memory of the method for the largest depth map, bytes. Refinement begins after it is freed.
pub(crate) fn most_bytes(plan: &Plan, method: &Method) -> u64 {
    let bytes = |(view, planned): (usize, &ViewPlan)| {
        method.peak_bytes(plan.cameras[view].size, planned.sources.len() + 1, planned.planes.count)
    };
    let planned =
        plan.views.iter().enumerate().filter_map(|(view, planned)| Some((view, planned.as_ref().ok()?)));
    planned.map(bytes).max().unwrap_or(0)
}

#[cfg(feature = "torch")]
#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use std::ops::ControlFlow;
    use std::path::Path;
    use vamvs_core::{Camera, DepthRange, Intrinsics, Lens, Pose, Size, View};
    use vamvs_io::masks::Masks;

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
    fn fitted(memory: MethodMemory) -> (usize, u64, Option<String>) {
        let options = DepthOptions {
            depth_range: Some(DepthRange::try_new(2.0, 20.0).unwrap()),
            ..DepthOptions::default()
        };
        let mut method = Method::new(Some(Path::new("photometric")), Some("cpu"), &options).unwrap();
        let photographs = Photographs::new(Path::new("images"), Masks::None, &options);
        let mut warning = None;
        let mut on_event = |event: Event| {
            if let Event::Warning(text) = event {
                warning = Some(text);
            }
            ControlFlow::Continue(())
        };
        let (_, plan) =
            fit_to_memory(&scene(), &photographs, &options, (&mut method, memory), &mut on_event).unwrap();
        (longest_side(&plan), most_bytes(&plan, &method), warning)
    }

    #[test]
    fn photographs_are_reduced_to_what_a_gpu_has_free() {
        let gpu = |free: u64| {
            let told = |device| (device == Device::Cuda(1)).then_some(free);
            MethodMemory::told_by(told, Device::Cuda(1), MemoryLimit::Bytes(1))
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
        let silent = MethodMemory::told_by(|_| None, Device::Cuda(0), MemoryLimit::Bytes(1));
        assert_eq!(fitted(silent).0, 800);
    }

    #[test]
    fn on_a_processor_the_limit_of_the_process_counts() {
        let nothing_left = MethodMemory::told_by(|_| Some(80 << 30), Device::Cpu, MemoryLimit::Bytes(1));
        let (size, _, warning) = fitted(nothing_left);
        assert!(size < 800 && warning.unwrap().contains("--max-memory"));
        let gpu = MethodMemory::told_by(|_| Some(9), Device::Cuda(0), MemoryLimit::Bytes(1));
        assert_eq!((nothing_left.in_process(7), gpu.in_process(7)), (7, 0));
    }
}
