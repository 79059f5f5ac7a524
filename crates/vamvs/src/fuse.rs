//! From an output folder of depth maps to one cloud.

use std::path::Path;

use vamvs_core::view_selection;
use vamvs_core::{Pinhole, Scene, Size};
use vamvs_fusion::{FuseEvent, FuseJob, FuseReport, FusionView, MapSource, ViewReport};
use vamvs_io::ply::{Coordinates, PlyWriter};
use vamvs_io::{image, masks, mvsnet};

use crate::output::names;
use crate::{Event, FusionOptions, OutputFolder, VamvsError};

/// What came out of a fusion.
#[derive(Clone, Debug)]
pub struct FuseSummary {
    /// Points written.
    pub points: u64,
    /// The views' names with what became of their pixels.
    pub views: Vec<(String, ViewReport)>,
}

impl FuseSummary {
    /// What became of all pixels.
    #[must_use]
    pub fn total(&self) -> ViewReport {
        FuseReport { views: self.views.iter().map(|(_, report)| *report).collect() }.total()
    }
}

/// Fuses the depth maps of `folder` into the PLY file `cloud`. Pixels that a mask in `masks` ignores
/// give no point; these are masks of the folder's own, undistorted images.
///
/// # Errors
/// If files are missing or malformed or the cloud cannot be written; then there is no new cloud and an
/// old one is untouched.
pub fn fuse(
    folder: &OutputFolder,
    cloud: &Path,
    masks: Option<&Path>,
    options: &FusionOptions,
    on_event: &mut dyn FnMut(Event),
) -> Result<FuseSummary, VamvsError> {
    let maps = SavedMaps::open(folder, masks, on_event)?;
    let neighbours = view_selection::select(&maps.scene, &maps.cameras, options.neighbours);
    let job = FuseJob {
        source: &maps,
        neighbours: &neighbours,
        options: &options.filter,
        roi: options.roi,
        cache_bytes: options.map_cache_mib << 20,
    };
    let total = 2 * maps.names.len();
    let mut done = 0;
    let mut progress = |_: FuseEvent| {
        done += 1;
        on_event(Event::Fusion { done, total });
    };
    let mut writer = PlyWriter::create(cloud, maps.coordinates())?;
    let mut sink = |points: &[_]| Ok(points.iter().try_for_each(|point| writer.push(point))?);
    let report = vamvs_fusion::fuse(&job, &mut sink, &mut progress)?;
    let points = report.total().points;
    if points > 0 {
        writer.finish()?;
    }
    Ok(FuseSummary { points, views: maps.names.into_iter().zip(report.views).collect() })
}

/// The depth maps of an output folder.
struct SavedMaps {
    folder: OutputFolder,
    masks: Option<std::path::PathBuf>,
    scene: Scene,
    names: Vec<String>,
    cameras: Vec<Pinhole>,
}

impl SavedMaps {
    fn open(
        folder: &OutputFolder,
        masks: Option<&Path>,
        on_event: &mut dyn FnMut(Event),
    ) -> Result<Self, VamvsError> {
        let pairs = folder.pairs();
        let pairs = pairs.is_file().then_some(pairs.as_path());
        let options = mvsnet::Options::default();
        let loaded = mvsnet::read_scene(&folder.cams(), &folder.images(), pairs, &options)?;
        loaded.warnings.into_iter().for_each(|warning| on_event(Event::Warning(warning)));
        let (scene, missing) = with_depth(&loaded.scene, folder);
        if missing > 0 {
            on_event(Event::Warning(format!(
                "{missing} view(s) have a camera but no depth map and are left out"
            )));
        }
        if scene.views.len() < 2 {
            return Err(VamvsError::Folder {
                path: folder.root().join("depths"),
                problem: format!(
                    "expected depth maps of at least 2 of the views in cams/, found {}",
                    scene.views.len()
                ),
            });
        }
        let cameras = scene
            .views
            .iter()
            .map(|view| Pinhole { size: view.camera.size, intrinsics: view.camera.intrinsics });
        Ok(Self {
            folder: folder.clone(),
            masks: masks.map(Path::to_owned),
            cameras: cameras.collect(),
            names: names(&scene.views),
            scene,
        })
    }

    /// Doubles where the cameras stand far from the origin compared with their distances.
    fn coordinates(&self) -> Coordinates {
        let centre = |view: &vamvs_core::View| view.cam_from_world.centre().into();
        let as_points: Vec<_> = self
            .scene
            .views
            .iter()
            .map(|view| vamvs_core::CloudPoint {
                x_in_world: centre(view),
                normal: [0.0; 3],
                colour: [0; 3],
                confidence: 0.0,
                views: 0,
            })
            .collect();
        Coordinates::fitting(&as_points)
    }
}

/// The views that have a depth map, and how many have none.
fn with_depth(scene: &Scene, folder: &OutputFolder) -> (Scene, usize) {
    let names = names(&scene.views);
    let kept: Vec<usize> = (0..names.len()).filter(|&view| folder.depth(&names[view]).is_file()).collect();
    let place = |view: &usize| kept.binary_search(view).ok();
    let pairs = scene
        .pairs
        .as_ref()
        .map(|pairs| kept.iter().map(|&view| pairs[view].iter().filter_map(place).collect()).collect());
    let missing = names.len() - kept.len();
    let views = kept.iter().map(|&view| scene.views[view].clone()).collect();
    (Scene { views, points: Vec::new(), pairs }, missing)
}

impl MapSource for SavedMaps {
    type Error = VamvsError;

    fn len(&self) -> usize {
        self.names.len()
    }

    fn load(&self, view: usize) -> Result<FusionView, VamvsError> {
        let (name, scene_view) = (&self.names[view], &self.scene.views[view]);
        let map = self.folder.read(name, self.cameras[view], scene_view)?;
        let size = map.depth.size();
        let colour = image::load_rgb(&self.folder.images().join(&scene_view.name))?;
        let colour = if colour.size() == size { colour } else { image::resize(&colour, size) };
        Ok(FusionView { colour, mask: self.mask(scene_view, size)?, map })
    }
}

impl SavedMaps {
    fn mask(
        &self,
        view: &vamvs_core::View,
        size: Size,
    ) -> Result<Option<vamvs_core::Grid<bool>>, VamvsError> {
        let path = self.masks.as_deref().and_then(|folder| masks::find(folder, &view.name));
        Ok(path.map(|path| masks::load(&path, size)).transpose()?)
    }
}
