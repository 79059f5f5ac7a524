//! The device of the tensors.

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
    fn unknown_names_and_absent_gpus_are_errors() {
        assert_eq!(open_device("cpu").unwrap(), Device::Cpu);
        assert!(open_device("auto").is_ok());
        for name in ["tpu", "cuda:x", "cuda:99", ""] {
            assert!(matches!(open_device(name), Err(NetError::Device { .. })), "{name}");
        }
    }
}
