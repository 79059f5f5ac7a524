//! The cloud, and on request what other programs work on: a dense workspace of COLMAP, a scene of OpenMVS,
//! depth maps in other formats. All of it goes beside the cloud.

mod colmap;
mod depths;
mod openmvs;
mod thinned;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vamvs_fusion::{FuseOptions, FusedPoints, FusionView, MapSource, Surface};
use vamvs_io::IoError;
use vamvs_io::ply::PlyWriter;

use crate::{Event, Maps, VamvsError};
use colmap::ColmapWorkspace;
use depths::DepthFolder;
use openmvs::OpenmvsScene;
use thinned::Thinned;

/// What is written beside the cloud.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ExportOptions {
    /// For which programs, each in a folder of its name.
    pub programs: Vec<Program>,
    /// Depth maps in `depths/`, in these formats.
    pub depth_formats: Vec<DepthFormat>,
    /// Depth of one step of a PNG, scene units; by default a round number in which all depths fit.
    pub png_step: Option<f64>,
}

/// A program that works on depth maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Program {
    /// `colmap/`: a dense workspace, with the cloud and the views of its points.
    Colmap,
    /// `openmvs/`: `scene.mvs`, `depthNNNN.dmap`, and `scene_dense.ply` with the views of its points.
    Openmvs,
}

/// A format of depth maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthFormat {
    /// 32 bits, rows from bottom to top.
    Pfm,
    /// 16-bit grey, so many steps of a depth that `png-step.txt` tells; 0 for none.
    Png,
    /// OpenEXR, 32 bits, channel Z.
    Exr,
    /// NumPy, 32 bits, shape (height, width).
    Npy,
}

/// Writes the cloud and what goes with it.
pub(crate) struct Exporter<'a> {
    maps: &'a Maps,
    cloud: &'a Path,
    ply: PlyWriter,
    thinned: Thinned,
    colmap: Option<ColmapWorkspace>,
    openmvs: Option<OpenmvsScene>,
    depths: DepthFolder,
}

impl<'a> Exporter<'a> {
    pub fn begin(maps: &'a Maps, cloud: &'a Path, options: &ExportOptions) -> Result<Self, VamvsError> {
        let folder = cloud.parent().unwrap_or(Path::new(""));
        let wanted = |program| options.programs.contains(&program);
        let colmap = wanted(Program::Colmap).then(|| ColmapWorkspace::begin(maps, &folder.join("colmap")));
        let openmvs = wanted(Program::Openmvs).then(|| OpenmvsScene::begin(maps, &folder.join("openmvs")));
        Ok(Self {
            maps,
            cloud,
            ply: PlyWriter::create(cloud, maps.coordinates())?,
            thinned: Thinned::default(),
            colmap: colmap.transpose()?,
            openmvs: openmvs.transpose()?,
            depths: DepthFolder::new(&folder.join("depths"), options)?,
        })
    }

    pub fn push(&mut self, fused: &FusedPoints) -> Result<(), VamvsError> {
        for (point, views) in fused.iter() {
            self.ply.push(point)?;
            if let Some(colmap) = &mut self.colmap {
                colmap.push(views)?;
            }
            if let Some(openmvs) = &mut self.openmvs {
                openmvs.push(point, views)?;
            }
            if self.colmap.is_some() || self.openmvs.is_some() {
                self.thinned.push(point, views);
            }
        }
        Ok(())
    }

    /// Completes the cloud, then writes everything else.
    pub fn finish(
        self,
        neighbours: &[Vec<usize>],
        filter: &FuseOptions,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<(), VamvsError> {
        self.ply.finish()?;
        let writes_maps = self.colmap.is_some() || self.openmvs.is_some() || self.depths.is_wanted();
        if !writes_maps {
            return Ok(());
        }
        let png_step = self.depths.png_step(self.maps)?;
        let write = |view: usize| -> Result<vamvs_core::Pinhole, VamvsError> {
            let loaded = self.maps.load(view)?;
            let exported = ExportedView::new(view, &self.maps.names()[view], &loaded, filter)?;
            self.depths.write_view(&exported, self.maps.depth_file(view), png_step)?;
            if let Some(colmap) = &self.colmap {
                colmap.write_view(&exported)?;
            }
            if let Some(openmvs) = &self.openmvs {
                openmvs.write_view(&exported, &neighbours[view])?;
            }
            Ok(loaded.map.camera)
        };
        let cameras = for_all_views(self.maps.len(), write, on_event)?;
        let points = self.thinned.into_points();
        if let Some(colmap) = self.colmap {
            colmap.finish(self.maps, &cameras, &points, self.cloud)?;
        }
        self.openmvs.map_or(Ok(()), |openmvs| openmvs.finish(self.maps, &cameras, &points))
    }
}

/// A view as it is exported.
struct ExportedView<'a> {
    number: usize,
    name: &'a str,
    loaded: &'a FusionView,
    /// All that is there.
    all: Surface,
    /// What is confident.
    confident: Surface,
}

impl<'a> ExportedView<'a> {
    fn new(
        number: usize,
        name: &'a str,
        loaded: &'a FusionView,
        filter: &FuseOptions,
    ) -> Result<Self, VamvsError> {
        let none = FuseOptions { min_confidence: 0.0, min_coarse_confidence: 0.0, ..filter.clone() };
        let (all, confident) = (Surface::of(loaded, &none)?, Surface::of(loaded, filter)?);
        Ok(Self { number, name, loaded, all, confident })
    }
}

/// Runs `work` for all views, as many at a time as there are threads.
fn for_all_views<T: Send>(
    count: usize,
    work: impl Fn(usize) -> Result<T, VamvsError> + Sync,
    on_event: &mut dyn FnMut(Event),
) -> Result<Vec<T>, VamvsError> {
    let mut results = Vec::with_capacity(count);
    let views: Vec<usize> = (0..count).collect();
    for batch in views.chunks(rayon::current_num_threads()) {
        let done: Result<Vec<T>, VamvsError> = batch.par_iter().map(|&view| work(view)).collect();
        results.extend(done?);
        on_event(Event::Export { done: results.len(), total: count });
    }
    Ok(results)
}

/// Makes a folder and those above it.
fn make_folder(path: &Path) -> Result<PathBuf, VamvsError> {
    let failed = |source| IoError::System { action: "make the folder", path: path.to_owned(), source };
    std::fs::create_dir_all(path).map_err(failed)?;
    Ok(path.to_owned())
}
