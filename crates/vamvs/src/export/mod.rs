//! The cloud and, on request, files for other programs: a dense workspace of COLMAP, a scene of
//! OpenMVS, depth maps in other formats. All of it goes next to the cloud.

mod colmap;
mod depths;
mod openmvs;
mod thinned;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vamvs_core::Pinhole;
use vamvs_fusion::{FuseOptions, FusedPoints, FusionView, MapSource, Surface};
use vamvs_io::ply::PlyWriter;

use crate::event::{OnEvent, tell};
use crate::output::{Lock, claim, is_claimed};
use crate::output::{folder_of, remove_unfinished};
use crate::{Event, FusionOptions, Maps, VamvsError};
use colmap::ColmapWorkspace;
use depths::DepthFolder;
use openmvs::OpenmvsScene;
use thinned::Thinned;

/// Memory for each pixel of a view that is exported: its maps and photograph, and copies in the formats of the exports.
const BYTES_PER_PIXEL: u64 = 100;

/// What is written next to the cloud.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct ExportOptions {
    /// Programs to export for, each into a folder of its name.
    pub programs: Vec<ExportTarget>,
    /// Depth maps in `depths/`, in these formats.
    pub depth_formats: Vec<DepthFormat>,
    /// Depth of one grey level of a PNG, scene units; by default a round number with which all depths up to 50 times the
    /// median fit.
    pub png_step: Option<f64>,
}

/// A program that works on depth maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[non_exhaustive]
pub enum ExportTarget {
    /// `colmap/`: a dense workspace, with the cloud and the views of its points.
    Colmap,
    /// `openmvs/`: `scene.mvs`, `depthNNNN.dmap`, and `scene_dense.ply` with the views of its points.
    Openmvs,
}

impl ExportTarget {
    /// The folder next to the cloud that is written for it.
    #[must_use]
    pub fn folder(self) -> &'static str {
        match self {
            Self::Colmap => "colmap",
            Self::Openmvs => "openmvs",
        }
    }
}

/// A format of depth maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[non_exhaustive]
pub enum DepthFormat {
    /// 32 bits, rows from bottom to top.
    Pfm,
    /// 16-bit grey, in steps of the depth in `png-step.txt`; 0 for no depth.
    Png,
    /// OpenEXR, 32 bits, channel Z.
    Exr,
    /// NumPy, 32 bits, shape (height, width).
    Npy,
}

/// Writes the cloud and its exports.
pub(crate) struct Exporter<'a> {
    cloud: &'a Path,
    ply: PlyWriter,
    thinned: Thinned,
    exports: Exports<'a>,
    options: &'a ExportOptions,
}

/// The exports next to the cloud.
struct Exports<'a> {
    maps: &'a Maps,
    colmap: Option<ColmapWorkspace>,
    openmvs: Option<OpenmvsScene>,
    depths: DepthFolder,
    /// Of the programs' folders.
    _locks: Vec<Lock>,
}

impl<'a> Exporter<'a> {
    pub fn begin(maps: &'a Maps, cloud: &'a Path, options: &'a ExportOptions) -> Result<Self, VamvsError> {
        let exports = Exports::begin(maps, folder_of(cloud), options)?;
        let ply = PlyWriter::create(cloud, maps.coordinates())?;
        Ok(Self { cloud, ply, thinned: Thinned::default(), exports, options })
    }

    pub fn push(&mut self, fused: &FusedPoints) -> Result<(), VamvsError> {
        for (point, views) in fused.iter() {
            self.ply.push(point)?;
            if let Some(colmap) = &mut self.exports.colmap {
                colmap.push(views)?;
            }
            if let Some(openmvs) = &mut self.exports.openmvs {
                openmvs.push(point, views)?;
            }
            if self.exports.colmap.is_some() || self.exports.openmvs.is_some() {
                self.thinned.push(point, views);
            }
        }
        Ok(())
    }

    /// Completes the cloud, then writes the exports. `neighbours` are those of each view, best
    /// first.
    pub fn finish(
        self,
        neighbours: &[Vec<usize>],
        options: &FusionOptions,
        on_event: &mut OnEvent<'_>,
    ) -> Result<(), VamvsError> {
        self.ply.finish()?;
        self.options.warn_of_older(folder_of(self.cloud), on_event)?;
        let Exports { maps, .. } = self.exports;
        let cameras = self.exports.write_views(neighbours, options, on_event)?;
        let points = self.thinned.into_points();
        if let Some(colmap) = self.exports.colmap {
            colmap.finish(maps, &cameras, &points, self.cloud)?;
        }
        let Some(openmvs) = self.exports.openmvs else { return Ok(()) };
        if let Some(note) = openmvs.note() {
            tell(on_event, Event::Warning(note))?;
        }
        openmvs.finish(maps, &cameras, &points)
    }
}

impl ExportOptions {
    /// Warns of exports in the folder of the cloud that are not written again and so remain those of another cloud.
    fn warn_of_older(&self, folder: &Path, on_event: &mut OnEvent<'_>) -> Result<(), VamvsError> {
        for program in [ExportTarget::Colmap, ExportTarget::Openmvs] {
            let older = folder.join(program.folder());
            if is_claimed(&older) && !self.programs.contains(&program) {
                let (path, name) = (older.display(), program.folder());
                let text = format!("{path} is of an earlier cloud; --export {name} writes it again");
                tell(on_event, Event::Warning(text))?;
            }
        }
        Ok(())
    }

    /// Checks the values.
    ///
    /// # Errors
    /// If one is out of its range.
    pub fn validate(&self) -> Result<(), VamvsError> {
        match self.png_step.filter(|step| !(step.is_finite() && *step > 0.0)) {
            None => Ok(()),
            Some(step) => {
                Err(VamvsError::Request(format!("png-step must be a depth above 0, got {step} (--png-step)")))
            }
        }
    }

    /// Refuses to export over inputs: `inputs` are the folders that are read, `folder` is that of
    /// the cloud.
    ///
    /// # Errors
    /// If one of them is in a folder that an export would write.
    pub fn expect_apart<'a>(
        &self,
        folder: &Path,
        inputs: impl IntoIterator<Item = &'a Path>,
    ) -> Result<(), VamvsError> {
        let inputs: Vec<PathBuf> = inputs.into_iter().filter_map(|input| input.canonicalize().ok()).collect();
        for program in &self.programs {
            let target = folder.join(program.folder());
            let Ok(whole) = target.canonicalize() else { continue };
            if let Some(input) = inputs.iter().find(|input| input.starts_with(&whole)) {
                let problem = format!(
                    "the export would overwrite {}, which is an input: choose another --out",
                    input.display()
                );
                return Err(VamvsError::Folder { path: target, problem });
            }
        }
        Ok(())
    }
}

impl<'a> Exports<'a> {
    fn begin(maps: &'a Maps, folder: &Path, options: &ExportOptions) -> Result<Self, VamvsError> {
        options.expect_apart(folder, [maps.root()])?;
        let depths = DepthFolder::new(maps, folder, options)?;
        let begin = |program: ExportTarget| {
            let target = folder.join(program.folder());
            let entries = target.read_dir().into_iter().flatten().flatten().map(|entry| entry.path());
            claim(&target, entries)?;
            let lock = Lock::alone(&target)?;
            remove_all_unfinished(&target)?;
            Ok(lock)
        };
        let all = [ExportTarget::Colmap, ExportTarget::Openmvs];
        let asked = all.into_iter().filter(|program| options.programs.contains(program));
        let locks = asked.map(begin).collect::<Result<_, VamvsError>>()?;
        let wanted = |program: ExportTarget| {
            options.programs.contains(&program).then(|| folder.join(program.folder()))
        };
        let colmap = wanted(ExportTarget::Colmap).map(|folder| ColmapWorkspace::begin(maps, &folder));
        let openmvs = wanted(ExportTarget::Openmvs).map(|folder| OpenmvsScene::begin(maps, &folder));
        Ok(Self { maps, colmap: colmap.transpose()?, openmvs: openmvs.transpose()?, depths, _locks: locks })
    }

    /// Writes the exports of single views, if there are any; returns the cameras of their depth
    /// maps.
    fn write_views(
        &self,
        neighbours: &[Vec<usize>],
        options: &FusionOptions,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Vec<Pinhole>, VamvsError> {
        if self.colmap.is_none() && self.openmvs.is_none() && !self.depths.is_wanted() {
            return Ok(Vec::new());
        }
        let png_step = self.depths.png_step(self.maps)?;
        let write = |view: usize| {
            let loaded = self.maps.load(view)?;
            let view = ExportedView::new(view, &self.maps.names()[view], &loaded, &options.filter)?;
            let left_out = self.depths.write_view(&view, self.maps.depth_file(view.number), png_step)?;
            self.write_for_programs(&view, &neighbours[view.number])?;
            Ok((loaded.map.camera, left_out))
        };
        let total = self.maps.len();
        let at_once = self.maps.at_once(options.max_memory, BYTES_PER_PIXEL);
        let mut progress = |done| tell(on_event, Event::Export { done, total });
        let (cameras, left_out): (_, Vec<usize>) =
            for_all_views(total, at_once, write, &mut progress)?.into_iter().unzip();
        let left_out: usize = left_out.iter().sum();
        if left_out > 0 {
            let text = format!(
                "{left_out} depths, very much nearer or farther than most, are left out of the PNGs, whose step is {png_step} (--png-step)"
            );
            tell(on_event, Event::Warning(text))?;
        }
        Ok(cameras)
    }

    fn write_for_programs(&self, view: &ExportedView, neighbours: &[usize]) -> Result<(), VamvsError> {
        if let Some(colmap) = &self.colmap {
            colmap.write_view(view)?;
        }
        self.openmvs.as_ref().map_or(Ok(()), |openmvs| openmvs.write_view(view, neighbours))
    }
}

/// Removes the unfinished files of a killed run from a folder and the folders in it.
fn remove_all_unfinished(folder: &Path) -> Result<(), VamvsError> {
    remove_unfinished(folder)?;
    let mut entries = folder.read_dir().into_iter().flatten().flatten();
    entries.try_for_each(|entry| {
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        if is_folder { remove_all_unfinished(&entry.path()) } else { Ok(()) }
    })
}

/// A view as it is exported.
struct ExportedView<'a> {
    number: usize,
    name: &'a str,
    loaded: &'a FusionView,
    /// All unmasked depths.
    all: Surface,
    /// The confident depths.
    confident: Surface,
}

impl<'a> ExportedView<'a> {
    fn new(
        number: usize,
        name: &'a str,
        loaded: &'a FusionView,
        filter: &FuseOptions,
    ) -> Result<Self, VamvsError> {
        let mut none = filter.clone();
        (none.min_confidence, none.min_coarse_confidence) = (0.0, 0.0);
        let (all, confident) = (Surface::of(loaded, &none)?, Surface::of(loaded, filter)?);
        Ok(Self { number, name, loaded, all, confident })
    }
}

/// Runs `work` for all views, `at_once` at a time; `on_done` receives the number of finished views.
pub(crate) fn for_all_views<T: Send>(
    count: usize,
    at_once: usize,
    work: impl Fn(usize) -> Result<T, VamvsError> + Sync,
    on_done: &mut dyn FnMut(usize) -> Result<(), VamvsError>,
) -> Result<Vec<T>, VamvsError> {
    let mut results = Vec::with_capacity(count);
    let views: Vec<usize> = (0..count).collect();
    for batch in views.chunks(at_once) {
        let done: Result<Vec<T>, VamvsError> = batch.par_iter().map(|&view| work(view)).collect();
        results.extend(done?);
        on_done(results.len())?;
    }
    Ok(results)
}
