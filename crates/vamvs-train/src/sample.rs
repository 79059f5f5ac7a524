//! Samples: a crop of a reference view with crops of its source views, the planes and the ground truth.

use std::path::PathBuf;

use nalgebra::Vector2;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use tch::{Kind, TchError, Tensor};
use vamvs_core::depth_map::is_valid;
use vamvs_core::lift::lift;
use vamvs_core::roi::PixelBox;
use vamvs_core::{
    DepthRange, Grid, Intrinsics, Photo, Pinhole, Planes, Size, Source, Spacing, Visibility, view_selection,
};
use vamvs_io::{image, pfm, visibility};
use vamvs_net::{EncodedView, NetError, Network};

use crate::TrainError;
use crate::augment::{normal, retake};
use crate::dataset::{Dataset, TrainingScene, TrainingView};
use crate::ground_truth::GroundTruth;
use crate::options::{SampleOptions, Validation};

/// The side of a source view's crop, relative to that of the reference view's.
const SOURCE_MARGIN: f64 = 1.2;
/// The fraction of the reference view's crop that must have ground-truth depth, and how many positions or views are
/// tried.
const LEAST_KNOWN: f64 = 0.3;
const TRIES: usize = 8;
/// The fraction of the ground-truth depths that is outside the depth range at each end.
const OUTLIERS: f64 = 0.002;
/// The depth range is computed from every fourth stored pixel in both directions.
const STRIDE: usize = 4;
/// How much wider the depth range of a whole view is than the ground truth's, at each end.
const WIDER: f64 = 1.1;
/// The least and the greatest share of the surfaces that are inside of a depth range that ends before the farthest ones.
const BEYOND: (f64, f64) = (0.5, 0.97);
/// The fraction of samples whose planes have another spacing than a run would choose.
const OTHER_SPACING: f64 = 0.25;

/// The input of the network and the ground truth for its output.
#[derive(Clone, Debug)]
pub struct Sample {
    /// The photographs: the reference view's first, then the source views'.
    pub photos: Vec<Photo>,
    /// The planes.
    pub planes: Planes,
    /// The reference view's ground truth.
    pub ground_truth: GroundTruth,
    /// Two random numbers in [0, 1) that select the dilation phase of fine maps in the forward pass.
    pub phase: [f64; 2],
    /// Whether views are weighted by the ground-truth visibility instead of the network's (vis-var and vis-corr;
    /// table 2).
    pub true_visibility: bool,
}

impl Sample {
    /// The features of all photographs, the reference view's first.
    ///
    /// # Errors
    /// If the module breaks its contract or memory runs out.
    pub fn encode(&self, network: &Network) -> Result<Vec<EncodedView>, NetError> {
        self.photos.iter().map(|photo| network.encode(photo)).collect()
    }

    /// The ground-truth depths at the pixel centres of a map at 1/scale, 0 where unknown.
    #[must_use]
    pub fn true_depths(&self, scale: usize) -> Grid<f32> {
        let size = self.photos[0].camera.size;
        let (xs, ys) = (centres(size.width, scale), centres(size.height, scale));
        self.ground_truth.depths(&xs, &ys)
    }

    /// The visibility in source view `source` at the crossings of columns `xs` and rows `ys`, as a mask in the shape of
    /// `like`: 1 where the view sees the surface, 0 where it does not, NaN where it is unknown. `None` if the scene has
    /// no visibility.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn seen(
        &self,
        source: usize,
        [xs, ys]: &[Vec<f64>; 2],
        like: &Tensor,
    ) -> Result<Option<Tensor>, TchError> {
        let value = |seen| match seen {
            Visibility::None => f32::NAN,
            Visibility::Visible => 1.0,
            _ => 0.0,
        };
        let Some(seen) = self.ground_truth.seen(source, xs, ys) else { return Ok(None) };
        let values: Vec<f32> = seen.into_iter().map(value).collect();
        Ok(Some(Tensor::f_from_slice(&values)?.f_view_as(like)?.f_to_device(like.device())?))
    }

    /// The ground-truth visibility masks, if views are weighted by them: (1, 1, h, w) at the coarse resolution for each
    /// source view, 1 where it is unknown.
    ///
    /// # Errors
    /// If the scene has no visibility.
    pub fn masks(
        &self,
        network: &Network,
        reference: &EncodedView,
    ) -> Result<Option<Vec<Tensor>>, TrainError> {
        if !self.true_visibility {
            return Ok(None);
        }
        let size = reference.size_at(reference.stride);
        let shape = [1, 1, size.height as i64, size.width as i64];
        let like = Tensor::f_zeros(shape, (Kind::Float, network.device()))?;
        let stride = network.manifest().coarse_stride;
        let places = [size.width, size.height].map(|pixels| centres(pixels * stride, stride));
        let mask = |source| match self.seen(source, &places, &like)? {
            Some(mask) => Ok(mask.f_nan_to_num(1.0, None, None)?),
            None => Err(TrainError::option("true-visibility", "scenes with visibility/", &"one without")),
        };
        (0..self.photos.len() - 1).map(mask).collect::<Result<_, _>>().map(Some)
    }
}

/// Image coordinates, along one axis, of the pixel centres of a map at 1/scale of an image of `side` pixels.
#[must_use]
pub fn centres(side: usize, scale: usize) -> Vec<f64> {
    (0..side / scale).map(|i| (i as f64 + 0.5) * scale as f64).collect()
}

/// Draws sample `number` of a run, for a network whose manifest has this `plane_step`. For a data set and options it
/// depends only on the seed and the number.
///
/// # Errors
/// If a file cannot be read, or none of several reference views has any ground-truth depth.
pub fn draw(
    dataset: &Dataset,
    (options, plane_step): (&SampleOptions, f64),
    seed: u64,
    number: u64,
) -> Result<Sample, TrainError> {
    let mut rng = Pcg64::seed_from_u64(seed ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(17));
    let (scene, reference, depth) = draw_reference(dataset, &mut rng)?;
    let sources = choose_sources(&scene.sources[reference], options.views, &mut rng);
    let cut = cut_reference(&scene.views[reference], &depth, options, &mut rng);
    let mut photos = vec![photo(&scene.views[reference], &cut, options, &mut rng)?];
    // The accuracy of cameras varies between samples, as it does between real scenes.
    let noise = options.camera_noise * normal(&mut rng).exp();
    for &source in &sources {
        let cut = cut_source(scene, (reference, source), &cut, &depth);
        let mut photo = photo(&scene.views[source], &cut, options, &mut rng)?;
        misplace(&mut photo.camera.intrinsics, noise, &mut rng);
        photos.push(photo);
    }
    let planes = planes(&depth, &photos, (options, plane_step), &scene.views[reference], &mut rng)?;
    let ground_truth = ground_truth(scene, reference, depth, &sources, &cut)?;
    let phase = [rng.random(), rng.random()];
    Ok(Sample { photos, planes, ground_truth, phase, true_visibility: options.true_visibility })
}

/// A random view that has source views and ground-truth depth: its scene, its index and the depth.
fn draw_reference<'a>(
    dataset: &'a Dataset,
    rng: &mut impl Rng,
) -> Result<(&'a TrainingScene, usize, Grid<f32>), TrainError> {
    let references = dataset.references();
    let mut without = Vec::new();
    while without.len() < TRIES {
        let (scene, reference) = references[rng.random_range(0..references.len())];
        let scene = &dataset.scenes[scene];
        let file = &scene.views[reference].depth;
        let depth = pfm::read_depth(file)?;
        if depth.data().iter().copied().any(is_valid) {
            return Ok((scene, reference, depth));
        }
        without.push(file.clone());
    }
    Err(no_truth(without.swap_remove(0), &format!("found none, nor in {} others", TRIES - 1)))
}

fn no_truth(depth: PathBuf, found: &str) -> TrainError {
    TrainError::NoScenes { folder: depth, problem: format!("expected depths greater than 0, {found}") }
}

/// A random number of source views, in random order.
fn choose_sources(sources: &[Source], [fewest, most]: [usize; 2], rng: &mut impl Rng) -> Vec<usize> {
    let mut left: Vec<usize> = sources.iter().map(|source| source.view).collect();
    let count = rng.random_range(fewest..=most).saturating_sub(1).clamp(1, left.len());
    (0..count).map(|_| left.remove(rng.random_range(0..left.len()))).collect()
}

/// A crop: a part of a photograph and the size to which that part is resized.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cut {
    part: PixelBox,
    size: Size,
}

impl Cut {
    /// A crop of `extent` pixels, its centre as near to `middle` as the image allows, resized by `scale` but to no
    /// less than 32 pixels a side.
    fn around(middle: [f64; 2], extent: [f64; 2], scale: f64, image: Size) -> Self {
        let side = |middle: f64, extent: f64, whole: usize| {
            let extent = (extent.round() as usize).clamp(1, whole);
            let first = (middle - 0.5 * extent as f64).round().clamp(0.0, (whole - extent) as f64) as usize;
            (first, first + extent, ((extent as f64 * scale).round() as usize).max(32))
        };
        let (x0, x1, width) = side(middle[0], extent[0], image.width);
        let (y0, y1, height) = side(middle[1], extent[1], image.height);
        Self { part: PixelBox { x0, y0, x1, y1 }, size: Size::new(width, height) }
    }

    fn extent(&self) -> [f64; 2] {
        [(self.part.x1 - self.part.x0) as f64, (self.part.y1 - self.part.y0) as f64]
    }

    /// Pixels of the result per pixel of the part, along x and y.
    fn scale(&self) -> [f64; 2] {
        let [width, height] = self.extent();
        [self.size.width as f64 / width, self.size.height as f64 / height]
    }

    fn camera(&self, camera: &Pinhole) -> Pinhole {
        let [sx, sy] = self.scale();
        let cropped = camera.intrinsics.cropped(self.part.x0 as f64, self.part.y0 as f64);
        Pinhole { size: self.size, intrinsics: cropped.scaled(sx, sy) }
    }

    fn image(&self, image: &Grid<vamvs_core::Rgb>) -> Grid<vamvs_core::Rgb> {
        let PixelBox { x0, y0, x1, y1 } = self.part;
        let part = Grid::from_fn(Size::new(x1 - x0, y1 - y0), |x, y| image[(x0 + x, y0 + y)]);
        if part.size() == self.size { part } else { image::resize(&part, self.size) }
    }
}

/// A random crop of the reference view at a random scale, with enough known ground truth if several tries find one,
/// and with some in any case.
fn cut_reference(view: &TrainingView, depth: &Grid<f32>, options: &SampleOptions, rng: &mut impl Rng) -> Cut {
    let image = view.camera.size;
    let largest = (0..2)
        .map(|axis| [image.width, image.height][axis] as f64 / options.crop[axis] as f64)
        .fold(f64::INFINITY, f64::min);
    // If the crop is larger than the image, the image is enlarged.
    let most = largest.min(1.0 / options.min_scale);
    let step = if most > 1.0 { rng.random_range(1.0..=most) } else { most };
    let extent = options.crop.map(|side| side as f64 * step);
    let size = Size::new(options.crop[0], options.crop[1]);
    let around = |middle| Cut { size, ..Cut::around(middle, extent, 1.0, image) };
    let mut best = (0.0, None);
    for _ in 0..TRIES {
        let cut = around([image.width, image.height].map(|side| side as f64 * rng.random::<f64>()));
        let known = known_share(&cut, view, depth);
        if known > best.0 {
            best = (known, Some(cut));
        }
        if known >= LEAST_KNOWN {
            break;
        }
    }
    best.1.unwrap_or_else(|| around(known_place(view, depth, rng)))
}

/// The centre of a random pixel with ground-truth depth, in the photograph's coordinates.
fn known_place(view: &TrainingView, depth: &Grid<f32>, rng: &mut impl Rng) -> [f64; 2] {
    let known: Vec<usize> = (0..depth.data().len()).filter(|&at| is_valid(depth.data()[at])).collect();
    let at = known[rng.random_range(0..known.len())];
    let [sx, sy] = stored_step(view, depth);
    [((at % depth.width()) as f64 + 0.5) / sx, ((at / depth.width()) as f64 + 0.5) / sy]
}

/// Pixels of the stored depth map per pixel of the photograph, along x and y.
fn stored_step(view: &TrainingView, depth: &Grid<f32>) -> [f64; 2] {
    let (image, stored) = (view.camera.size, depth.size());
    [stored.width as f64 / image.width as f64, stored.height as f64 / image.height as f64]
}

/// A regular grid of positions in a crop, in the photograph's coordinates, with their ground-truth depths (0 where
/// unknown).
fn probes<'a>(
    cut: &'a Cut,
    view: &TrainingView,
    depth: &'a Grid<f32>,
) -> impl Iterator<Item = (Vector2<f64>, f32)> + 'a {
    const CELLS: usize = 12;
    let (step, [width, height]) = (stored_step(view, depth), cut.extent());
    (0..CELLS * CELLS).map(move |cell| {
        let at = |i: usize| (i as f64 + 0.5) / CELLS as f64;
        let x = cut.part.x0 as f64 + at(cell % CELLS) * width;
        let y = cut.part.y0 as f64 + at(cell / CELLS) * height;
        let stored = depth.get((x * step[0]) as usize, (y * step[1]) as usize);
        (Vector2::new(x, y), stored.copied().unwrap_or(0.0))
    })
}

fn known_share(cut: &Cut, view: &TrainingView, depth: &Grid<f32>) -> f64 {
    let known: Vec<bool> = probes(cut, view, depth).map(|(_, depth)| is_valid(depth)).collect();
    known.iter().filter(|known| **known).count() as f64 / known.len() as f64
}

/// The crop of a source view around the surfaces that the reference view's crop shows.
fn cut_source(
    scene: &TrainingScene,
    (reference, source): (usize, usize),
    cut: &Cut,
    depth: &Grid<f32>,
) -> Cut {
    let (from, to) = (&scene.views[reference], &scene.views[source]);
    let source_from_reference = to.cam_from_world.compose(&from.cam_from_world.inverse());
    let mut seen: [Vec<f64>; 2] = Default::default();
    for (pixel, depth) in probes(cut, from, depth).filter(|(_, depth)| is_valid(*depth)) {
        let in_source = source_from_reference.transform(&lift(&from.camera, &pixel, f64::from(depth)));
        if in_source.z > 0.0 {
            let pixel = to.camera.intrinsics.project(&in_source);
            seen[0].push(pixel.x);
            seen[1].push(pixel.y);
        }
    }
    let whole = [to.camera.size.width, to.camera.size.height];
    let middle = [0, 1].map(|axis| median(&mut seen[axis]).unwrap_or(0.5 * whole[axis] as f64));
    let scale = cut.scale();
    Cut::around(middle, cut.extent().map(|side| SOURCE_MARGIN * side), scale[0], to.camera.size)
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn photo(
    view: &TrainingView,
    cut: &Cut,
    options: &SampleOptions,
    rng: &mut impl Rng,
) -> Result<Photo, TrainError> {
    let image = cut.image(&image::load_rgb(&view.image)?);
    let image = if options.augment { retake(&image, rng) } else { image };
    Ok(Photo { camera: cut.camera(&view.camera), cam_from_world: view.cam_from_world, image, mask: None })
}

/// Simulates a small error of the camera's orientation: in a small crop it is nearly a shift of the principal point,
/// here normal with standard deviation `deviation` pixels.
fn misplace(intrinsics: &mut Intrinsics, deviation: f64, rng: &mut impl Rng) {
    intrinsics.cx += deviation * normal(rng);
    intrinsics.cy += deviation * normal(rng);
}

/// Random planes: those that a run would choose for the jittered depth range, with up to 30 % fewer or more planes and
/// sometimes the other spacing.
fn planes(
    depth: &Grid<f32>,
    photos: &[Photo],
    (options, plane_step): (&SampleOptions, f64),
    view: &TrainingView,
    rng: &mut impl Rng,
) -> Result<Planes, TrainError> {
    let range = true_range(depth, view)?;
    let mut jitter = |low: f64, high: f64| (options.range_jitter * rng.random_range(low..=high)).exp();
    let [near, far] = [range.near * jitter(-1.0, 0.1), range.far * jitter(-0.1, 1.0)];
    let far = if rng.random_bool(options.beyond) {
        depth_at_share(depth, rng.random_range(BEYOND.0..BEYOND.1)).unwrap_or(far)
    } else {
        far
    };
    let range = DepthRange::try_new(near, far).unwrap_or(range);
    let cameras: Vec<_> = photos.iter().map(|photo| (&photo.camera, &photo.cam_from_world)).collect();
    let planes_for_views =
        Planes::for_views(range, cameras[0], &cameras[1..], &[], (plane_step, options.max_planes));
    let count = (planes_for_views.count as f64 * rng.random_range(0.7..=1.3)) as usize;
    let count = count.next_multiple_of(8).clamp(8, options.max_planes);
    let spacing = match (planes_for_views.spacing, rng.random_bool(OTHER_SPACING)) {
        (Spacing::Depth, false) | (Spacing::InverseDepth, true) => Spacing::Depth,
        (Spacing::Depth, true) | (Spacing::InverseDepth, false) => Spacing::InverseDepth,
    };
    Ok(Planes { range, count, spacing })
}

/// The depth that this share of the ground truth does not exceed.
fn depth_at_share(depth: &Grid<f32>, share: f64) -> Option<f64> {
    let mut depths: Vec<f32> =
        depth.data().iter().step_by(STRIDE * STRIDE).copied().filter(|&depth| is_valid(depth)).collect();
    depths.sort_by(f32::total_cmp);
    depths.get((depths.len() as f64 * share) as usize).map(|&depth| f64::from(depth))
}

/// The range of a view's ground-truth depths without outliers.
fn true_range(depth: &Grid<f32>, view: &TrainingView) -> Result<DepthRange, TrainError> {
    let known = |stride: usize| -> Vec<f32> {
        let rows = (0..depth.height()).step_by(stride).map(|y| depth.row(y));
        rows.flat_map(|row| row.iter().step_by(stride)).copied().filter(|&depth| is_valid(depth)).collect()
    };
    let mut depths = known(STRIDE);
    if depths.is_empty() {
        depths = known(1);
    }
    depths.sort_by(f32::total_cmp);
    let at = |share: f64| depths.get(((depths.len() - 1) as f64 * share).round() as usize);
    let ends = (!depths.is_empty()).then(|| (at(OUTLIERS), at(1.0 - OUTLIERS)));
    let range = ends.and_then(|(near, far)| {
        let (near, far) = (f64::from(*near?), f64::from(*far?));
        DepthRange::try_new(near * (1.0 - 1e-3), far * (1.0 + 1e-3)).ok()
    });
    range.ok_or_else(|| no_truth(view.depth.clone(), "found none"))
}

/// The range in which a run looks for a view's depths: that of the ground truth, wider by a factor of [`WIDER`] at each end.
pub(crate) fn run_range(depth: &Grid<f32>, view: &TrainingView) -> Result<DepthRange, TrainError> {
    let range = true_range(depth, view)?;
    Ok(DepthRange { near: range.near / WIDER, far: range.far * WIDER })
}

fn ground_truth(
    scene: &TrainingScene,
    reference: usize,
    depth: Grid<f32>,
    sources: &[usize],
    cut: &Cut,
) -> Result<GroundTruth, TrainError> {
    let view = &scene.views[reference];
    let step = stored_step(view, &depth);
    let visibility = match &view.visibility {
        Some(path) => {
            let tiles = visibility::read(path, depth.size(), scene.views.len())?;
            sources.iter().map(|&source| tiles[source].clone()).collect()
        }
        None => Vec::new(),
    };
    let [sx, sy] = cut.scale();
    Ok(GroundTruth {
        depth,
        is_complete: view.is_complete,
        visibility,
        origin: [cut.part.x0 as f64 * step[0], cut.part.y0 as f64 * step[1]],
        step: [step[0] / sx, step[1] / sy],
    })
}

/// A sample of a whole reference view as a run would see it: with its best source views, not augmented, and with
/// planes for a depth range that is wider than the ground truth's by a factor of 1.1 at each end.
///
/// # Errors
/// As [`draw`].
pub fn whole(
    scene: &TrainingScene,
    reference: usize,
    (options, plane_step): (&Validation, f64),
) -> Result<Sample, TrainError> {
    let view = &scene.views[reference];
    let sources: Vec<usize> =
        view_selection::compared(&scene.sources[reference], options.views - 1).collect();
    let cut = |view: &TrainingView| {
        let Size { width, height } = view.camera.size;
        let scale = (options.max_size as f64 / width.max(height) as f64).min(1.0);
        let whole = [width as f64, height as f64];
        Cut::around(whole.map(|side| 0.5 * side), whole, scale, view.camera.size)
    };
    let photos = std::iter::once(&reference).chain(&sources).map(|&index| {
        let (view, cut) = (&scene.views[index], cut(&scene.views[index]));
        let image = cut.image(&image::load_rgb(&view.image)?);
        Ok(Photo { camera: cut.camera(&view.camera), cam_from_world: view.cam_from_world, image, mask: None })
    });
    let photos = photos.collect::<Result<Vec<_>, TrainError>>()?;
    let depth = pfm::read_depth(&view.depth)?;
    let range = run_range(&depth, view)?;
    let cameras: Vec<_> = photos.iter().map(|photo| (&photo.camera, &photo.cam_from_world)).collect();
    let planes = Planes::for_views(range, cameras[0], &cameras[1..], &[], (plane_step, options.max_planes));
    let ground_truth = ground_truth(scene, reference, depth, &sources, &cut(view))?;
    let true_visibility = options.true_visibility;
    Ok(Sample { photos, planes, ground_truth, phase: [0.0; 2], true_visibility })
}
