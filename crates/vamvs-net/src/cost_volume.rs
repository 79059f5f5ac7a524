//! The plane sweep: source features warped onto the reference's planes and aggregated (section 3.1).
//!
//! Slabs of planes are made one after the other, and within a slab view after view, so that besides the
//! volume itself only one slab of one view exists at a time.

use tch::{Kind, TchError, Tensor};
use vamvs_core::Planes;

use crate::correlate::{correlation, pooled};
use crate::project::{Outside, PixelLattice, Projection, depth_of, sample};
use crate::{Aggregation, EncodedView, NetError, Network};

/// The sweep of one reference view.
struct Sweep<'a> {
    network: &'a Network,
    reference: &'a EncodedView,
    sources: Vec<(&'a EncodedView, Projection)>,
    planes: &'a Planes,
    /// Which of the views' coarse features are swept.
    level: usize,
    slab: usize,
}

/// The aggregated volume, and for vis-var and vis-corr the visibility masks.
#[derive(Debug)]
pub struct CostVolume {
    /// (1, C', D, h, w)
    pub volume: Tensor,
    /// For each source view (1, 1, h, w) in [0, 1]; empty unless the aggregation weighs views.
    pub visibility: Vec<Tensor>,
}

/// Sweeps `planes` through the coarse features of the reference and its sources: at `level` 0 those of the network's
/// cells, at 1 of cells twice as wide, where photographs were enlarged. A slab of warped features takes at most
/// `slab_bytes`, or one plane if that is more. Where the aggregation weighs views, `seen` are masks to do it by,
/// instead of the network's.
///
/// # Errors
/// If the module breaks its contract or memory runs out.
pub fn sweep(
    network: &Network,
    reference: &EncodedView,
    sources: &[&EncodedView],
    planes: &Planes,
    level: usize,
    seen: Option<Vec<Tensor>>,
    slab_bytes: usize,
) -> Result<CostVolume, NetError> {
    let cell = reference.stride << level;
    let lattice = PixelLattice::new(cell, (0, 0), 1, reference.size_at(cell));
    let sources = sources
        .iter()
        .map(|source| Ok((*source, Projection::new(&lattice, reference, source, planes.range.near)?)))
        .collect::<Result<_, TchError>>()?;
    let plane_bytes = reference.coarse[level].numel() * size_of::<f32>();
    let slab = (slab_bytes / plane_bytes).clamp(1, planes.count);
    let sweep = Sweep { network, reference, sources, planes, level, slab };
    if network.manifest().aggregation.correlates() {
        return sweep.correlate(seen);
    }
    let visibility = match seen {
        Some(seen) if network.manifest().aggregation.weighs_views() => seen,
        _ => sweep.visibility()?,
    };
    Ok(CostVolume { volume: sweep.volume(&visibility)?, visibility })
}

impl Sweep<'_> {
    fn features<'v>(&self, view: &'v EncodedView) -> &'v Tensor {
        &view.coarse[self.level]
    }

    /// vis-corr: the mean over the source views of their correlations with the reference, each weighted by what the
    /// view sees.
    fn correlate(&self, seen: Option<Vec<Tensor>>) -> Result<CostVolume, NetError> {
        let mut reducer = self.network.manifest().aggregation.reducer();
        let mut visibility = Vec::with_capacity(self.sources.len());
        for (index, (source, projection)) in self.sources.iter().enumerate() {
            let correlation = self.correlation(source, projection)?; // (D, G, h, w)
            let mask = match &seen {
                Some(seen) => seen[index].shallow_clone(),
                None => self.network.visibility(&pooled(&correlation)?)?,
            };
            reducer.add(&correlation, Some(&mask))?;
            visibility.push(mask);
        }
        let volume = reducer.finish()?.ok_or_else(no_views)?;
        Ok(CostVolume { volume: volume.f_permute([1, 0, 2, 3])?.f_unsqueeze(0)?.f_contiguous()?, visibility })
    }

    /// The correlation of one source view with the reference at all planes, (D, G, h, w).
    fn correlation(&self, source: &EncodedView, projection: &Projection) -> Result<Tensor, NetError> {
        let group = self.network.manifest().group;
        let slab = |first: usize| -> Result<Tensor, TchError> {
            let (depth, _) = self.slab_depths(first)?;
            let warped = sample(self.features(source), &projection.grid(&depth)?, Outside::Zero)?;
            correlation(self.features(self.reference), &warped, group)
        };
        let slabs: Vec<Tensor> =
            (0..self.planes.count).step_by(self.slab).map(slab).collect::<Result<_, _>>()?;
        Ok(Tensor::f_cat(&slabs, 0)?)
    }

    /// Slab by slab into one volume (1, C', D, h, w).
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

    /// One slab, reduced over the views: (D', C', h, w).
    fn aggregate(&self, first: usize, visibility: &[Tensor]) -> Result<Tensor, NetError> {
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
            let warped = sample(self.features(source), &projection.grid(&depth)?, Outside::Zero)?;
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

    /// The visibility mask of each source view (vis-var): pair features, pooled over all planes.
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
                    let warped = sample(self.features(source), &projection.grid(&depth)?, Outside::Zero)?;
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

    /// Depths of a slab's planes in units of `near`, (D', 1), and their coordinates in [0, 1], (D').
    fn slab_depths(&self, first: usize) -> Result<(Tensor, Tensor), TchError> {
        let end = (first + self.slab).min(self.planes.count);
        let options = (Kind::Float, self.features(self.reference).device());
        let u = Tensor::f_arange_start(first as i64, end as i64, options)?;
        let coordinate = u.f_div_scalar((self.planes.count - 1) as f64)?;
        Ok((depth_of(self.planes, &u)?.f_unsqueeze(1)?, coordinate))
    }
}

fn no_views() -> NetError {
    NetError::Request("a depth map needs at least one source view".to_owned())
}
