//! Depth maps on disk with their cameras and photographs, as fusion and export read them.

mod layout;
mod reading;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use vamvs_core::view_selection;
use vamvs_core::{Camera, CloudPoint, Grid, Lens, Pinhole, Pose, Scene, Source, SparsePoint, View};
use vamvs_fusion::MapSource;
use vamvs_io::Loaded;
use vamvs_io::masks::Masks;
use vamvs_io::ply::Coordinates;

use crate::event::{OnEvent, tell, warn};
use crate::export::for_all_views;
use crate::output::{ConfidenceKind, LeftOut, Record, names};
use crate::{Event, MemoryLimit, OutputFolder, VamvsError};
use layout::Layout;

pub(crate) use layout::map_files;

/// Memory for each pixel of a view whose files are checked: its photograph, decoded, and its mask.
const CHECKED_BYTES_PER_PIXEL: u64 = 24;

/// The largest step from one `float` to the next in a cloud's coordinates, in pixels on the surface.
const COARSEST_STEP: f64 = 0.1;

/// Depth maps of the views of a scene.
#[derive(Debug)]
pub struct Maps {
    root: PathBuf,
    /// The output folder, if vamvs wrote it.
    own: Option<OutputFolder>,
    scene: Scene,
    cameras: Vec<Pinhole>,
    names: Vec<String>,
    files: Vec<MapFiles>,
    masks: Masks,
    /// The depth of one grey level of a PNG, if it was given.
    png_step: Option<f64>,
    left_out: Vec<LeftOut>,
    /// The views' places among all views of the folder's scene, and the number of these.
    places: (Vec<usize>, usize),
}

/// The files of one view.
#[derive(Clone, Debug, PartialEq, Eq)]
struct MapFiles {
    image: PathBuf,
    depth: PathBuf,
    confidence: Option<PathBuf>,
    coarse_confidence: Option<PathBuf>,
    normals: Option<PathBuf>,
    sigma: Option<PathBuf>,
}

impl MapFiles {
    /// Whether the depth map is in COLMAP's format.
    fn is_of_colmap(&self) -> bool {
        self.depth.extension().is_some_and(|extension| extension == "bin")
    }
}

impl Maps {
    /// Opens the depth maps in a folder with one of three layouts:
    ///
    /// - as `vamvs depth` writes them, `depths/`, `cams/`, `images/`, `confidence/`, and perhaps `normals/`, unit
    ///   normals in the world's frame;
    /// - a dense workspace of COLMAP, `stereo/depth_maps/`, `sparse/`, `images/`: the geometric maps, or the
    ///   photometric ones where there are no others;
    /// - as networks like MVSNet write them, `depth_est/`, `depths/` or `depth/`, `cams/`, `images/`, and perhaps
    ///   `confidence/`.
    ///
    /// `path` is this folder, or its folder of depth maps. Without confidence maps every depth has
    /// confidence 1. `masks` are those of the folder's own, undistorted images.
    ///
    /// # Errors
    /// If the folder is none of these, a file is missing or malformed, images are distorted, or there are
    /// fewer than two depth maps.
    pub fn open(path: &Path, masks: Masks, on_event: &mut OnEvent<'_>) -> Result<Self, VamvsError> {
        Self::opened(&Layout::of(path, None)?, None, masks, on_event)
    }

    /// As [`Maps::open`], for a folder that may lack cameras or photographs: `scene` has them then. Depth maps are those
    /// with the views' names, in `depth_est/`, `depths/`, `depth/` or the folder itself, as PFM, NPY, EXR, or 16-bit PNG,
    /// of which `png_step` is the depth of one grey level, scene units; without it `png-step.txt` beside them says it.
    ///
    /// # Errors
    /// As [`Maps::open`].
    pub fn open_with(
        path: &Path,
        scene: &Loaded,
        png_step: Option<f64>,
        masks: Masks,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Self, VamvsError> {
        let maps = Self::opened(&Layout::of(path, Some(scene))?, Some(scene), masks, on_event)?;
        Ok(Self { png_step, ..maps })
    }

    fn opened(
        layout: &Layout,
        given: Option<&Loaded>,
        masks: Masks,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Self, VamvsError> {
        let loaded = layout.read_scene()?;
        warn(on_event, loaded.warnings)?;
        let own_images = layout.root().join("images");
        let images = given.map(|given| given.images.clone()).filter(|_| !own_images.is_dir());
        let files: Vec<Option<MapFiles>> =
            layout.files(&loaded.scene.views, images.as_deref().unwrap_or(&own_images));
        let kept: Vec<usize> = (0..files.len()).filter(|&view| files[view].is_some()).collect();
        let scene = only(&loaded.scene, &kept);
        let all = files.len();
        let missing = (0..all).find(|&view| files[view].is_none()).map(|view| &loaded.scene.views[view]);
        let sought = missing.map(|view| layout.sought(view)).unwrap_or_default();
        expect_two(kept.len(), &layout.depths(), &sought)?;
        if missing.is_some() {
            let count = all - kept.len();
            let text = format!("{count} view(s) have a camera but no depth map and are left out: {sought}");
            tell(on_event, Event::Warning(text))?;
        }
        let camera = |view: &View| pinhole(&view.camera, layout.root());
        Ok(Self {
            own: layout.own().cloned(),
            root: layout.root().to_owned(),
            cameras: scene.views.iter().map(camera).collect::<Result<_, _>>()?,
            names: names(&scene.views),
            files: files.into_iter().flatten().collect(),
            scene,
            masks,
            png_step: None,
            left_out: Vec::new(),
            places: (kept, all),
        })
    }

    /// Reads all depth maps, and leaves out with a warning those that cannot be read or whose files
    /// differ in size.
    ///
    /// # Errors
    /// If fewer than two remain.
    pub fn readable(mut self, limit: MemoryLimit, on_event: &mut OnEvent<'_>) -> Result<Self, VamvsError> {
        let problem = |view: usize| Ok(self.checked(view).err().map(|error| error.with_causes()));
        let at_once = self.at_once(limit, CHECKED_BYTES_PER_PIXEL);
        let problems = for_all_views(self.len(), at_once, problem, &mut |_| Ok(()))?;
        let kept: Vec<usize> = (0..self.len()).filter(|&view| problems[view].is_none()).collect();
        let names = self.names.iter().cloned().zip(problems);
        let left_out: Vec<LeftOut> =
            names.filter_map(|(view, problem)| Some(LeftOut { view, reason: problem? })).collect();
        left_out.iter().try_for_each(|view| tell(on_event, Event::left_out(view)))?;
        expect_two(kept.len(), &self.root, "")?;
        self.scene = only(&self.scene, &kept);
        self.cameras = kept.iter().map(|&view| self.cameras[view]).collect();
        self.names = kept.iter().map(|&view| self.names[view].clone()).collect();
        self.files = kept.iter().map(|&view| self.files[view].clone()).collect();
        self.places.0 = kept.iter().map(|&view| self.places.0[view]).collect();
        Ok(Self { left_out, ..self })
    }

    /// How many views may be worked on at once that take so many bytes for each pixel: as many as there are threads, or as
    /// fit into the memory, but at least one.
    pub(crate) fn at_once(&self, limit: MemoryLimit, bytes_per_pixel: u64) -> usize {
        let largest = self.cameras.iter().map(|camera| camera.size.area()).max().unwrap_or(1);
        let fitting = limit.remaining() / (bytes_per_pixel * largest.max(1) as u64);
        usize::try_from(fitting).unwrap_or(usize::MAX).clamp(1, rayon::current_num_threads())
    }

    /// A view's place among all views of the folder's scene, with those that have no depth map.
    pub(crate) fn place_in_scene(&self, view: usize) -> usize {
        self.places.0[view]
    }

    /// The number of views of the folder's scene, with those that have no depth map.
    pub(crate) fn views_of_scene(&self) -> usize {
        self.places.1
    }

    /// The views that [`Maps::readable`] left out.
    #[must_use]
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// Whether `path` holds depth maps in one of the layouts.
    #[must_use]
    pub fn are_at(path: &Path) -> bool {
        Layout::of(path, None).is_ok()
    }

    /// The folder that holds the depth maps, cameras and photographs.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where a cloud of these depth maps goes: `fused.ply`, or `vamvs.ply` beside what other programs made.
    #[must_use]
    pub fn default_cloud(&self) -> PathBuf {
        self.root.join(if self.own.is_some() { "fused.ply" } else { "vamvs.ply" })
    }

    /// The views with their cameras, and the pairs and sparse points that the folder has.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The views' names, as [`names`] makes them.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// A view's camera at the size of its image.
    #[must_use]
    pub fn camera(&self, view: usize) -> &Pinhole {
        &self.cameras[view]
    }

    /// The record of a view's depth map, if vamvs wrote one.
    #[must_use]
    pub fn record(&self, view: usize) -> Option<Record> {
        self.own.as_ref()?.saved(&self.names[view])
    }

    /// The predicted visibility of a view's pixels in each of its source views, with their names; empty if it was not
    /// written.
    pub(crate) fn visibility(
        &self,
        view: usize,
        record: Option<&Record>,
    ) -> Result<Vec<(Grid<f32>, String)>, VamvsError> {
        let file =
            self.own.as_ref().map(|own| own.visibility(&self.names[view])).filter(|file| file.is_file());
        let (Some(file), Some(record)) = (file, record) else { return Ok(Vec::new()) };
        let tiles = vamvs_io::visibility::read_predicted(&file, record.sources.len())?;
        Ok(tiles.into_iter().zip(record.sources.iter().cloned()).collect())
    }

    /// The value of the confidence maps where the network's probability is `probability`. Confidence maps without a
    /// record are taken as probabilities, as other networks write them.
    ///
    /// # Errors
    /// If depth maps are refined, so that the network's probability is unknown, or their calibrations differ.
    pub fn confidence_at(&self, probability: f32) -> Result<f32, VamvsError> {
        let mut least = None;
        for (view, name) in self.names.iter().enumerate() {
            let value = match self.record(view).map(|record| record.confidence) {
                Some(ConfidenceKind::Calibrated(map)) => map.at(f64::from(probability)) as f32,
                Some(ConfidenceKind::Probability) | None => probability,
                Some(kind @ (ConfidenceKind::Refined | ConfidenceKind::Unknown)) => {
                    let why =
                        if kind == ConfidenceKind::Refined { "is refined" } else { "has an older record" };
                    return Err(self.without_probability(&format!("the depth map of {name} {why}")));
                }
            };
            if *least.get_or_insert(value) != value {
                return Err(
                    self.without_probability(&format!("{name} has another calibration than the first"))
                );
            }
        }
        Ok(least.unwrap_or(probability))
    }

    fn without_probability(&self, why: &str) -> VamvsError {
        let problem = format!(
            "thresholds on the network's probability (--preset dtu) need depth maps with a known one, but {why}: make \
             all depth maps anew with one network and --no-refine, or give thresholds without the preset"
        );
        VamvsError::Folder { path: self.root.clone(), problem }
    }

    /// A view's pose, `cam_from_world`.
    #[must_use]
    pub fn pose(&self, view: usize) -> &Pose {
        &self.scene.views[view].cam_from_world
    }

    /// For each view, its source views in the folder's files, best first; `None` if there are none.
    #[must_use]
    pub fn pairs(&self) -> Option<&[Vec<Source>]> {
        self.scene.pairs.as_deref()
    }

    /// For each view, others that see the same surfaces, best first: at most `count` or, with
    /// several maps of a photograph (`--fovea`), about the maps of `count` photographs.
    #[must_use]
    pub fn neighbours(&self, count: usize) -> Vec<Vec<usize>> {
        let all: Vec<usize> = (0..self.len()).collect();
        let maps = self.len().div_ceil(self.camera_centre_count(&all).max(1));
        let views = |sources: Vec<Source>| sources.iter().map(|source| source.view).collect();
        view_selection::select(&self.scene, &self.cameras, count * maps).into_iter().map(views).collect()
    }

    /// The number of camera centres of these views: maps of one photograph (`--fovea`) share one.
    pub(crate) fn camera_centre_count(&self, views: &[usize]) -> usize {
        let bits = |&view: &usize| -> [u64; 3] {
            let centre: [f64; 3] = self.pose(view).centre().into();
            centre.map(f64::to_bits)
        };
        views.iter().map(bits).collect::<HashSet<_>>().len()
    }

    /// The files of a view: depth, confidence, normals, photograph and mask, those that there are.
    pub(crate) fn files(&self, view: usize) -> impl Iterator<Item = PathBuf> {
        let MapFiles { image, depth, confidence, coarse_confidence, normals, sigma } = &self.files[view];
        let optional = [confidence, coarse_confidence, normals, sigma].into_iter().flatten();
        [depth, image].into_iter().chain(optional).cloned().chain(self.mask_file(view))
    }

    /// The mask of a view, if it has one.
    pub(crate) fn mask_file(&self, view: usize) -> Option<PathBuf> {
        self.masks.find(&self.scene.views[view].name)
    }

    /// The file of a view's depth map.
    #[must_use]
    pub fn depth_file(&self, view: usize) -> &Path {
        &self.files[view].depth
    }

    /// The precision of coordinates in PLY files: double if the cameras stand far from the origin
    /// compared with their distances, or with the size of a pixel on the nearest surfaces.
    #[must_use]
    pub fn coordinates(&self) -> Coordinates {
        if are_pixels_lost_in_floats(&self.scene.views) {
            return Coordinates::Double;
        }
        let at_camera = |view: &View| CloudPoint {
            x_in_world: view.cam_from_world.centre().into(),
            normal: [0.0; 3],
            colour: [0; 3],
            confidence: 0.0,
            sigma: 0.0,
            views: 0,
        };
        Coordinates::for_points(&self.scene.views.iter().map(at_camera).collect::<Vec<_>>())
    }
}

/// Refuses fewer than two depth maps; `sought` says what was expected for one that is missing.
fn expect_two(count: usize, path: &Path, sought: &str) -> Result<(), VamvsError> {
    if count >= 2 {
        return Ok(());
    }
    let sought = if sought.is_empty() { String::new() } else { format!(": {sought}") };
    let problem =
        format!("expected depth maps of at least 2 of the views that can be read, found {count}{sought}");
    Err(VamvsError::Folder { path: path.to_owned(), problem })
}

fn pinhole(camera: &Camera, path: &Path) -> Result<Pinhole, VamvsError> {
    match camera.lens {
        Lens::None => Ok(Pinhole { size: camera.size, intrinsics: camera.intrinsics }),
        _ => Err(VamvsError::Folder {
            path: path.to_owned(),
            problem: "expected undistorted images with cameras without distortion, found distorted ones: depth maps have \
                      the cameras of the photographs that they were made of"
                .to_owned(),
        }),
    }
}

/// The scene with only these views.
fn only(scene: &Scene, kept: &[usize]) -> Scene {
    let place = |view: &usize| kept.binary_search(view).ok();
    let source = |&Source { view, score }: &Source| Some(Source { view: place(&view)?, score });
    let pairs = |pairs: &Vec<Vec<Source>>| {
        kept.iter().map(|&view| pairs[view].iter().filter_map(source).collect()).collect()
    };
    let point = |point: &SparsePoint| {
        let views: Vec<usize> = point.views.iter().filter_map(place).collect();
        (!views.is_empty()).then_some(SparsePoint { x_in_world: point.x_in_world, views })
    };
    Scene {
        views: kept.iter().map(|&view| scene.views[view].clone()).collect(),
        points: scene.points.iter().filter_map(point).collect(),
        pairs: scene.pairs.as_ref().map(pairs),
    }
}

/// Whether floats of the cameras' coordinates are too coarse for the pixels of a view whose depth range is known.
fn are_pixels_lost_in_floats(views: &[View]) -> bool {
    let largest = views.iter().map(|view| view.cam_from_world.centre().amax()).fold(0.0, f64::max);
    let step = f64::from(f32::EPSILON) * largest;
    let pixel = |view: &View| Some(view.depth_range?.near / view.camera.intrinsics.fx);
    views.iter().filter_map(pixel).any(|pixel| step > COARSEST_STEP * pixel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use vamvs_core::{DepthRange, Intrinsics, Size};

    #[test]
    fn floats_are_too_coarse_for_a_long_survey_and_its_small_pixels() {
        let views = |metres: f64, near: f64| {
            let view = |x: f64| View {
                id: 0,
                name: String::new(),
                camera: Camera {
                    size: Size::new(4000, 3000),
                    intrinsics: Intrinsics { fx: 4000.0, fy: 4000.0, cx: 2000.0, cy: 1500.0 },
                    lens: Lens::None,
                },
                cam_from_world: Pose { translation: Vector3::new(-x, 0.0, 0.0), ..Pose::identity() },
                depth_range: Some(DepthRange { near, far: 2.0 * near }),
            };
            [view(0.0), view(metres)]
        };
        // A float at 500 km has a step of 3 to 6 cm; a pixel at 100 m is 2.5 cm wide.
        assert!(are_pixels_lost_in_floats(&views(500_000.0, 100.0)));
        assert!(!are_pixels_lost_in_floats(&views(1000.0, 100.0)));
        assert!(are_pixels_lost_in_floats(&views(1000.0, 0.2)));
    }
}
