//! The features of points: fetched at their projections into all views and aggregated over the views (section 3.3).

use tch::{Kind, TchError, Tensor};

use super::FlowStage;
use crate::cost_volume::no_views;
use crate::manifest::FLOW_SCALES;
use crate::native::layers::Layers;
use crate::native::pairs::{self, Pairs, Reduction};
use crate::native::samples::{self, Points, Sampled, share_of};
use crate::native::transfer::Transfer;
use crate::native::views::{self, Views};
use crate::native::{Level, in_memory, in_memory_mut};
use crate::project::{Outside, PixelGrid, Projection, for_offset, sample};
use crate::script::POSITION_CHANNELS;
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
        if !aggregation.relates_pairs() {
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
            reducer.add(&fetched, mask.as_ref())?;
        }
        reducer.finish()?.ok_or_else(no_views)
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

    /// A visibility mask sampled at the pixels of the reference view's sampling grid: (1, 1, h·w).
    fn mask(&self, mask: &Tensor, reference_grid: &Tensor) -> Result<Tensor, TchError> {
        sample(mask, reference_grid, Outside::Border)?.f_flatten(2, 3)
    }
}

/// Positions (3, P) as the flow gets them, (P, 24).
fn position_rows(points: &Tensor) -> Result<Tensor, TchError> {
    points.f_tr()?.f_repeat([1, POSITION_CHANNELS / 3])
}
