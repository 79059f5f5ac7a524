//! Files in, files out, as in `vamvs reconstruct`.

use std::path::{Path, PathBuf};

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use vamvs::io::mvsnet;
use vamvs::{Input, Reconstruction};

use crate::options::Options;
use crate::scene::{load, run_on};
use crate::work::Work;

/// What was done.
#[pyclass(frozen, get_all, module = "vamvs")]
pub struct Reconstructed {
    /// The cloud's file; no new one is written if no point passes the filters.
    cloud: PathBuf,
    points: u64,
    /// Depth maps made now.
    made: usize,
    /// Depth maps that were there already.
    resumed: usize,
    /// Views without depth map, with the reasons.
    left_out: Vec<(String, String)>,
}

/// Depth maps and one cloud in a folder.
#[pyfunction]
#[pyo3(signature = (
    images = None, *, out, colmap = None, cams = None, pairs = None, nerfstudio = None, bundler = None, nvm = None,
    openmvs = None, weights = None, device = None, force = false, on_event = None, **options
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments")]
pub fn reconstruct(
    py: Python<'_>,
    images: Option<PathBuf>,
    out: PathBuf,
    colmap: Option<PathBuf>,
    cams: Option<PathBuf>,
    pairs: Option<PathBuf>,
    nerfstudio: Option<PathBuf>,
    bundler: Option<PathBuf>,
    nvm: Option<PathBuf>,
    openmvs: Option<PathBuf>,
    weights: Option<PathBuf>,
    device: Option<String>,
    force: bool,
    on_event: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Reconstructed> {
    let mut options = Options::new(options)?;
    let quality = options.quality()?;
    let weights = weights.or(quality.map(|quality| quality.weights().into()));
    let (depth, mut fusion) = (options.depth(quality.unwrap_or_default())?, options.fusion()?);
    options.finish()?;
    if depth.fovea {
        // With a fovea, points outside of the box are wanted too.
        fusion.roi = None;
    }
    let input = match (colmap, cams, nerfstudio, bundler, nvm, openmvs) {
        (Some(model), None, None, None, None, None) => Input::Colmap { model, images },
        (None, Some(cams), None, None, None, None) => {
            let text = "cams= needs images=, the folder of photographs";
            let images = images.ok_or_else(|| PyTypeError::new_err(text))?;
            Input::Mvsnet { cams, images, pairs, options: mvsnet::Options::default() }
        }
        (None, None, Some(transforms), None, None, None) => Input::Nerfstudio { transforms, images },
        (None, None, None, Some(bundle), None, None) => Input::Bundler { bundle, images },
        (None, None, None, None, Some(nvm), None) => Input::Nvm { nvm, images },
        (None, None, None, None, None, Some(mvs)) => Input::Openmvs { mvs, images },
        _ => {
            let text = "expected exactly one of colmap, cams, nerfstudio, bundler, nvm and openmvs";
            return Err(PyTypeError::new_err(text));
        }
    };
    let reconstruction = Reconstruction::new(load(py, &input)?).depth(depth).fusion(fusion).force(force);
    let reconstruction = run_on(reconstruction, weights, device);
    let work = Work::begin(on_event, move |teller| {
        let done = reconstruction.run(Path::new(&out), &mut |event| teller.event(event))?;
        teller.item(done)
    });
    let Some(done) = work.next(py)? else {
        return Err(crate::Error::new_err("the work ended without a result"));
    };
    let skipped = done.depth.skipped.into_iter().chain(done.fusion.skipped);
    Ok(Reconstructed {
        cloud: done.cloud,
        points: done.fusion.points,
        made: done.depth.made,
        resumed: done.depth.resumed,
        left_out: skipped.map(|left_out| (left_out.view, left_out.reason)).collect(),
    })
}
