//! Runs all stages of the network, from a reference view and its source views to a depth map.

use std::num::NonZeroUsize;

use crate::depth_completion::Completion;
use serde::{Deserialize, Serialize};
use tch::{TchError, Tensor};
use vamvs_core::{DepthMap, Grid, MonotoneMap, Photo, Pinhole, Planes, Rgb, Size};

use crate::cascade::{Fine, enlarged, keep_surfaces};
use crate::coarse::{PlaneMap, soft_argmin, where_unsure};
use crate::cost_volume::{self, Costs, SweepInputs};
use crate::manifest::LARGEST_STRIDE;
use crate::manifest::check_iterations;
use crate::point_flow::{FlowStage, upsample_nearest};
use crate::post_process::{completed, upsampled};
use crate::profile::{Profile, Stage};
use crate::project::{centred, depth_of};
use crate::tensor_grid::to_grid;
use crate::{Cascade, Device, EncodedView, Iteration, Manifest, NetError, Network};

/// The parameters of depth estimation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorOptions {
    /// The flow iterations, coarse to fine, none coarser than the coarse depth map. The last one's scale is that of
    /// the estimated depth map.
    pub iterations: Vec<Iteration>,
    /// Depth completion of the maps at the coarse resolution; `None`: no completion.
    pub completion: Option<Completion>,
    /// Standard deviation of colours on one surface, grey values, for joint bilateral upsampling of the maps;
    /// `None`: nearest-neighbour upsampling.
    pub guide: Option<f32>,
    /// Memory of one slab of warped features in the plane sweep, bytes.
    pub slab_bytes: usize,
    /// Points refined at once, all hypotheses counted.
    pub strip_points: usize,
}

// The factors of `Estimator::peak_bytes`, measured.

/// Memory that libtorch keeps apart from tensors once it has run: compiled kernels and the heaps of its threads, bytes.
const WORKSPACE: usize = 56 << 20;

/// Memory of encoding for each pixel of a photograph, the resulting features not counted, bytes.
const ENCODING: usize = 128;

/// Memory of the photograph at 1/2, 1/4 and 1/8, for each block of 8×8 pixels, bytes.
const PHOTOGRAPHS: usize = (16 + 4 + 1) * size_of::<Rgb>();

/// Memory of the sweep apart from the volume, in slabs: warped features and the layers that relate them.
const SLABS: usize = 4;

/// As `SLABS`, for a network that regularises the volume as a whole: it has few channels and relates them in one step.
const SLABS_OF_WHOLE: usize = 2;

/// Memory of regularising a whole volume, in volumes: the volume, a copy with the matcher's inputs, and the layers at
/// full resolution.
const VOLUMES: usize = 4;

/// As `VOLUMES`, in tenths, for a volume of correlations, whose layers at full resolution run on a few planes at a time.
const TENTHS_OF_CORRELATIONS: usize = 18;

/// The planes that these layers run on, with a halo, and the number of copies of them.
const CORRELATED_PLANES: usize = 18;
const CORRELATED: usize = 4;

/// What libtorch keeps apart from tensors for the layers on a volume of correlations, in addition to `WORKSPACE`, bytes.
const CORRELATION_WORKSPACE: usize = 20 << 20;

/// What the threads of the kernels that relate pairs keep, and what is not returned between their tensors, bytes.
const KERNELS: usize = 44 << 20;

/// Memory of regularising slab by slab, in outputs of the first layers.
const LAYERS: usize = 6;

/// The fewest planes that wait for the first layers, and the number of copies of them.
const WAITING_PLANES: usize = 10;
const WAITING: usize = 2;

/// Memory of the flow for each point, as a multiple of its channels.
const POINTS: usize = 4;

/// Slabs and strips on a processor, whose caches hold a part of them, and on a GPU, which is idle while it begins the
/// next one.
const SLAB_BYTES: [usize; 2] = [32 << 20, 256 << 20];
const STRIP_POINTS: [usize; 2] = [200_000, 2_000_000];

impl EstimatorOptions {
    /// The defaults of a network, from its manifest, with slabs and strips for the device that it is on.
    #[must_use]
    pub fn of(network: &Network) -> Self {
        let on_gpu = usize::from(network.device() != Device::Cpu);
        Self {
            iterations: network.iterations(),
            completion: network.manifest().completion,
            guide: network.manifest().guide,
            slab_bytes: SLAB_BYTES[on_gpu],
            strip_points: STRIP_POINTS[on_gpu],
        }
    }

    /// Whether these options give the same depth maps as the network's defaults; slabs and strips do not matter.
    fn is_of(&self, network: &Network) -> bool {
        let Self { slab_bytes, strip_points, .. } = *self;
        *self == Self { slab_bytes, strip_points, ..Self::of(network) }
    }
}

/// The output of the coarse stage.
#[derive(Debug)]
pub struct Coarse {
    /// The coarse depth map, (h, w).
    pub map: PlaneMap,
    /// The costs of the planes, (1, D, h, w); a low cost is likely.
    pub costs: Tensor,
    /// vis-var and vis-corr: the visibility mask of each source view, (1, 1, h, w) in [0, 1]; else empty.
    pub visibility: Vec<Tensor>,
}

/// Estimates depth maps with one network.
#[derive(Debug)]
pub struct Estimator {
    network: Network,
    options: EstimatorOptions,
}

impl Estimator {
    /// An estimator.
    ///
    /// # Errors
    /// If the iterations are malformed, or one of them is coarser than the coarse depth map.
    pub fn new(network: Network, options: EstimatorOptions) -> Result<Self, NetError> {
        check_iterations(&options.iterations)
            .map_err(|problem| NetError::Request(format!("the list of iterations {problem}")))?;
        if !network.manifest().aggregation.has_flow() && !options.iterations.is_empty() {
            let problem = format!("{} has no flow, so no flow iterations", network.manifest().name);
            return Err(NetError::Request(problem));
        }
        let coarse_stride = network.manifest().coarse_stride;
        if let Some(Iteration { scale, .. }) =
            options.iterations.iter().find(|iteration| iteration.scale > coarse_stride)
        {
            let problem = format!(
                "an iteration at 1/{scale} cannot refine a coarse map with a coarse stride of {coarse_stride}"
            );
            return Err(NetError::Request(problem));
        }
        Ok(Self { network, options })
    }

    /// The network.
    #[must_use]
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The network, to set its mode or manifest. Do not change its coarse stride here: make another estimator.
    pub fn network_mut(&mut self) -> &mut Network {
        &mut self.network
    }

    /// Gives the network back.
    #[must_use]
    pub fn into_network(self) -> Network {
        self.network
    }

    /// The options.
    #[must_use]
    pub fn options(&self) -> &EstimatorOptions {
        &self.options
    }

    /// The distinct scales of the stages, the coarsest first. A map's size is the photograph's divided by its scale.
    #[must_use]
    pub fn scales(&self) -> Vec<usize> {
        let iterations = self.iterations().into_iter().map(|iteration| iteration.scale);
        let scales = [self.network.manifest().feature_stride].into_iter().chain(iterations);
        let mut scales: Vec<usize> = scales.map(|scale| scale / self.network.enlarge()).collect();
        scales.dedup();
        scales
    }

    /// The iterations of the options, with scales relative to the enlarged photograph that the network sees.
    #[must_use]
    pub fn iterations(&self) -> Vec<Iteration> {
        let of = |&Iteration { scale, step }: &_| Iteration { scale: scale * self.network.enlarge(), step };
        self.options.iterations.iter().map(of).collect()
    }

    /// The options, mutable.
    pub fn options_mut(&mut self) -> &mut EstimatorOptions {
        &mut self.options
    }

    /// Encodes a photograph, without the features that only a flow needs if there are no iterations. Later iterations
    /// need the views encoded anew.
    ///
    /// # Errors
    /// As [`Network::encode`].
    pub fn encode(&self, photo: &Photo) -> Result<EncodedView, NetError> {
        self.network.encode_for(photo, !self.options.iterations.is_empty())
    }

    /// Estimates the peak memory of a depth map from `views` photographs of `size` pixels with `planes` planes, bytes.
    /// The features of the photographs are included, the loaded network is not.
    ///
    /// The estimate is the features of all views plus the largest of these: encoding a photograph; the sweep and the
    /// regularisation of its volume; the points of a strip. The factors were measured on the built-in networks, for
    /// which the estimate is between 0.8 and 1.3 of the peak.
    #[must_use]
    pub fn peak_bytes(&self, size: Size, views: usize, planes: usize) -> usize {
        let (channels, value, enlarge) =
            (self.network.channel_counts(), size_of::<f32>(), self.network.enlarge());
        let at = |stride: usize| size.width.div_ceil(stride) * size.height.div_ceil(stride) * enlarge.pow(2);
        let Manifest { feature_stride, cascade, .. } = *self.network.manifest();
        let (blocks, pixels) = (at(LARGEST_STRIDE), at(feature_stride));
        let wide = if enlarge > 1 { blocks / 4 * channels.coarse } else { 0 };
        let wide = if cascade.is_some() { pixels / 4 * channels.coarse } else { wide };
        let flows = !self.options.iterations.is_empty();
        let kept = if flows { channels.features * blocks } else { channels.coarse * pixels };
        let features = views * ((kept + wide) * value + blocks * PHOTOGRAPHS);
        let encoding = ENCODING * size.area() * enlarge.pow(2);
        let hypotheses = 2 * self.network.manifest().hypotheses + 1;
        let points = if flows { self.options.strip_points.min(pixels * hypotheses) } else { 0 };
        let flow = POINTS * points * channels.point * value;
        let volumes = match cascade {
            None => self.coarse_bytes(pixels, views, planes),
            Some(Cascade { planes: around, .. }) => {
                self.coarse_bytes(pixels / 4, views, planes).max(self.coarse_bytes(pixels, views, around))
            }
        };
        WORKSPACE + features + encoding.max(volumes).max(flow)
    }

    /// Memory of the coarse stage for a coarse map of `pixels` pixels, bytes.
    fn coarse_bytes(&self, pixels: usize, views: usize, planes: usize) -> usize {
        let (channels, value) = (self.network.channel_counts(), size_of::<f32>());
        let volume = channels.volume * planes * pixels * value;
        if self.network.manifest().aggregation.correlates() {
            let slab = CORRELATED_PLANES * volume / planes.max(1);
            return CORRELATION_WORKSPACE + TENTHS_OF_CORRELATIONS * volume / 10 + CORRELATED * slab;
        }
        let plane = channels.coarse * pixels * value;
        let slab = self.options.slab_bytes.clamp(plane, planes * plane);
        if !self.network.manifest().slabs {
            return (volume + SLABS_OF_WHOLE * slab).max(VOLUMES * volume);
        }
        let waiting = (slab / plane).max(WAITING_PLANES) * channels.volume * pixels * value;
        let first_layers = channels.first_layers * planes * pixels * value;
        // Where kernels relate pairs, the first layer is applied to the features of each view before the sweep.
        let of_views = views * channels.hidden * pixels * value;
        let sweep = if channels.hidden > 0 { of_views } else { SLABS * slab };
        let kernels = if channels.hidden > 0 { KERNELS } else { 0 };
        kernels + (first_layers + sweep + WAITING * waiting).max(LAYERS * first_layers)
    }

    /// Estimates the depth map of `reference` from `sources` on `planes`, at the scale of the last iteration (the
    /// coarse stride if there are no iterations). Its camera has the size of the map.
    ///
    /// # Errors
    /// If there are no sources, the module breaks its contract, or memory runs out.
    pub fn estimate(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        profile: &mut Profile,
    ) -> Result<DepthMap, NetError> {
        Ok(self.estimate_seen(reference, sources, planes, profile)?.0)
    }

    /// As [`Estimator::estimate`], and also returns the visibility of the reference view's pixels in each source view,
    /// in [0, 1], at the coarse resolution, without the padding. The list is empty unless the aggregation weighs views.
    ///
    /// # Errors
    /// As [`Estimator::estimate`].
    pub fn estimate_seen(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        profile: &mut Profile,
    ) -> Result<(DepthMap, Vec<Grid<f32>>), NetError> {
        self.check(sources, planes)?;
        tch::no_grad(|| {
            let Stages { maps: stages, visibility: masks, surface } =
                self.all_stages(reference, sources, planes, None, profile)?;
            let [height, width] = {
                let Size { width, height } = reference.camera.size;
                [height, width].map(|side| (side / reference.stride) as i64)
            };
            let grid = |mask: &Tensor| {
                let padded = mask.f_squeeze_dims([0, 1].as_slice())?;
                to_grid(&padded.f_narrow(0, 0, height)?.f_narrow(1, 0, width)?)
            };
            let seen = masks.iter().map(grid).collect::<Result<_, _>>()?;
            let mut map = self.depth_map(reference, planes, &stages)?;
            if let Some(surface) = surface {
                keep_surfaces(&mut map, &to_grid(&surface)?);
            }
            Ok((map, seen))
        })
    }

    /// Checks that there are enough source views and planes.
    pub(crate) fn check(&self, sources: &[&EncodedView], planes: &Planes) -> Result<(), NetError> {
        if sources.is_empty() {
            return Err(NetError::Request("a depth map needs at least one source view".to_owned()));
        }
        if planes.count < 2 {
            return Err(NetError::Request(format!("a sweep needs at least 2 planes, got {}", planes.count)));
        }
        Ok(())
    }

    /// The coarse map (completed, if the options say so) and the map after each iteration; `seen` as for
    /// [`Estimator::coarse`].
    ///
    /// # Errors
    /// As [`Estimator::estimate`].
    pub fn stages(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        seen: Option<Vec<Tensor>>,
        profile: &mut Profile,
    ) -> Result<Vec<PlaneMap>, NetError> {
        Ok(self.all_stages(reference, sources, planes, seen, profile)?.maps)
    }

    /// As [`Estimator::stages`], with what else the stages tell.
    fn all_stages(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        seen: Option<Vec<Tensor>>,
        profile: &mut Profile,
    ) -> Result<Stages, NetError> {
        let coarse = self.coarse(reference, sources, planes, seen, profile)?;
        if self.network.manifest().cascade.is_some() {
            let Fine { map, visibility, surface, .. } =
                self.fine(reference, sources, planes, &coarse, profile)?;
            return Ok(Stages { maps: vec![coarse.map, map], visibility, surface: Some(surface) });
        }
        let Coarse { map, visibility, .. } = coarse;
        let mut stages = vec![self.completed(map, reference, planes, profile)?];
        for iteration in self.iterations() {
            let stage = self.flow_stage(reference, sources, planes, &visibility, iteration);
            let refined = self.iterate(&stage, &stages[stages.len() - 1].u, profile)?;
            stages.push(refined);
        }
        Ok(Stages { maps: stages, visibility, surface: None })
    }

    /// Runs one iteration on the depth map `before`, with the upsampling before it and the completion after it that
    /// the options ask for.
    pub(crate) fn iterate(
        &self,
        stage: &FlowStage<'_>,
        before: &Tensor,
        profile: &mut Profile,
    ) -> Result<PlaneMap, NetError> {
        let enlarged = match self.options.guide {
            Some(colour) => Some(profile.time(Stage::Flow, || upsampled(before, stage, colour))?),
            None => None,
        };
        let refined = stage.refine(enlarged.as_ref().unwrap_or(before), profile)?;
        if stage.iteration.scale == stage.reference.stride {
            return self.completed(refined, stage.reference, stage.planes, profile);
        }
        Ok(refined)
    }

    /// Completes textureless surfaces in a map at the coarse resolution, if the options ask for it.
    pub(crate) fn completed(
        &self,
        map: PlaneMap,
        reference: &EncodedView,
        planes: &Planes,
        profile: &mut Profile,
    ) -> Result<PlaneMap, NetError> {
        match self.options.completion {
            Some(how) => profile.time(Stage::Regularize, || completed(map, reference, planes, how)),
            None => Ok(map),
        }
    }

    /// The coarse stage (sections 3.1 and 3.2). In a cascade it sweeps the photograph at half its size: its map has half
    /// the resolution of the other stages.
    ///
    /// If photographs are enlarged (a coarse stride of 4 with features of stride 8), the costs at the fine stride are
    /// blended with those at twice that stride, by the confidence of the fine ones; the wider ones are better where
    /// photographs are blurred or cameras inaccurate. For vis-var and vis-corr, the visibility masks `seen`,
    /// (1, 1, h, w) for each source view at the resolution of the last map, replace the network's own.
    ///
    /// # Errors
    /// As [`Estimator::estimate`].
    pub fn coarse(
        &self,
        reference: &EncodedView,
        sources: &[&EncodedView],
        planes: &Planes,
        seen: Option<Vec<Tensor>>,
        profile: &mut Profile,
    ) -> Result<Coarse, NetError> {
        let (network, slab_bytes) = (&self.network, self.options.slab_bytes);
        let wide_masks = seen.as_ref().map(|masks| masks.iter().map(halved).collect::<Result<_, _>>());
        let mut costs_at = |level: usize, seen: Option<Vec<Tensor>>| {
            let inputs = SweepInputs { network, reference, sources, planes, level, around: None, slab_bytes };
            let are_given = seen.is_some();
            let Costs { costs, visibility } = cost_volume::costs(&inputs, seen, profile)?;
            let stride = reference.stride << level;
            let cells = network.manifest().feature_offset(stride) / stride as f64;
            let masks = visibility.into_iter().map(|mask| centred(mask, if are_given { 0.0 } else { cells }));
            Ok::<_, NetError>((centred(costs, cells)?, masks.collect::<Result<_, _>>()?))
        };
        let wide_masks = wide_masks.transpose()?;
        let (costs, visibility) = if network.manifest().cascade.is_some() {
            costs_at(1, wide_masks)?
        } else {
            let (costs, visibility) = costs_at(0, seen)?;
            if reference.coarse.len() == 1 {
                (costs, visibility)
            } else {
                let (wide, _) = costs_at(1, wide_masks)?;
                (where_unsure(&costs, &wide, network.manifest().window)?, visibility)
            }
        };
        let map = profile.time(Stage::Regularize, || soft_argmin(&costs, network.manifest().window))?;
        Ok(Coarse { map, costs, visibility })
    }

    /// The inputs of one flow iteration (sections 3.3 and 3.4), with the visibility masks of the coarse stage. If the
    /// manifest has `flow_sources`, only that many of the first source views are used.
    #[must_use]
    pub fn flow_stage<'a>(
        &'a self,
        reference: &'a EncodedView,
        sources: &'a [&'a EncodedView],
        planes: &'a Planes,
        visibility: &'a [Tensor],
        iteration: Iteration,
    ) -> FlowStage<'a> {
        let strip_rows = self.strip_rows(reference);
        let most = self.network.manifest().flow_sources.map_or(sources.len(), NonZeroUsize::get);
        let sources = &sources[..sources.len().min(most)];
        FlowStage { network: &self.network, reference, sources, planes, visibility, iteration, strip_rows }
    }

    /// Rows of a strip of about `strip_points` points, at least 8.
    fn strip_rows(&self, reference: &EncodedView) -> usize {
        let hypotheses = 2 * self.network.manifest().hypotheses + 1;
        (self.options.strip_points / (hypotheses * reference.size_at(reference.stride).width)).max(8)
    }

    /// The calibration of the confidence, if the network has one and the options are those it was made with.
    #[must_use]
    pub fn calibration(&self) -> Option<&MonotoneMap> {
        self.network.manifest().calibration.as_ref().filter(|_| self.options.is_of(&self.network))
    }

    /// The calibrated confidence, if there is a calibration; else the confidence as it is.
    pub(crate) fn calibrated(&self, confidence: Grid<f32>) -> Grid<f32> {
        match self.calibration() {
            Some(map) => confidence.map(|&value| map.at(f64::from(value)) as f32),
            None => confidence,
        }
    }

    /// The last stage as a depth map, without the padding.
    fn depth_map(
        &self,
        reference: &EncodedView,
        planes: &Planes,
        stages: &[PlaneMap],
    ) -> Result<DepthMap, NetError> {
        let scale = self.iterations().last().map_or(reference.stride, |iteration| iteration.scale);
        let first_scale = reference.padded.width / stages[0].u.size()[1] as usize;
        let full = reference.camera.size;
        let size = Size::new(full.width / scale, full.height / scale);
        let last = &stages[stages.len() - 1];
        let padded = reference.size_at(scale);
        let grid = |map: &Tensor| -> Result<Grid<f32>, NetError> {
            to_grid(&map.f_narrow(0, 0, size.height as i64)?.f_narrow(1, 0, size.width as i64)?)
        };
        let depth = depth_of(planes, &last.u)?.f_mul_scalar(planes.range.near)?;
        let coarse_confidence = if first_scale > reference.stride {
            let confidence = stages[0].confidence.f_unsqueeze(0)?.f_unsqueeze(0)?;
            grid(&enlarged(&confidence, padded)?.f_squeeze_dims([0, 1].as_slice())?)?
        } else {
            grid(&upsample_nearest(&stages[0].confidence, padded)?)?
        };
        let confidence = if stages.len() > 1 { grid(&last.confidence)? } else { coarse_confidence.clone() };
        let confidence = self.calibrated(confidence);
        let ratio = 1.0 / scale as f64;
        Ok(DepthMap {
            camera: Pinhole { size, intrinsics: reference.intrinsics().scaled(ratio, ratio) },
            cam_from_world: reference.cam_from_world,
            depth: grid(&depth)?,
            confidence,
            coarse_confidence: Some(coarse_confidence),
        })
    }
}

/// The maps of all stages, the coarse one first, and what the stages tell beside depth.
struct Stages {
    maps: Vec<PlaneMap>,
    /// The visibility mask of each source view, (1, 1, h, w) at the coarse stride; empty unless the aggregation weighs views.
    visibility: Vec<Tensor>,
    /// Of a cascade: the probability of a surface, (h, w) at the coarse stride.
    surface: Option<Tensor>,
}

/// A mask (1, 1, h, w) averaged down to half its size.
fn halved(mask: &Tensor) -> Result<Tensor, TchError> {
    mask.f_avg_pool2d([2, 2], [2, 2], [0, 0], false, true, None)
}
