//! Depth maps.

use std::sync::Arc;

use numpy::{PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use vamvs::ViewMap;
use vamvs::core::{self, Grid, Pinhole};

use crate::arrays::{
    from_grid, from_intrinsics, from_pose, from_triples, to_grid, to_intrinsics, to_pose, to_triples,
};
use crate::work::Work;

/// A depth map with its camera, confidence, normals and photograph.
#[pyclass(frozen, module = "vamvs")]
pub struct DepthMap(pub Arc<ViewMap>);

/// Depth maps that are made one by one.
#[pyclass(frozen, module = "vamvs")]
pub struct DepthMaps(pub Work<ViewMap>);

#[pymethods]
impl DepthMaps {
    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<DepthMap>> {
        Ok(self.0.next(py)?.map(|map| DepthMap(Arc::new(map))))
    }
}

#[pymethods]
#[expect(non_snake_case, reason = "K is the matrix's name")]
impl DepthMap {
    #[new]
    #[pyo3(signature = (name, depth, K, cam_from_world, colour, confidence = None, normal = None, sigma = None))]
    #[expect(
        clippy::needless_pass_by_value,
        clippy::too_many_arguments,
        reason = "pyo3 gives values, Python has keywords"
    )]
    fn new(
        name: String,
        depth: PyReadonlyArray2<'_, f32>,
        K: PyReadonlyArray2<'_, f64>,
        cam_from_world: PyReadonlyArray2<'_, f64>,
        colour: PyReadonlyArray3<'_, u8>,
        confidence: Option<PyReadonlyArray2<'_, f32>>,
        normal: Option<PyReadonlyArray3<'_, f32>>,
        sigma: Option<PyReadonlyArray2<'_, f32>>,
    ) -> PyResult<Self> {
        let depth = to_grid(&depth);
        let size = depth.size();
        let confidence = match confidence {
            Some(confidence) => to_grid(&confidence),
            None => depth.map(|&depth| f32::from(u8::from(depth > 0.0))),
        };
        let colour = to_triples("colour", &colour)?;
        let normals = normal.map(|normal| to_triples("normal", &normal)).transpose()?;
        let sigma = sigma.map(|sigma| to_grid(&sigma));
        sigma.iter().try_for_each(|sigma| expect_size("sigma", sigma.size(), size))?;
        expect_size("confidence", confidence.size(), size)?;
        expect_size("colour", colour.size(), size)?;
        normals.iter().try_for_each(|normals| expect_size("normal", normals.size(), size))?;
        let camera = Pinhole { size, intrinsics: to_intrinsics(&K)? };
        let cam_from_world = to_pose(&cam_from_world)?;
        let map = core::DepthMap { camera, cam_from_world, depth, confidence, coarse_confidence: None };
        Ok(Self(Arc::new(ViewMap { name, view: 0, map, normals, sigma, colour, neighbours: Vec::new() })))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_grid(py, &self.0.map.depth)
    }

    #[getter]
    fn confidence<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_grid(py, &self.0.map.confidence)
    }

    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        self.0.normals.as_ref().map(|normals: &Grid<[f32; 3]>| from_triples(py, normals)).transpose()
    }

    #[getter]
    fn sigma<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        self.0.sigma.as_ref().map(|sigma| from_grid(py, sigma)).transpose()
    }

    #[getter]
    fn colour<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        from_triples(py, &self.0.colour)
    }

    #[getter]
    fn K<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_intrinsics(py, &self.0.map.camera.intrinsics)
    }

    #[getter]
    fn cam_from_world<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_pose(py, &self.0.map.cam_from_world)
    }

    fn __repr__(&self) -> String {
        format!("<vamvs.DepthMap {} of {} pixels>", self.0.name, self.0.map.depth.size())
    }
}

fn expect_size(what: &str, found: core::Size, expected: core::Size) -> PyResult<()> {
    let text = || format!("{what}: expected {expected} pixels like the depth, found {found}");
    if found == expected { Ok(()) } else { Err(PyValueError::new_err(text())) }
}
