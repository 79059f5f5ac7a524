//! The features of points: fetched at their projections into all views and aggregated over the views (section 3.3).

use tch::{Kind, TchError, Tensor};

use super::FlowStage;
use crate::correlate::correlation;
use crate::cost_volume::no_views;
use crate::manifest::FLOW_SCALES;
use crate::native::layers::Layers;
use crate::native::pairs::{self, Pairs, Reduction};
use crate::native::samples::{self, Points, Sampled, share_of};
use crate::native::transfer::Transfer;
use crate::native::views::{self, Views};
use crate::native::{Level, fetch, in_memory, in_memory_mut};
use crate::project::{Outside, PixelGrid, Projection, for_offset, sample};
use crate::script::{CONTEXT_LEVEL, POSITION_CHANNELS};
use crate::{EncodedView, NetError};

impl FlowStage<'_> {
    /// Aggregated features of all points, followed by their positions: (1, C'' + 24, P).
    pub(super) fn features(
        &self,
        pixel_grid: &PixelGrid,
        depth: &Tensor,
        points: &Tensor,
        layers: Option<&Layers>,
    ) -> Result<Tensor, NetError> {
        if self.network.kernels_correlate(&self.reference.flow) {
            return self.native_features(pixel_grid, depth, points);
        }
        if let Some(layers) = layers {
            let aggregated = self.fetch_natively(layers, pixel_grid, depth)?;
            let rows = Tensor::f_cat(&[aggregated, position_rows(points)?], 1)?;
            return Ok(rows.f_tr()?.f_unsqueeze(0)?);
        }
        let aggregated = self.fetch(pixel_grid, depth)?; // (J, C'', h·w)
        let channels = aggregated.size()[1];
        let aggregated = aggregated.f_permute([1, 2, 0])?.f_reshape([channels, -1])?; // (C'', P)
        let position = points.f_repeat([POSITION_CHANNELS / 3, 1])?;
        Ok(Tensor::f_cat(&[aggregated, position], 0)?.f_unsqueeze(0)?)
    }

    /// Fetches features at the projections of the points and aggregates them over the views: (J, C'', h·w).
    fn fetch(&self, pixel_grid: &PixelGrid, depth: &Tensor) -> Result<Tensor, NetError> {
        let aggregation = self.network.manifest().aggregation;
        let hypotheses = depth.size()[0];
        let device = depth.device();
        let reference_grid = pixel_grid.grid(self.reference, device)?;
        let reference = self.fetch_levels(self.reference, &reference_grid, Outside::Border)?; // (1, C, h·w)
        let mut reducer = aggregation.reducer();
        if !aggregation.relates_pairs() && !aggregation.correlates() {
            reducer.add(&reference.f_expand([hypotheses, -1, -1], false)?, None)?;
        }
        for (index, source) in self.sources.iter().enumerate() {
            let projection = Projection::new(pixel_grid, self.reference, source, self.planes.range.near)?;
            let fetched = self.fetch_levels(source, &projection.grid(depth)?, Outside::Zero)?; // (J, C, h·w)
            if aggregation.relates_pairs() {
                reducer.add(&self.network.relate_flow(&reference, &fetched)?, None)?;
                continue;
            }
            let mask = self.visibility.get(index).map(|mask| self.mask(mask, &reference_grid)).transpose()?;
            if aggregation.correlates() {
                reducer.add(&self.correlations(&reference, &fetched)?, mask.as_ref())?;
            } else {
                reducer.add(&fetched, mask.as_ref())?;
            }
        }
        let aggregated = reducer.finish()?.ok_or_else(no_views)?;
        if aggregation.correlates() {
            return self.with_context(&aggregated, &reference);
        }
        Ok(aggregated)
    }

    /// All levels of a view's features sampled at one grid, joined: (B, C₁ + C₂ + C₃, h·w).
    fn fetch_levels(&self, view: &EncodedView, grid: &Tensor, outside: Outside) -> Result<Tensor, TchError> {
        let level = |(features, scale): (&Tensor, usize)| {
            let offset = self.network.manifest().feature_offset(scale);
            sample(features, &for_offset(grid, offset, view.padded)?, outside)
        };
        let levels: Vec<Tensor> =
            view.flow.iter().zip(FLOW_SCALES).map(level).collect::<Result<_, TchError>>()?;
        Tensor::f_cat(&levels, 1)?.f_flatten(2, 3)
    }

    /// vis-corr: the correlations of fetched features (J, C, h·w) with the reference view's (1, C, h·w), level by
    /// level: (J, G, h·w), with G the number of groups in all levels.
    fn correlations(&self, reference: &Tensor, fetched: &Tensor) -> Result<Tensor, TchError> {
        let group = self.network.manifest().group;
        let widths = self.reference.flow.each_ref().map(|level| level.size()[1]);
        let level = |index: usize| {
            let (first, width) = (widths[..index].iter().sum(), widths[index]);
            correlation(&reference.f_narrow(1, first, width)?, &fetched.f_narrow(1, first, width)?, group)
        };
        Tensor::f_cat(&[level(0)?, level(1)?, level(2)?], 1)
    }

    /// As [`FlowStage::features`], with the native kernels.
    fn native_features(
        &self,
        pixel_grid: &PixelGrid,
        depth: &Tensor,
        points: &Tensor,
    ) -> Result<Tensor, NetError> {
        let (grid, group) = (pixel_grid.grid(self.reference, depth.device())?, self.network.manifest().group);
        let reference = self.own_features(pixel_grid)?; // (h·w, C)
        let masks = self.visibility[..self.sources.len()].iter();
        let masks = masks.map(|mask| self.mask(mask, &grid)?.f_contiguous());
        let masks: Vec<Tensor> = masks.collect::<Result<_, TchError>>()?;
        let sources = self.sources.iter().zip(&masks).map(|(source, mask)| self.native_source(source, mask));
        let sources: Vec<_> = sources.collect::<Result<_, NetError>>()?;
        let depth = depth.f_contiguous()?;
        let about = fetch::Points { pixel_grid, depths: in_memory(&depth)?, reference: &reference, group };
        let reference = Tensor::f_from_slice(&reference)?
            .f_view([(pixel_grid.x.len() * pixel_grid.y.len()) as i64, -1])?;
        let correlated = reference.size()[1] / group as i64;
        let mut rows = Tensor::f_empty([points.size()[1], correlated], (Kind::Float, tch::Device::Cpu))?;
        fetch::correlations(&about, &sources, in_memory_mut(&mut rows)?, correlated as usize);
        self.joined_rows(&rows, &reference, points)
    }

    /// A source view as the native kernels see it; `mask` is its visibility at the pixels, (h·w).
    fn native_source<'b>(
        &self,
        source: &'b EncodedView,
        mask: &'b Tensor,
    ) -> Result<fetch::Source<'b>, NetError> {
        let [half, quarter, eighth] = &source.flow;
        Ok(fetch::Source {
            levels: [Level::of(half)?, Level::of(quarter)?, Level::of(eighth)?],
            transfer: Transfer::new(self.reference, source, self.planes.range.near),
            mask: in_memory(mask)?,
        })
    }

    /// vis-corr: joins correlations (P, G), the reference view's own features at 1/4, and the positions:
    /// (1, C'' + 24, P).
    fn joined_rows(&self, rows: &Tensor, reference: &Tensor, points: &Tensor) -> Result<Tensor, NetError> {
        let widths = self.reference.flow.each_ref().map(|level| level.size()[1]);
        let first = widths[..CONTEXT_LEVEL].iter().sum();
        let context = reference.f_narrow(1, first, widths[CONTEXT_LEVEL])?;
        let hypotheses = rows.size()[0] / context.size()[0];
        let context = context.f_unsqueeze(1)?.f_expand([-1, hypotheses, -1], false)?;
        let context = context.f_reshape([rows.size()[0], -1])?;
        Ok(Tensor::f_cat(&[rows, &context, &position_rows(points)?], 1)?.f_tr()?.f_unsqueeze(0)?)
    }

    /// As [`FlowStage::fetch`], with the native kernels: (h·w·J, C'').
    fn fetch_natively(
        &self,
        layers: &Layers,
        pixel_grid: &PixelGrid,
        depth: &Tensor,
    ) -> Result<Tensor, NetError> {
        let channels =
            self.sources.first().ok_or_else(no_views)?.flow.iter().map(|level| level.size()[1]).sum();
        let reference = self.own_features(pixel_grid)?; // (h·w, C)
        let depth = depth.f_contiguous()?;
        let points = Points { pixel_grid, depths: in_memory(&depth)? };
        let sources = self.sources.iter().map(|source| {
            let transfer = Transfer::new(self.reference, source, self.planes.range.near);
            Ok(Sampled { levels: self.levels(source)?, transfer })
        });
        let sources: Vec<_> = sources.collect::<Result<_, NetError>>()?;
        let aggregation = self.network.manifest().aggregation;
        let rows = |channels: i64| {
            Tensor::f_empty([depth.numel() as i64, channels], (Kind::Float, tch::Device::Cpu))
        };
        if let Some(mlp) = &layers.relate_flow {
            let pixels = pixel_grid.x.len() * pixel_grid.y.len();
            let own = Level { values: &reference, width: pixels, height: 1, channels: channels as usize };
            let own = pairs::of_pixels(&mlp.of_reference, own);
            let pairs = Pairs {
                points,
                reference: &own,
                mlp,
                of_source: Some(&mlp.of_source),
                reduction: Reduction::of(aggregation),
                aside: None,
            };
            let mut related = rows(mlp.outputs() as i64)?;
            pairs::related(&pairs, &sources, in_memory_mut(&mut related)?, &mut []);
            return Ok(related);
        }
        let grid = pixel_grid.grid(self.reference, tch::Device::Cpu)?;
        let masks =
            self.visibility.iter().take(sources.len()).map(|mask| self.mask(mask, &grid)?.f_contiguous());
        let masks: Vec<Tensor> = masks.collect::<Result<_, TchError>>()?;
        let masks: Vec<&[f32]> = masks.iter().map(in_memory).collect::<Result<_, _>>()?;
        let mut fetched = rows(channels)?;
        let views = Views { points, reference: &reference, sources: &sources, masks: &masks, aggregation };
        views::reduced(&views, in_memory_mut(&mut fetched)?);
        Ok(fetched)
    }

    /// The flow features of a view, to be sampled by a kernel.
    fn levels<'b>(&self, view: &'b EncodedView) -> Result<Vec<(Level<'b>, [f32; 2])>, NetError> {
        let level = |(features, scale): (&'b Tensor, usize)| {
            let offset = self.network.manifest().feature_offset(scale);
            Ok((Level::of(features)?, share_of(offset, view.padded)))
        };
        view.flow.iter().zip(FLOW_SCALES).map(level).collect()
    }

    /// The reference view's own features of all levels at the pixels, (h·w, C₁ + C₂ + C₃).
    fn own_features(&self, pixel_grid: &PixelGrid) -> Result<Vec<f32>, NetError> {
        Ok(samples::own_features(pixel_grid, &self.levels(self.reference)?, self.reference.padded))
    }

    /// vis-corr: joins correlations (J, G, h·w) and the reference view's own features at 1/4 (taken from all its
    /// fetched features, (1, C, h·w)), because correlations do not tell what a pixel looks like.
    fn with_context(&self, correlations: &Tensor, reference: &Tensor) -> Result<Tensor, NetError> {
        let widths = self.reference.flow.each_ref().map(|level| level.size()[1]);
        let first = widths[..CONTEXT_LEVEL].iter().sum();
        let context = reference.f_narrow(1, first, widths[CONTEXT_LEVEL])?;
        let context = context.f_expand([correlations.size()[0], -1, -1], false)?;
        Ok(Tensor::f_cat(&[correlations, &context], 1)?)
    }

    /// A visibility mask sampled at the pixels of the reference view's sampling grid: (1, 1, h·w).
    fn mask(&self, mask: &Tensor, reference_grid: &Tensor) -> Result<Tensor, TchError> {
        sample(mask, reference_grid, Outside::Border)?.f_flatten(2, 3)
    }
}

/// Positions (3, P) as the flow gets them, (P, 24).
fn position_rows(points: &Tensor) -> Result<Tensor, TchError> {
    points.f_tr()?.f_repeat([1, POSITION_CHANNELS / 3])
}
