//! GPUs: which there are, and one of them, opened.

use std::collections::BTreeMap;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use wgpu::{Backends, Device, DeviceType, ErrorFilter, PollType};

use crate::GpuError;
use crate::kernels::Kernels;
use crate::matching_kernels::MatchingKernels;

/// A GPU of this machine, or a program that does what one does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Its name.
    pub name: String,
    /// The interface by which it is used: Vulkan, Metal, DirectX 12.
    pub backend: String,
    /// Its driver, as it calls itself.
    pub driver: String,
    /// Whether it is a program on the processor.
    pub is_software: bool,
    /// The largest piece of its memory that a kernel can use, bytes.
    pub largest_buffer: u64,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, backend, driver, is_software, .. } = self;
        let kind = if *is_software { ", software" } else { "" };
        write!(f, "{name} ({backend}{kind}, driver {driver})")
    }
}

fn instance() -> wgpu::Instance {
    let mut options = wgpu::InstanceDescriptor::new_without_display_handle();
    options.backends = Backends::VULKAN | Backends::METAL | Backends::DX12;
    wgpu::Instance::new(options)
}

/// The adapters, those that are hardware first, and of these those with a memory of their own.
fn found() -> Vec<wgpu::Adapter> {
    let instance = instance();
    let mut adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
    adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::VirtualGpu => 1,
        DeviceType::IntegratedGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    });
    adapters
}

fn described(adapter: &wgpu::Adapter) -> Adapter {
    let info = adapter.get_info();
    let limits = adapter.limits();
    Adapter {
        name: info.name,
        backend: info.backend.to_string(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        is_software: info.device_type == DeviceType::Cpu,
        largest_buffer: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
    }
}

/// The GPUs of this machine: hardware first, the fastest kind first.
#[must_use]
pub fn adapters() -> Vec<Adapter> {
    found().iter().map(described).collect()
}

/// A GPU that is ready for work.
pub struct Gpu {
    adapter: Adapter,
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) kernels: Kernels,
    lost: Arc<Mutex<Option<String>>>,
    operations: AtomicU64,
    /// The kernels of refinement, by the number of views that a correlation is the mean over.
    pub(crate) matching: Mutex<BTreeMap<usize, Arc<MatchingKernels>>>,
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.adapter)
    }
}

impl Gpu {
    /// The GPU with this number in [`adapters`], or the first that is hardware.
    ///
    /// # Errors
    /// If there is none, or its driver refuses it.
    pub fn open(number: Option<usize>) -> Result<Self, GpuError> {
        Self::open_within(number, u64::MAX)
    }

    /// As [`Gpu::open`], as if the largest piece of memory that a kernel can use were at most `largest_buffer` bytes.
    ///
    /// # Errors
    /// As [`Gpu::open`].
    pub fn open_within(number: Option<usize>, largest_buffer: u64) -> Result<Self, GpuError> {
        let found = found();
        let chosen = match number {
            Some(number) => found.get(number),
            None => found.first().filter(|adapter| !described(adapter).is_software),
        };
        let chosen = chosen.ok_or_else(|| missing(number, &found))?;
        let mut adapter = described(chosen);
        adapter.largest_buffer = adapter.largest_buffer.min(largest_buffer);
        let options = wgpu::DeviceDescriptor {
            label: Some("vamvs"),
            required_limits: chosen.limits(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let refused = |error: wgpu::RequestDeviceError| GpuError::Device {
            adapter: adapter.name.clone(),
            problem: error.to_string(),
        };
        let (device, queue) = pollster::block_on(chosen.request_device(&options)).map_err(refused)?;
        let lost = Arc::new(Mutex::new(None));
        let tell = Arc::clone(&lost);
        device.set_device_lost_callback(move |_, reason| {
            *tell.lock().expect("no thread fails while it holds this lock") = Some(reason);
        });
        let (kernels, problem) = watched(&device, &adapter.name, || Kernels::new(&device));
        problem?;
        Ok(Self {
            adapter,
            device,
            queue,
            kernels,
            lost,
            operations: AtomicU64::new(0),
            matching: Mutex::default(),
        })
    }

    /// What it is.
    #[must_use]
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The floating-point operations of the convolutions that it was given so far, those to one channel left out.
    #[must_use]
    pub fn operations(&self) -> u64 {
        self.operations.load(Ordering::Relaxed)
    }

    pub(crate) fn count(&self, operations: u64) {
        self.operations.fetch_add(operations, Ordering::Relaxed);
    }

    /// Runs what gives the device work, and waits until it is done.
    pub(crate) fn checked<T>(&self, work: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
        let ((result, waited), problem) = watched(&self.device, &self.adapter.name, || (work(), self.wait()));
        waited?;
        problem?;
        result
    }

    /// Waits until the device has done all that it was given. wgpu panics where such a wait finds the device lost.
    pub(crate) fn wait(&self) -> Result<(), GpuError> {
        let wait = || self.device.poll(PollType::wait_indefinitely());
        let waited = catch_unwind(AssertUnwindSafe(wait));
        let adapter = self.adapter.name.clone();
        let told = self.lost.lock().expect("no thread fails while it holds this lock").clone();
        match (told, waited) {
            (Some(reason), _) => Err(GpuError::Lost { adapter, reason }),
            (None, Err(_)) => Err(GpuError::Lost { adapter, reason: "its driver gave up".to_owned() }),
            (None, Ok(Err(error))) => Err(GpuError::Device { adapter, problem: error.to_string() }),
            (None, Ok(Ok(_))) => Ok(()),
        }
    }
}

/// Runs what uses a device, and tells the first problem that it had with it.
fn watched<T>(device: &Device, adapter: &str, work: impl FnOnce() -> T) -> (T, Result<(), GpuError>) {
    let scopes = [ErrorFilter::Internal, ErrorFilter::Validation, ErrorFilter::OutOfMemory]
        .map(|filter| device.push_error_scope(filter));
    let result = work();
    // Scopes end in the opposite order.
    let errors: Vec<_> = scopes.into_iter().rev().map(|scope| pollster::block_on(scope.pop())).collect();
    let adapter = adapter.to_owned();
    let problem = match errors.into_iter().flatten().next() {
        Some(wgpu::Error::OutOfMemory { source }) => {
            Err(GpuError::Memory { adapter, problem: source.to_string() })
        }
        Some(error) => Err(GpuError::Device { adapter, problem: error.to_string() }),
        None => Ok(()),
    };
    (result, problem)
}

/// Why there is no adapter of this number, or none that is hardware.
fn missing(number: Option<usize>, found: &[wgpu::Adapter]) -> GpuError {
    let list: Vec<String> =
        found.iter().enumerate().map(|(at, adapter)| format!("gpu:{at} is {}", described(adapter))).collect();
    let asked = number.map_or("no GPU was found".to_owned(), |number| format!("there is no GPU {number}"));
    let rest = match list.is_empty() {
        true => {
            ": expected a driver for Vulkan, Metal or DirectX 12 (on Linux the Vulkan loader libvulkan1 too)"
                .to_owned()
        }
        false => format!(": {}", list.join(", ")),
    };
    GpuError::NoAdapter(asked + &rest)
}
