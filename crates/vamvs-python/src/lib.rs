//! The Python package `vamvs`: scenes, depth maps and clouds as NumPy arrays, and the command.
//!
//! Work runs on a thread of its own, with the interpreter's lock released. Its events are handed to
//! Python on the calling thread, so Ctrl-C works at once.

mod arrays;
mod cloud;
mod maps;
mod mesh;
mod options;
mod reconstruct;
mod scene;
mod work;

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use vamvs::VamvsError;

create_exception!(_vamvs, Error, PyException, "What went wrong, with the file, line or field.");

create_exception!(_vamvs, Cancelled, Error, "on_event ended the work.");

/// The error as Python sees it.
fn error(error: &VamvsError) -> PyErr {
    match error {
        VamvsError::Cancelled => Cancelled::new_err(error.with_causes()),
        error => Error::new_err(error.with_causes()),
    }
}

#[pymodule]
mod _vamvs {
    #[pymodule_export]
    use super::Cancelled;
    #[pymodule_export]
    use super::Error;
    #[pymodule_export]
    use super::cloud::{Cloud, fuse};
    #[pymodule_export]
    use super::maps::{DepthMap, DepthMaps};
    #[pymodule_export]
    use super::mesh::{Mesh, mesh};
    #[pymodule_export]
    use super::reconstruct::{Reconstructed, reconstruct};
    #[pymodule_export]
    use super::run;
    #[pymodule_export]
    use super::scene::Scene;
    #[pymodule_export]
    use super::work::wait;

    use super::{Bound, PyAnyMethods, PyModule, PyModuleMethods, PyResult};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        // Threads must end before the interpreter unloads libtorch.
        module.py().import("atexit")?.call_method1("register", (module.getattr("_wait")?,))?;
        Ok(())
    }
}

/// The command `vamvs`; gives its exit code.
#[pyfunction]
#[pyo3(name = "_run")]
fn run(py: Python<'_>, arguments: Vec<std::ffi::OsString>) -> u8 {
    let code = py.detach(|| vamvs_cli::run(arguments));
    u8::from(code != std::process::ExitCode::SUCCESS)
}
