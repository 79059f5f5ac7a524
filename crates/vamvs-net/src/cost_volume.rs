//! The plane sweep: source features are warped onto the reference view's planes and aggregated (section 3.1).
//!
//! Slabs of planes are processed one after the other, and within a slab one source view after the other, so that
//! of the warped features only one slab of one view exists at a time. vis-corr goes through the views in the
//! outer loop, because a view's visibility needs its correlations at all planes.

use tch::{Kind, TchError, Tensor};
use vamvs_core::Planes;

use crate::correlate::{correlation, pooled};
use crate::native::layers::{Layers, Ncc, PairMlp};
use crate::native::ncc::{self, Own};
use crate::native::pairs::{self, Pairs, Reduction};
use crate::native::samples::{Points, Sampled, share_of};
use crate::native::transfer::Transfer;
use crate::native::{Level, in_memory, in_memory_mut};
use crate::profile::{Profile, Stage};
use crate::project::{Outside, PixelGrid, Projection, depth_of, for_offset, sample};
use crate::script::Mode;
use crate::slabs::Slabs;
use crate::{Aggregation, EncodedView, NetError, Network};

/// The sweep of one reference view.
struct Sweep<'a> {
    network: &'a Network,
    reference: &'a EncodedView,
    sources: Vec<(&'a EncodedView, Projection)>,
    planes: &'a Planes,
    /// The depths that are swept, in units of the range's near end: (D, 1), or in the second volume of a cascade, whose
    /// planes follow a depth map, (K, h·w).
    depths: Tensor,
    pixel_grid: PixelGrid,
    /// Index of the swept features in [`EncodedView::coarse`].
    level: usize,
    /// How far these features lie from the centres of their cells, see [`crate::Manifest::feature_offsets`].
    offset: f64,
    /// Planes in a slab.
    slab: usize,
    /// If kernels relate pairs of views: what they need of all planes.
    pairs: Option<NativePairs>,
}

/// Pairs of views that native kernels relate. Interpolation and a linear map commute, so the first layer of the MLP is
/// applied to the features of each view before they are warped.
struct NativePairs {
    mlp: PairMlp,
    ncc: Option<Ncc>,
    /// What the first layer gives for the reference view, and for each source view, (h, w, H).
    of_reference: Vec<f32>,
    of_sources: Vec<Vec<f32>>,
    /// The channels that the MLP leaves aside, of the reference view and of each source view, (h, w, R).
    aside: Tensor,
    sources_aside: Vec<Tensor>,
}

impl NativePairs {
    fn new(
        mlp: PairMlp,
        ncc: Option<Ncc>,
        reference: &Tensor,
        sources: &[&Tensor],
    ) -> Result<Self, NetError> {
        let used = mlp.of_source.inputs() as i64;
        let aside = |features: &Tensor| {
            let rest = features.f_narrow(1, used, features.size()[1] - used)?;
            rest.f_squeeze_dim(0)?.f_permute([1, 2, 0])?.f_contiguous()
        };
        let source = |features: &&Tensor| Ok(pairs::of_pixels(&mlp.of_source, Level::of(features)?));
        Ok(Self {
            ncc,
            of_reference: pairs::of_pixels(&mlp.of_reference, Level::of(reference)?),
            of_sources: sources.iter().map(source).collect::<Result<_, NetError>>()?,
            aside: aside(reference)?,
            sources_aside: sources.iter().map(|features| aside(features)).collect::<Result<_, TchError>>()?,
            mlp,
        })
    }

    /// What a kernel samples of a source view.
    fn levels(&self, index: usize, shift: [f32; 2]) -> Result<Vec<(Level<'_>, [f32; 2])>, NetError> {
        let aside = &self.sources_aside[index];
        let (height, width, channels) = aside.size3()?;
        let level =
            |values, channels| Level { values, width: width as usize, height: height as usize, channels };
        let mut levels = vec![(level(&self.of_sources[index], self.mlp.of_source.outputs()), shift)];
        if self.ncc.is_some() {
            levels.push((level(in_memory(aside)?, channels as usize), shift));
        }
        Ok(levels)
    }
}

/// The regularised costs of the planes, and for vis-var and vis-corr the visibility masks.
#[derive(Debug)]
pub struct Costs {
    /// (1, D, h, w); a low cost is likely.
    pub costs: Tensor,
    /// One mask (1, 1, h, w) in [0, 1] for each source view; empty unless the aggregation weighs views.
    pub visibility: Vec<Tensor>,
}

/// The aggregated volume, and for vis-var and vis-corr the visibility masks.
#[derive(Debug)]
pub struct CostVolume {
    /// (1, C', D, h, w)
    pub volume: Tensor,
    /// One mask (1, 1, h, w) in [0, 1] for each source view; empty unless the aggregation weighs views.
    pub visibility: Vec<Tensor>,
}

/// The inputs of a plane sweep.
#[derive(Clone, Copy, Debug)]
pub struct SweepInputs<'a> {
    /// The network.
    pub network: &'a Network,
    /// The reference view.
    pub reference: &'a EncodedView,
    /// The source views.
    pub sources: &'a [&'a EncodedView],
    /// The planes.
    pub planes: &'a Planes,
    /// 0: features at the coarse stride. 1: features at twice that stride, which exist if photographs were enlarged, and in
    /// a cascade.
    pub level: usize,
    /// The planes of a cascade's second volume lie around this depth map, (h, w) in plane coordinates, instead of being
    /// all planes.
    pub around: Option<&'a Tensor>,
    /// Memory of one slab of warped features, bytes; a slab has at least one plane.
    pub slab_bytes: usize,
}

/// The whole volume of a sweep. If the aggregation weighs views, the masks `seen` replace the network's own.
///
/// # Errors
/// If the module breaks its contract or memory runs out.
pub fn sweep(inputs: &SweepInputs<'_>, seen: Option<Vec<Tensor>>) -> Result<CostVolume, NetError> {
    let sweep = Sweep::new(inputs)?;
    if inputs.network.manifest().aggregation.correlates() {
        return sweep.correlate(seen.as_deref());
    }
    let visibility = sweep.masks(seen)?;
    Ok(CostVolume { volume: sweep.volume(&visibility)?, visibility })
}

/// The regularised costs of a sweep; `seen` as for [`sweep`]. If the module supports it (`slabs` in the manifest) and
/// no gradient is needed, the volume is never held as a whole: its planes go through the first layers of the
/// regularisation slab by slab, and the output of these layers has few channels.
///
/// # Errors
/// As [`sweep`].
pub fn costs(
    inputs: &SweepInputs<'_>,
    seen: Option<Vec<Tensor>>,
    profile: &mut Profile,
) -> Result<Costs, NetError> {
    let network = inputs.network;
    let learns = network.mode() == Mode::Training || inputs.reference.coarse[inputs.level].requires_grad();
    if !network.manifest().slabs || learns {
        let CostVolume { volume, visibility } = profile.time(Stage::Sweep, || sweep(inputs, seen))?;
        let costs = profile.time(Stage::Regularize, || regularize(inputs, &volume))?;
        return Ok(Costs { costs, visibility });
    }
    let sweep = Sweep::new(inputs)?;
    let visibility = profile.time(Stage::Sweep, || sweep.masks(seen))?;
    let mut slabs = Slabs::new(network, inputs.planes.count);
    for first in (0..inputs.planes.count).step_by(sweep.slab) {
        let slab = profile.time(Stage::Sweep, || sweep.aggregate(first, &visibility))?;
        let slab = slab.f_permute([1, 0, 2, 3])?.f_unsqueeze(0)?;
        profile.time(Stage::Regularize, || slabs.add(&slab))?;
    }
    drop(sweep); // what it holds is free for the layers that follow
    Ok(Costs { costs: profile.time(Stage::Regularize, || slabs.finish())?, visibility })
}

/// The regularised costs (1, D, h, w) of a whole volume (1, C', D, h, w) of these inputs; a low cost is likely.
///
/// # Errors
/// If the module breaks its contract or memory runs out.
pub fn regularize(inputs: &SweepInputs<'_>, volume: &Tensor) -> Result<Tensor, NetError> {
    let features = &inputs.reference.coarse[inputs.level];
    match inputs.around {
        None => inputs.network.regularize(volume, features),
        Some(_) => inputs.network.regularize_fine(volume, features),
    }
}

impl<'a> Sweep<'a> {
    fn new(inputs: &SweepInputs<'a>) -> Result<Self, NetError> {
        let SweepInputs { network, reference, sources, planes, level, around, slab_bytes } = *inputs;
        let stride = reference.stride << level;
        let pixel_grid = PixelGrid::new(stride, (0, 0), 1, reference.size_at(stride));
        let offset = network.manifest().feature_offset(stride);
        let pixel_grid = pixel_grid.moved(offset);
        let sources = sources
            .iter()
            .map(|source| Ok((*source, Projection::new(&pixel_grid, reference, source, planes.range.near)?)))
            .collect::<Result<_, TchError>>()?;
        let plane_bytes = reference.coarse[level].numel() * size_of::<f32>();
        let features = &reference.coarse[level];
        let depths = match around {
            None => depth_of(planes, &all_planes(planes, features)?)?,
            Some(around) => depth_of(planes, &planes_around(network, around)?)?,
        };
        let slab = (slab_bytes / plane_bytes).clamp(1, depths.size()[0] as usize);
        let pairs = match network.kernel_layers(std::slice::from_ref(features))? {
            Some(Layers { relate: Some(mlp), ncc, .. }) => {
                let sources: Vec<&Tensor> =
                    inputs.sources.iter().map(|source| &source.coarse[level]).collect();
                Some(NativePairs::new(mlp, ncc, features, &sources)?)
            }
            _ => None,
        };
        Ok(Self { network, reference, sources, planes, depths, pixel_grid, level, offset, slab, pairs })
    }

    /// The masks that weigh the views: `seen` if it is given and the aggregation weighs views, else the network's.
    fn masks(&self, seen: Option<Vec<Tensor>>) -> Result<Vec<Tensor>, NetError> {
        match seen {
            Some(seen) if self.network.manifest().aggregation.weighs_views() => Ok(seen),
            _ => self.visibility(),
        }
    }
}

impl Sweep<'_> {
    fn features<'v>(&self, view: &'v EncodedView) -> &'v Tensor {
        &view.coarse[self.level]
    }

    /// The features of a source view at the projections of the pixels at depths (D, 1): (D, C, h, w).
    fn warped(
        &self,
        source: &EncodedView,
        projection: &Projection,
        depth: &Tensor,
    ) -> Result<Tensor, TchError> {
        let grid = for_offset(&projection.grid(depth)?, self.offset, source.padded)?;
        sample(self.features(source), &grid, Outside::Zero)
    }

    /// vis-corr: the mean over the source views of their correlations with the reference view, weighted by their
    /// visibility.
    fn correlate(&self, seen: Option<&[Tensor]>) -> Result<CostVolume, NetError> {
        let mut reducer = self.network.manifest().aggregation.reducer();
        let mut visibility = Vec::with_capacity(self.sources.len());
        for (index, (source, projection)) in self.sources.iter().enumerate() {
            let correlation = self.correlation(source, projection)?; // (D, G, h, w)
            let mask = match seen {
                Some(seen) => seen[index].shallow_clone(),
                None => self.network.visibility(&pooled(&correlation)?)?,
            };
            reducer.add(&correlation, Some(&mask))?;
            visibility.push(mask);
        }
        let volume = reducer.finish()?.ok_or_else(no_views)?;
        Ok(CostVolume { volume: volume.f_permute([1, 0, 2, 3])?.f_unsqueeze(0)?.f_contiguous()?, visibility })
    }

    /// The correlation of one source view with the reference view at all planes, (D, G, h, w).
    fn correlation(&self, source: &EncodedView, projection: &Projection) -> Result<Tensor, NetError> {
        let group = self.network.manifest().group;
        let slab = |first: usize| -> Result<Tensor, TchError> {
            let (depth, _) = self.slab_depths(first)?;
            let warped = self.warped(source, projection, &depth)?;
            correlation(self.features(self.reference), &warped, group)
        };
        let slabs: Vec<Tensor> = (0..self.count()).step_by(self.slab).map(slab).collect::<Result<_, _>>()?;
        Ok(Tensor::f_cat(&slabs, 0)?)
    }

    /// The aggregated volume (1, C', D, h, w), written slab by slab.
    fn volume(&self, visibility: &[Tensor]) -> Result<Tensor, NetError> {
        let mut volume = None;
        for first in (0..self.planes.count).step_by(self.slab) {
            let slab = self.aggregate(first, visibility)?; // (D', C', h, w)
            let (d, c, h, w) = slab.size4()?;
            let volume = match &volume {
                Some(volume) => volume,
                None => volume.insert(Tensor::f_empty(
                    [1, c, self.planes.count as i64, h, w],
                    (slab.kind(), slab.device()),
                )?),
            };
            volume.f_narrow(2, first as i64, d)?.f_copy_(&slab.f_permute([1, 0, 2, 3])?.f_unsqueeze(0)?)?;
        }
        volume.ok_or_else(|| NetError::Request("a sweep needs at least one plane".to_owned()))
    }

    /// The slab that begins with plane `first`, aggregated over the views: (D', C', h, w).
    fn aggregate(&self, first: usize, visibility: &[Tensor]) -> Result<Tensor, NetError> {
        if let Some(pairs) = &self.pairs {
            return self.relate_natively(first, pairs);
        }
        let manifest = self.network.manifest();
        let aggregation = manifest.aggregation;
        let mut reducer = aggregation.reducer();
        let mut mean = Aggregation::Avg.reducer();
        let (depth, coordinate) = self.slab_depths(first)?;
        if !aggregation.relates_pairs() {
            let planes = depth.size()[0];
            reducer.add(&self.features(self.reference).f_expand([planes, -1, -1, -1], false)?, None)?;
        }
        for (index, (source, projection)) in self.sources.iter().enumerate() {
            let warped = self.warped(source, projection, &depth)?;
            if aggregation.relates_pairs() {
                let related = self.network.relate(self.features(self.reference), &warped, &coordinate)?;
                let split = related.size()[1] - manifest.averaged as i64;
                reducer.add(&related.f_narrow(1, 0, split)?, None)?;
                if manifest.averaged > 0 {
                    mean.add(&related.f_narrow(1, split, manifest.averaged as i64)?, None)?;
                }
            } else {
                reducer.add(&warped, visibility.get(index))?;
            }
        }
        let reduced = reducer.finish()?.ok_or_else(no_views)?;
        match mean.finish()? {
            Some(mean) => Ok(Tensor::f_cat(&[reduced, mean], 1)?),
            None => Ok(reduced),
        }
    }

    /// As [`Sweep::aggregate`] for pairs of views, with the native kernels.
    fn relate_natively(&self, first: usize, native: &NativePairs) -> Result<Tensor, NetError> {
        if self.sources.is_empty() {
            return Err(no_views());
        }
        let NativePairs { mlp, ncc, of_reference, aside, .. } = native;
        let (depths, _) = self.slab_depths(first)?;
        let depths = Vec::<f32>::try_from(depths.f_flatten(0, -1)?)?;
        let (h, w, channels) = aside.size3()?;
        let (planes, pixels) = (depths.len() as i64, (h * w) as usize);
        let outputs = mlp.outputs() + usize::from(ncc.is_some());
        let related = Tensor::f_empty([planes, h, w, outputs as i64], (Kind::Float, tch::Device::Cpu))?;
        let sampled = |(index, (source, _)): (usize, &(&EncodedView, Projection))| {
            let transfer = Transfer::new(self.reference, source, self.planes.range.near);
            Ok(Sampled { levels: native.levels(index, share_of(self.offset, source.padded))?, transfer })
        };
        let sources: Vec<_> =
            self.sources.iter().enumerate().map(sampled).collect::<Result<_, NetError>>()?;
        let own = Own { values: in_memory(aside)?, channels: channels as usize };
        let mut moments = vec![[0.0; 3]; if ncc.is_some() { pixels * sources.len() } else { 0 }];
        for (plane, depth) in (0..).zip(&depths) {
            let pairs = Pairs {
                points: Points { pixel_grid: &self.pixel_grid, depths: &vec![*depth; pixels] },
                reference: of_reference,
                mlp,
                of_source: None,
                reduction: Reduction::of(self.network.manifest().aggregation),
                aside: ncc.map(|_| own),
            };
            let mut plane = related.f_get(plane)?;
            let values = in_memory_mut(&mut plane)?;
            pairs::related(&pairs, &sources, values, &mut moments);
            if let Some(ncc) = ncc {
                ncc::similarity(*ncc, own, &moments, w as usize, values);
            }
        }
        Ok(related.f_permute([0, 3, 1, 2])?)
    }

    /// vis-var: the visibility mask of each source view, predicted from pair features that are max-pooled over all
    /// planes. Empty for aggregations that do not weigh views.
    fn visibility(&self) -> Result<Vec<Tensor>, NetError> {
        if !self.network.manifest().aggregation.weighs_views() {
            return Ok(Vec::new());
        }
        self.sources
            .iter()
            .map(|(source, projection)| {
                let mut pooled: Option<Tensor> = None;
                for first in (0..self.planes.count).step_by(self.slab) {
                    let (depth, coordinate) = self.slab_depths(first)?;
                    let warped = self.warped(source, projection, &depth)?;
                    let related = self.network.relate(self.features(self.reference), &warped, &coordinate)?;
                    let best = related.f_amax([0], true)?;
                    pooled = Some(match pooled {
                        Some(pooled) => pooled.f_maximum(&best)?,
                        None => best,
                    });
                }
                self.network.visibility(&pooled.ok_or_else(no_views)?)
            })
            .collect()
    }

    /// Depths of a slab's planes in units of `near`, (D', 1) or (D', h·w), and the planes' coordinates in [0, 1], (D').
    fn slab_depths(&self, first: usize) -> Result<(Tensor, Tensor), TchError> {
        let count = self.slab.min(self.count() - first) as i64;
        let first = first as i64;
        let u = Tensor::f_arange_start(first, first + count, (Kind::Float, self.depths.device()))?;
        Ok((self.depths.f_narrow(0, first, count)?, u.f_div_scalar((self.planes.count - 1) as f64)?))
    }

    /// The number of planes that are swept.
    fn count(&self) -> usize {
        self.depths.size()[0] as usize
    }
}

/// The coordinates of all planes, (D, 1), on the device of `like`.
fn all_planes(planes: &Planes, like: &Tensor) -> Result<Tensor, TchError> {
    Tensor::f_arange(planes.count as i64, (Kind::Float, like.device()))?.f_unsqueeze(1)
}

/// The planes of a cascade's second volume around a depth map (h, w), in plane coordinates: (K, h·w).
fn planes_around(network: &Network, around: &Tensor) -> Result<Tensor, NetError> {
    let Some(cascade) = network.manifest().cascade else {
        return Err(NetError::Request("a second volume needs a network that is a cascade".to_owned()));
    };
    let offsets = cascade.offsets(around.device())?.f_unsqueeze(1)?;
    Ok(around.f_detach()?.f_view([1, -1])?.f_add(&offsets)?.f_contiguous()?)
}

/// There is nothing to aggregate.
pub(crate) fn no_views() -> NetError {
    NetError::Request("a depth map needs at least one source view".to_owned())
}
