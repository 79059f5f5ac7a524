//! Compares the depth maps of a scene with ground truth, view by view.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;
use vamvs_core::{DepthMap, Grid, Rgb, Size, Visibility};
use vamvs_eval::depth::{MapPair, PlaneUnit, SizeMismatch};
use vamvs_eval::reliability::outcomes;
use vamvs_eval::{DepthErrors, DepthSamples, PixelMap, Region, Reliability, Threshold};
use vamvs_fusion::MapSource;
use vamvs_io::masks::Masks;
use vamvs_io::{depth, visibility};

use crate::event::{OnEvent, tell};
use crate::maps;
use crate::{Event, Maps, VamvsError};

/// Poses of the same camera differ by at most this: positions as a share of the median depth,
/// rotation matrices in the Frobenius norm (√2 times the angle in radians).
const SAME_POSE: f64 = 0.01;

/// Default thresholds of the relative error.
const RELATIVE: [f64; 4] = [0.002, 0.005, 0.01, 0.02];

/// Default thresholds in plane distances: those of the paper (section 4.1).
const PLANES: [f64; 2] = [1.0, 3.0];

/// Errors of a region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegionErrors {
    /// The region.
    pub region: Region,
    /// Its errors.
    #[serde(flatten)]
    pub errors: DepthErrors,
}

/// Errors of a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewErrors {
    /// Its name.
    pub view: String,
    /// By region: all pixels and, if visibility is known, invisible and visible ones.
    pub regions: Vec<RegionErrors>,
}

/// Errors of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneErrors {
    /// View by view.
    pub views: Vec<ViewErrors>,
    /// Over the pixels of all views.
    pub total: Vec<RegionErrors>,
    /// How often pixels of each confidence are right, that is, have an error of at most
    /// [`RIGHT_WITHIN`](vamvs_eval::reliability::RIGHT_WITHIN). Empty if there are no confidences.
    pub reliability: Reliability,
}

/// The depth maps of a scene and the true ones of the same views.
#[derive(Debug)]
pub struct DepthScene {
    prediction: Maps,
    ground_truth: Maps,
    views: Vec<View>,
}

/// A view that has both depth maps.
#[derive(Debug)]
struct View {
    /// Index into the prediction's maps.
    predicted: usize,
    /// Index into the true maps.
    true_map: usize,
    /// Source views, indices into the true maps.
    sources: Vec<usize>,
    plane: Option<PlaneUnit>,
}

/// A depth map and its ground truth, pixel by pixel.
#[derive(Clone, Debug)]
pub struct ComparedMap {
    /// The depth map.
    pub map: DepthMap,
    /// The ground truth at the centres of its pixels; 0 where there is none.
    pub ground_truth: Grid<f32>,
    /// For each pixel, whether all source views see its surface; `None` if visibility is not known.
    pub visible: Option<Grid<Option<bool>>>,
}

/// Thresholds that suit most scenes; those in plane distances only if the distances are known.
#[must_use]
pub fn default_thresholds(planes_known: bool) -> Vec<Threshold> {
    let planes = if planes_known { &PLANES[..] } else { &[] };
    RELATIVE
        .map(Threshold::Relative)
        .into_iter()
        .chain(planes.iter().copied().map(Threshold::Planes))
        .collect()
}

impl DepthScene {
    /// Pairs the depth maps in `prediction` with the true ones in `ground_truth` by the views'
    /// names. Both folders may have any layout of [`Maps`].
    ///
    /// The plane distance is `plane_distance` in scene units if given, else that in the records of
    /// `vamvs depth`. Source views are those of the records, else of the ground truth's `pair.txt`,
    /// else all others.
    ///
    /// # Errors
    /// If a folder has no depth maps, or they have no view in common.
    pub fn open(
        prediction: &Path,
        ground_truth: &Path,
        plane_distance: Option<f64>,
        on_event: &mut OnEvent<'_>,
    ) -> Result<Self, VamvsError> {
        let prediction = Maps::open(prediction, Masks::None, on_event)?;
        let ground_truth = Maps::open(ground_truth, Masks::None, on_event)?;
        let place = |name: &String| ground_truth.names().iter().position(|other| other == name);
        let view = |(predicted, name): (usize, &String)| {
            let true_map = place(name)?;
            let record = prediction.record(predicted);
            let planes = record.as_ref().and_then(|record| record.planes).map(PlaneUnit::Planes);
            let recorded = record.iter().flat_map(|record| &record.sources).filter_map(place).collect();
            let sources = sources(&ground_truth, true_map, recorded);
            Some(View {
                predicted,
                true_map,
                sources,
                plane: plane_distance.map(PlaneUnit::Distance).or(planes),
            })
        };
        let views: Vec<View> = prediction.names().iter().enumerate().filter_map(view).collect();
        let scene = Self { prediction, ground_truth, views };
        scene.check(on_event)?;
        Ok(scene)
    }

    /// Warns of views that have no counterpart; an error if no view has one.
    fn check(&self, on_event: &mut OnEvent<'_>) -> Result<(), VamvsError> {
        let (both, predicted, ground_truth) =
            (self.views.len(), self.prediction.len(), self.ground_truth.len());
        if both == 0 {
            let problem = format!(
                "expected depth maps of views that are in {} too, such as {}; found {}",
                self.ground_truth.root().display(),
                self.ground_truth.names()[0],
                self.prediction.names()[0]
            );
            return Err(VamvsError::Folder { path: self.prediction.root().to_owned(), problem });
        }
        if both < predicted.max(ground_truth) {
            let text = format!(
                "{both} views are compared; {} of {predicted} views have no ground truth, {} of {ground_truth} no depth map",
                predicted - both,
                ground_truth - both
            );
            tell(on_event, Event::Warning(text))?;
        }
        Ok(())
    }

    /// The depth maps that are compared.
    #[must_use]
    pub fn prediction(&self) -> &Maps {
        &self.prediction
    }

    /// The true depth maps.
    #[must_use]
    pub fn ground_truth(&self) -> &Maps {
        &self.ground_truth
    }

    /// Number of views that have both.
    #[must_use]
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Always false: [`DepthScene::open`] refuses a scene without views.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// The name of a view.
    #[must_use]
    pub fn name(&self, view: usize) -> &str {
        &self.prediction.names()[self.views[view].predicted]
    }

    /// The photograph of a view at the size of its depth map.
    pub(super) fn photograph(&self, view: usize, size: Size) -> Result<Grid<Rgb>, VamvsError> {
        self.prediction.photograph(self.views[view].predicted, size)
    }

    /// Whether the plane distances of all views are known.
    #[must_use]
    pub fn knows_planes(&self) -> bool {
        self.views.iter().all(|view| view.plane.is_some())
    }

    /// The errors of all views.
    ///
    /// # Errors
    /// If a file cannot be read, maps differ in camera or size, or thresholds need plane distances
    /// that are not known.
    pub fn errors(&self, thresholds: &[Threshold]) -> Result<SceneErrors, VamvsError> {
        if let Some(view) = self.views.iter().find(|view| view.plane.is_none()) {
            refuse_planes(thresholds, &self.prediction.names()[view.predicted])?;
        }
        let (mut total, mut reliability) = (DepthSamples::default(), Reliability::default());
        let mut views = Vec::with_capacity(self.views.len());
        // As many views at once as there are threads, so that their pixels are not in memory twice.
        let all: Vec<usize> = (0..self.views.len()).collect();
        for part in all.chunks(rayon::current_num_threads().max(1)) {
            let measured = |&view: &usize| {
                let (samples, reliable) = self.samples(view)?;
                let view = self.name(view).to_owned();
                Ok((ViewErrors { view, regions: regions(&samples, thresholds) }, samples, reliable))
            };
            let part: Vec<_> = part.par_iter().map(measured).collect::<Result<_, VamvsError>>()?;
            for (errors, samples, reliable) in part {
                views.push(errors);
                total.append(&samples);
                reliability.append(&reliable);
            }
        }
        Ok(SceneErrors { views, total: regions(&total, thresholds), reliability })
    }

    fn samples(&self, view: usize) -> Result<(DepthSamples, Reliability), VamvsError> {
        let compared = self.compared(view)?;
        let pair = MapPair {
            depth: &compared.map.depth,
            ground_truth: &compared.ground_truth,
            visible: compared.visible.as_ref(),
            plane: self.views[view].plane,
        };
        let mut samples = DepthSamples::default();
        samples
            .add(&pair)
            .map_err(|error| VamvsError::Request(error.to_string()).of_view(self.name(view)))?;
        let mut reliability = Reliability::default();
        outcomes(&compared.map.depth, &compared.map.confidence, &compared.ground_truth)
            .for_each(|(confidence, right)| reliability.add(confidence, right));
        Ok((samples, reliability))
    }

    /// Reads a view's depth map and samples the ground truth at its pixels.
    ///
    /// # Errors
    /// If a file cannot be read, or the two maps are of cameras with different poses.
    pub fn compared(&self, view: usize) -> Result<ComparedMap, VamvsError> {
        let View { predicted, true_map, .. } = self.views[view];
        let (map, ground_truth) =
            (self.prediction.depth_map(predicted)?, self.ground_truth.depth_map(true_map)?);
        self.check_poses(view, &ground_truth)?;
        let pixels = PixelMap::between_cameras(&map.camera, &ground_truth.camera);
        let size = map.depth.size();
        let visible = self.visible(view, ground_truth.depth.size())?;
        Ok(ComparedMap {
            ground_truth: pixels.sampled(&ground_truth.depth, size),
            visible: visible.map(|visible| pixels.sampled(&visible, size)),
            map,
        })
    }

    fn check_poses(&self, view: usize, ground_truth: &DepthMap) -> Result<(), VamvsError> {
        let pose = self.prediction.pose(self.views[view].predicted);
        let moved = (pose.centre() - ground_truth.cam_from_world.centre()).norm();
        let turned = (pose.rotation - ground_truth.cam_from_world.rotation).norm();
        if moved <= SAME_POSE * median_depth(&ground_truth.depth) && turned <= SAME_POSE {
            return Ok(());
        }
        let problem = format!(
            "expected depth and ground truth to be of the same camera, found cameras {moved:.4} apart and turned by {:.2}°",
            (turned / 2f64.sqrt()).to_degrees()
        );
        Err(VamvsError::Request(problem).of_view(self.name(view)))
    }

    /// Whether all source views see the surface of each true pixel, if there are visibility masks.
    fn visible(&self, view: usize, size: Size) -> Result<Option<Grid<Option<bool>>>, VamvsError> {
        let path = self.ground_truth.root().join("visibility").join(format!("{}.png", self.name(view)));
        if !path.is_file() {
            return Ok(None);
        }
        // Of all views of the scene, also those without a depth map.
        let tiles = visibility::read(&path, size, self.ground_truth.views_of_scene())?;
        let sources: Vec<usize> =
            self.views[view].sources.iter().map(|&source| self.ground_truth.place_in_scene(source)).collect();
        let at = |x, y| seen_by_all(sources.iter().map(|&source| tiles[source][(x, y)]));
        Ok(Some(Grid::from_fn(size, at)))
    }
}

/// Compares depth map files with true ones: two files, or the files of two folders that have the same names up to the
/// extension. Formats follow from the extensions; `png_step` is the depth of one grey level of a PNG, by default that of
/// the file `png-step.txt` beside it, and 0.001 if there is none.
///
/// # Errors
/// If a file cannot be read, the maps are of different shapes, the folders have no name in common, or thresholds in
/// plane distances are given without `plane_distance`.
pub fn compare_files(
    [prediction, ground_truth]: [&Path; 2],
    png_step: Option<f64>,
    plane_distance: Option<f64>,
    thresholds: &[Threshold],
) -> Result<SceneErrors, VamvsError> {
    let plane = plane_distance.map(PlaneUnit::Distance);
    let files = match ground_truth.is_dir() {
        true => files_in_both(prediction, ground_truth)?,
        false => vec![[prediction.to_owned(), ground_truth.to_owned()]],
    };
    let (mut total, mut views) = (DepthSamples::default(), Vec::new());
    for [prediction, ground_truth] in files {
        let view = prediction.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if plane.is_none() {
            refuse_planes(thresholds, &view)?;
        }
        let samples = file_samples([&prediction, &ground_truth], png_step, plane)
            .map_err(|error| error.of_view(&view))?;
        total.append(&samples);
        views.push(ViewErrors { view, regions: regions(&samples, thresholds) });
    }
    Ok(SceneErrors { views, total: regions(&total, thresholds), reliability: Reliability::default() })
}

/// The depth of one grey level of a PNG that nothing is said about: millimetres in a scene in metres.
const USUAL_PNG_STEP: f64 = 0.001;

fn file_samples(
    [prediction, ground_truth]: [&Path; 2],
    png_step: Option<f64>,
    plane: Option<PlaneUnit>,
) -> Result<DepthSamples, VamvsError> {
    let read = |path: &Path| {
        let step = png_step.map_or_else(|| depth::png_step_beside(path), |step| Ok(Some(step)))?;
        depth::read(path, step.unwrap_or(USUAL_PNG_STEP))
    };
    let (depth, ground_truth) = (read(prediction)?, read(ground_truth)?);
    let refused = |error: SizeMismatch| VamvsError::Request(error.to_string());
    let pixels = PixelMap::between_sizes(depth.size(), ground_truth.size()).map_err(refused)?;
    let ground_truth = pixels.sampled(&ground_truth, depth.size());
    let mut samples = DepthSamples::default();
    samples
        .add(&MapPair { depth: &depth, ground_truth: &ground_truth, visible: None, plane })
        .map_err(refused)?;
    Ok(samples)
}

/// Whether `folder` holds depth map files alone, without the cameras of [`Maps`].
#[must_use]
pub fn are_only_files(folder: &Path) -> bool {
    !Maps::are_at(folder) && !map_files(folder).is_empty()
}

/// The depth map files of two folders that have the same names up to the extension.
fn files_in_both(prediction: &Path, ground_truth: &Path) -> Result<Vec<[PathBuf; 2]>, VamvsError> {
    let depths = prediction.join("depths");
    let predicted = map_files(if depths.is_dir() { &depths } else { prediction });
    let mut true_maps = map_files(ground_truth);
    let pairs = predicted.into_iter().filter_map(|(stem, file)| Some([file, true_maps.remove(&stem)?]));
    let pairs: Vec<_> = pairs.collect();
    if pairs.is_empty() {
        let problem = format!(
            "expected depth maps (.pfm, .png, .exr, .npy) with the names of those in {}, found none",
            ground_truth.display()
        );
        return Err(VamvsError::Folder { path: prediction.to_owned(), problem });
    }
    Ok(pairs)
}

/// The depth map files of a folder by their names without extension; none if it cannot be read.
fn map_files(folder: &Path) -> BTreeMap<String, PathBuf> {
    let stem = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    maps::map_files(folder).into_iter().map(|path| (stem(&path), path)).collect()
}

/// Scenes by name, each with its folder of depth maps and that of the ground truth: the two given
/// folders, or their subfolders of the same names.
///
/// # Errors
/// If there are none.
pub fn scenes(prediction: &Path, ground_truth: &Path) -> Result<Vec<(String, [PathBuf; 2])>, VamvsError> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if Maps::are_at(prediction) {
        return Ok(vec![(name(ground_truth), [prediction.to_owned(), ground_truth.to_owned()])]);
    }
    let entries = std::fs::read_dir(prediction).into_iter().flatten().flatten();
    let pair = |folder: PathBuf| (name(&folder), [folder.clone(), ground_truth.join(name(&folder))]);
    let mut scenes: Vec<_> = entries.map(|entry| pair(entry.path())).collect();
    scenes.retain(|(_, folders)| folders.iter().all(|folder| Maps::are_at(folder)));
    scenes.sort();
    if scenes.is_empty() {
        let problem = format!(
            "expected depth maps as `vamvs depth` writes them, or folders of such depth maps with the same names as those in {}",
            ground_truth.display()
        );
        return Err(VamvsError::Folder { path: prediction.to_owned(), problem });
    }
    Ok(scenes)
}

/// The means over scenes, region by region.
#[must_use]
pub fn mean_over_scenes(scenes: &[&SceneErrors]) -> Vec<RegionErrors> {
    let of = |region: Region| {
        let regions = scenes.iter().flat_map(|scene| &scene.total);
        let errors: Vec<_> = regions.filter(|part| part.region == region).map(|part| &part.errors).collect();
        Some(RegionErrors { region, errors: DepthErrors::mean_of(&errors)? })
    };
    [Region::All, Region::Invisible, Region::Visible].into_iter().filter_map(of).collect()
}

fn regions(samples: &DepthSamples, thresholds: &[Threshold]) -> Vec<RegionErrors> {
    let parts = if samples.know_visibility() { &[Region::Invisible, Region::Visible][..] } else { &[] };
    let errors = |&region| RegionErrors { region, errors: samples.errors(region, thresholds) };
    std::iter::once(&Region::All).chain(parts).map(errors).collect()
}

fn refuse_planes(thresholds: &[Threshold], view: &str) -> Result<(), VamvsError> {
    if !thresholds.iter().any(|threshold| matches!(threshold, Threshold::Planes(_))) {
        return Ok(());
    }
    Err(VamvsError::Request(format!(
        "the plane distance of view {view} is not known: expected `planes` in depths/{view}.json, as `vamvs depth` writes it, or --plane-distance in scene units"
    )))
}

/// Source views of a true map: the recorded ones, else those of its pairs, else all others.
fn sources(ground_truth: &Maps, view: usize, recorded: Vec<usize>) -> Vec<usize> {
    if !recorded.is_empty() {
        return recorded;
    }
    match ground_truth.pairs() {
        Some(pairs) => pairs[view].iter().map(|source| source.view).collect(),
        None => (0..ground_truth.len()).filter(|&other| other != view).collect(),
    }
}

/// Whether all views see the surface; `None` if there is none.
fn seen_by_all(tiles: impl Iterator<Item = Visibility>) -> Option<bool> {
    let mut all = true;
    for visibility in tiles {
        match visibility {
            Visibility::None => return None,
            Visibility::Visible => {}
            Visibility::OutOfView | Visibility::Occluded => all = false,
        }
    }
    Some(all)
}

/// The median of the depths of a map; 0 if there are none.
pub(super) fn median_depth(depth: &Grid<f32>) -> f64 {
    let mut depths: Vec<f32> = depth.data().iter().copied().filter(|depth| *depth > 0.0).collect();
    let middle = depths.len() / 2;
    if depths.is_empty() { 0.0 } else { f64::from(*depths.select_nth_unstable_by(middle, f32::total_cmp).1) }
}
