//! Clouds, and the fusion of depth maps.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use vamvs::core::CloudPoint;
use vamvs::{ViewMap, fuse_in_memory, io};

use crate::arrays::from_rows;
use crate::error;
use crate::maps::DepthMap;
use crate::options::Options;
use crate::work::Work;

/// A cloud of points with normals and colours.
#[pyclass(frozen, module = "vamvs")]
pub struct Cloud(Vec<CloudPoint>);

/// Fuses depth maps.
#[pyfunction]
#[pyo3(signature = (maps, on_event = None, **options))]
pub fn fuse(
    py: Python<'_>,
    maps: &Bound<'_, PyAny>,
    on_event: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Cloud> {
    let mut options = Options::new(options)?;
    let fusion = options.fusion()?;
    options.finish()?;
    let map = |map: PyResult<Bound<'_, PyAny>>| Ok(map?.cast::<DepthMap>()?.get().0.clone());
    let maps: Vec<Arc<ViewMap>> = maps.try_iter()?.map(map).collect::<PyResult<_>>()?;
    let work = Work::begin(on_event, move |teller| {
        let cloud = fuse_in_memory(&maps, &fusion, &mut |event| teller.event(event))?;
        teller.item(cloud)
    });
    let cloud = work.next(py)?.unwrap_or_default();
    Ok(Cloud(cloud))
}

#[pymethods]
impl Cloud {
    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        format!("<vamvs.Cloud of {} points>", self.0.len())
    }

    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, &self.column(|point| point.x_in_world))
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_rows(py, &self.column(|point| point.normal))
    }

    #[getter]
    fn colours<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        from_rows(py, &self.column(|point| point.colour))
    }

    #[getter]
    fn confidence<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.column(|point| point.confidence).into_pyarray(py)
    }

    #[getter]
    fn sigma<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.column(|point| point.sigma).into_pyarray(py)
    }

    #[getter]
    fn views<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u16>> {
        self.column(|point| u16::from(point.views)).into_pyarray(py)
    }

    /// Writes a PLY file, whole or not at all.
    #[expect(clippy::needless_pass_by_value, reason = "pyo3 gives values")]
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| io::ply::write(&path, &self.0)).map_err(|failed| error(&failed.into()))
    }
}

impl Cloud {
    fn column<T>(&self, of: impl Fn(&CloudPoint) -> T) -> Vec<T> {
        self.0.iter().map(of).collect()
    }
}
