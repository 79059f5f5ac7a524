//! The device of the tensors.

use std::ffi::c_int;

use crate::NetError;

/// The CPU or a GPU.
pub type Device = tch::Device;

/// Opens `auto` (a GPU if there is one, else the CPU), `cpu`, `cuda` or `cuda:N`.
///
/// # Errors
/// If the name is none of these, or the requested GPU is not available.
pub fn open_device(name: &str) -> Result<Device, NetError> {
    let unavailable = |reason: &str| NetError::Device { wanted: name.to_owned(), reason: reason.to_owned() };
    match name {
        "cpu" => Ok(Device::Cpu),
        "auto" => {
            load_cuda();
            Ok(Device::cuda_if_available())
        }
        _ => {
            let index = match name.strip_prefix("cuda") {
                Some("") => Some(0),
                Some(rest) => rest.strip_prefix(':').and_then(|number| number.parse::<usize>().ok()),
                None => None,
            };
            let index = index.ok_or_else(|| unavailable("expected auto, cpu, cuda or cuda:N"))?;
            load_cuda();
            if index < usize::try_from(tch::Cuda::device_count()).unwrap_or(0) {
                Ok(Device::Cuda(index))
            } else {
                Err(unavailable(
                    "libtorch finds no such GPU; `cargo xtask setup --cuda` installs a libtorch that can use one",
                ))
            }
        }
    }
}

/// The short name of a device, to display: `cpu`, `cuda:0`.
#[must_use]
pub fn device_name(device: Device) -> String {
    match device {
        Device::Cuda(index) => format!("cuda:{index}"),
        _ => "cpu".to_owned(),
    }
}

/// The memory of a GPU that is free, bytes; `None` for a processor, or if the CUDA runtime does not tell.
#[must_use]
pub fn free_device_memory(device: Device) -> Option<u64> {
    let Device::Cuda(index) = device else { return None };
    CUDA_RUNTIMES.iter().find_map(|name| free_memory_told_by(name, index))
}

/// The CUDA runtime of libtorch, which has loaded it already, by the names of several versions.
const CUDA_RUNTIMES: [&str; 2] = ["libcudart.so.13", "libcudart.so.12"];

/// `cudaMemGetInfo` for the GPU of this index, by the runtime library of this name.
fn free_memory_told_by(name: &str, index: usize) -> Option<u64> {
    type SetDevice = unsafe extern "C" fn(c_int) -> c_int;
    type MemGetInfo = unsafe extern "C" fn(*mut usize, *mut usize) -> c_int;
    let (mut free, mut total) = (0, 0);
    // SAFETY: the runtime's initialisers have run already; the signatures are those of cuda_runtime_api.h, and both
    // numbers outlive the call.
    let told = unsafe {
        let runtime = libloading::Library::new(name).ok()?;
        let set_device = runtime.get::<SetDevice>(b"cudaSetDevice").ok()?;
        let mem_get_info = runtime.get::<MemGetInfo>(b"cudaMemGetInfo").ok()?;
        set_device(c_int::try_from(index).ok()?) == 0 && mem_get_info(&raw mut free, &raw mut total) == 0
    };
    told.then_some(free as u64)
}

/// Waits until a GPU has done all that it was given; a processor has.
pub(crate) fn synchronize(device: Device) {
    if let Device::Cuda(index) = device {
        tch::Cuda::synchronize(index as i64);
    }
}

/// Loads libtorch's GPU library, which the program is not linked with, before the first query for GPUs. Does nothing
/// if the libtorch in use has no GPU library.
fn load_cuda() {
    // SAFETY: the library's initialisers register kernels with the libtorch that is loaded already.
    if let Ok(library) = unsafe { libloading::Library::new("libtorch_cuda.so") } {
        std::mem::forget(library);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_has_no_device_memory_and_an_absent_runtime_tells_none() {
        assert_eq!(free_device_memory(Device::Cpu), None);
        assert_eq!(free_memory_told_by("libno-such-runtime.so", 0), None);
    }

    #[test]
    fn unknown_names_and_absent_gpus_are_errors() {
        assert_eq!(open_device("cpu").unwrap(), Device::Cpu);
        assert!(open_device("auto").is_ok());
        for name in ["tpu", "cuda:x", "cuda:99", ""] {
            assert!(matches!(open_device(name), Err(NetError::Device { .. })), "{name}");
        }
    }
}
