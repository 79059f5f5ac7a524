//! Scenes: cameras with known poses, and where their photographs are.

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use vamvs::core::{self, Camera, Lens, View};
use vamvs::io::{Loaded, mvsnet};
use vamvs::{Input, PhotoSource, Picture, Reconstruction};

use crate::arrays::{to_grid, to_intrinsics, to_pose, to_triples};
use crate::error;
use crate::maps::DepthMaps;
use crate::options::Options;
use crate::work::Work;

/// Views with known cameras.
#[pyclass(frozen, module = "vamvs")]
pub struct Scene(Source);

/// Where cameras and photographs come from.
enum Source {
    Files(Loaded),
    Arrays(core::Scene, Arrays),
}

/// Photographs by the views' ids.
#[derive(Clone)]
struct Arrays(Arc<Vec<Picture>>);

impl PhotoSource for Arrays {
    fn picture(&self, view: &View) -> Result<Picture, Box<dyn Error + Send + Sync>> {
        Ok(self.0.get(view.id as usize).ok_or("there is no such photograph")?.clone())
    }
}

/// Reads a scene's files.
pub fn load(py: Python<'_>, input: &Input) -> PyResult<Loaded> {
    py.detach(|| input.load()).map_err(|failed| error(&failed))
}

#[pymethods]
impl Scene {
    #[staticmethod]
    #[pyo3(signature = (model, images = None))]
    fn from_colmap(py: Python<'_>, model: PathBuf, images: Option<PathBuf>) -> PyResult<Self> {
        Self::read(py, &Input::Colmap { model, images })
    }

    #[staticmethod]
    #[pyo3(signature = (cams, images, pairs = None))]
    fn from_mvsnet(py: Python<'_>, cams: PathBuf, images: PathBuf, pairs: Option<PathBuf>) -> PyResult<Self> {
        Self::read(py, &Input::Mvsnet { cams, images, pairs, options: mvsnet::Options::default() })
    }

    #[staticmethod]
    #[pyo3(signature = (transforms, images = None))]
    fn from_nerfstudio(py: Python<'_>, transforms: PathBuf, images: Option<PathBuf>) -> PyResult<Self> {
        Self::read(py, &Input::Nerfstudio { transforms, images })
    }

    #[staticmethod]
    #[pyo3(signature = (bundle, images = None))]
    fn from_bundler(py: Python<'_>, bundle: PathBuf, images: Option<PathBuf>) -> PyResult<Self> {
        Self::read(py, &Input::Bundler { bundle, images })
    }

    #[staticmethod]
    #[pyo3(signature = (nvm, images = None))]
    fn from_nvm(py: Python<'_>, nvm: PathBuf, images: Option<PathBuf>) -> PyResult<Self> {
        Self::read(py, &Input::Nvm { nvm, images })
    }

    #[staticmethod]
    #[pyo3(signature = (mvs, images = None))]
    fn from_openmvs(py: Python<'_>, mvs: PathBuf, images: Option<PathBuf>) -> PyResult<Self> {
        Self::read(py, &Input::Openmvs { mvs, images })
    }

    #[staticmethod]
    #[pyo3(signature = (images, K, cam_from_world, names = None, masks = None))]
    #[expect(non_snake_case, reason = "K is the matrix's name")]
    #[expect(clippy::needless_pass_by_value, reason = "pyo3 gives values")]
    fn from_arrays(
        images: Vec<PyReadonlyArray3<'_, u8>>,
        K: Vec<PyReadonlyArray2<'_, f64>>,
        cam_from_world: Vec<PyReadonlyArray2<'_, f64>>,
        names: Option<Vec<String>>,
        masks: Option<Vec<Option<PyReadonlyArray2<'_, bool>>>>,
    ) -> PyResult<Self> {
        let count = images.len();
        let names = names.unwrap_or_else(|| (0..count).map(|number| format!("{number:04}")).collect());
        let masks = masks.unwrap_or_else(|| (0..count).map(|_| None).collect());
        let lengths = [("K", K.len()), ("cam_from_world", cam_from_world.len()), ("names", names.len())];
        for (what, length) in lengths.into_iter().chain([("masks", masks.len())]) {
            if length != count {
                let text = format!("{what}: expected one for each of the {count} images, found {length}");
                return Err(PyValueError::new_err(text));
            }
        }
        let (mut views, mut pictures) = (Vec::new(), Vec::new());
        for (number, name) in names.into_iter().enumerate() {
            let image = to_triples("images", &images[number])?;
            let camera =
                Camera { size: image.size(), intrinsics: to_intrinsics(&K[number])?, lens: Lens::None };
            let cam_from_world = to_pose(&cam_from_world[number])?;
            views.push(View { id: number as u32, name, camera, cam_from_world, depth_range: None });
            pictures.push(Picture { image, mask: masks[number].as_ref().map(to_grid) });
        }
        let scene = core::Scene { views, points: Vec::new(), pairs: None };
        Ok(Self(Source::Arrays(scene, Arrays(Arc::new(pictures)))))
    }

    #[getter]
    fn names(&self) -> Vec<String> {
        self.views().iter().map(|view| view.name.clone()).collect()
    }

    fn __len__(&self) -> usize {
        self.views().len()
    }

    fn __repr__(&self) -> String {
        format!("<vamvs.Scene of {} views>", self.views().len())
    }

    #[pyo3(signature = (weights = None, device = None, on_event = None, **options))]
    fn depth_maps(
        &self,
        weights: Option<PathBuf>,
        device: Option<String>,
        on_event: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<DepthMaps> {
        let mut options = Options::new(options)?;
        let quality = options.quality()?;
        let depth = options.depth(quality.unwrap_or_default())?;
        options.finish()?;
        let weights = weights.or(quality.map(|quality| quality.weights().into()));
        let reconstruction = match &self.0 {
            Source::Files(loaded) => Reconstruction::new(loaded.clone()),
            Source::Arrays(scene, arrays) => Reconstruction::with_photographs(scene.clone(), arrays.clone()),
        };
        let reconstruction = run_on(reconstruction, weights, device).depth(depth);
        Ok(DepthMaps(Work::begin(on_event, move |teller| {
            let work = reconstruction.prepare(&mut |event| teller.event(event))?;
            for map in work.depth_maps(Box::new(|event| teller.event(event))) {
                teller.item(map?)?;
            }
            Ok(())
        })))
    }
}

impl Scene {
    fn read(py: Python<'_>, input: &Input) -> PyResult<Self> {
        Ok(Self(Source::Files(load(py, input)?)))
    }

    fn views(&self) -> &[View] {
        match &self.0 {
            Source::Files(loaded) => &loaded.scene.views,
            Source::Arrays(scene, _) => &scene.views,
        }
    }
}

/// The reconstruction with the network and the device, if given.
pub fn run_on(
    mut reconstruction: Reconstruction,
    weights: Option<PathBuf>,
    device: Option<String>,
) -> Reconstruction {
    if let Some(weights) = weights {
        reconstruction = reconstruction.weights(weights);
    }
    if let Some(device) = device {
        reconstruction = reconstruction.device(device);
    }
    reconstruction
}
