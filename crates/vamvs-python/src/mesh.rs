//! Triangle meshes.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use vamvs::io::mesh::{MeshFormat, write};
use vamvs::{ViewMap, mesh_in_memory};

use crate::arrays::from_rows;
use crate::error;
use crate::maps::DepthMap;
use crate::options::Options;
use crate::work::Work;

/// A triangle mesh.
#[pyclass(frozen, module = "vamvs")]
pub struct Mesh(vamvs::core::Mesh);

/// Makes a mesh of depth maps.
#[pyfunction]
#[pyo3(signature = (maps, on_event = None, **options))]
pub fn mesh(
    py: Python<'_>,
    maps: &Bound<'_, PyAny>,
    on_event: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Mesh> {
    let mut options = Options::new(options)?;
    let (mesh, fusion) = (options.mesh()?, options.fusion()?);
    options.finish()?;
    let map = |map: PyResult<Bound<'_, PyAny>>| Ok(map?.cast::<DepthMap>()?.get().0.clone());
    let maps: Vec<Arc<ViewMap>> = maps.try_iter()?.map(map).collect::<PyResult<_>>()?;
    let work = Work::begin(on_event, move |teller| {
        let made = mesh_in_memory(&maps, (&mesh, &fusion), &mut |event| teller.event(event))?;
        teller.item(made)
    });
    Ok(Mesh(work.next(py)?.unwrap_or_default()))
}

#[pymethods]
impl Mesh {
    fn __repr__(&self) -> String {
        format!("<vamvs.Mesh of {} triangles>", self.0.triangles.len())
    }

    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let vertices = 0..self.0.positions.len() as u32;
        let places: Vec<[f64; 3]> = vertices.map(|vertex| self.0.x_in_world(vertex).into()).collect();
        from_rows(py, &places)
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_rows(py, &self.0.normals)
    }

    #[getter]
    fn colours<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        from_rows(py, &self.0.colours)
    }

    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        from_rows(py, &self.0.triangles)
    }

    /// Writes a PLY, OBJ or GLB file, whole or not at all.
    #[expect(clippy::needless_pass_by_value, reason = "pyo3 gives values")]
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let format = MeshFormat::of(&path).ok_or_else(|| {
            PyValueError::new_err(format!(
                "{}: expected a name that ends in .ply, .obj or .glb",
                path.display()
            ))
        })?;
        py.detach(|| write(&path, &self.0, format)).map_err(|failed| error(&failed.into()))
    }
}
